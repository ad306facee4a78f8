"""What pytest leaves alone where an optional package is missing."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("numba") else ["python/clothsim/benchmark/numba_kernels.py"]
