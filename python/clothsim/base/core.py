"""Load the core, or say how to build it."""

from importlib.util import find_spec

try:
    from .. import _core  # noqa: F401
except ImportError:
    # Python would name a circular import.
    if find_spec("clothsim._core") is None:
        raise ImportError(
            "the core of clothsim is not built here: run `pip install .` in the clone, "
            "or build it as CONTRIBUTING.md says and put it into python/clothsim"
        ) from None
    raise
