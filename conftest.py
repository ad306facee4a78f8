"""What pytest leaves alone where an optional package is missing."""

from importlib.util import find_spec

_NEEDED = {
    "numba": ["python/clothsim/benchmark/numba_kernels.py"],
    "xarray": ["python/clothsim/sweep/accessor.py", "python/clothsim/sweep/api.py"],
    "zarr": ["python/clothsim/sweep/dataset.py"],
}
collect_ignore = [path for name, paths in _NEEDED.items() if not find_spec(name) for path in paths]
