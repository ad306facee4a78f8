"""What pytest leaves alone where an optional package is missing, and the name that examples of
docstrings use.
"""

from importlib.util import find_spec

import pytest

_NEEDED = {
    "xarray": ["python/clothsim/sweeps/accessor.py", "python/clothsim/sweeps/sweep.py"],
    "zarr": ["python/clothsim/sweeps/store.py"],
}
collect_ignore = [path for name, paths in _NEEDED.items() if not find_spec(name) for path in paths]


@pytest.fixture(autouse=True)
def clothsim_as_cs(doctest_namespace):
    import clothsim

    doctest_namespace["cs"] = clothsim
