"""What pytest leaves alone where an optional package is missing."""

from importlib.util import find_spec

_NEEDED = {
    "xarray": ["python/clothsim/sweeps/accessor.py", "python/clothsim/sweeps/api.py"],
    "zarr": ["python/clothsim/sweeps/store.py"],
}
collect_ignore = [path for name, paths in _NEEDED.items() if not find_spec(name) for path in paths]
