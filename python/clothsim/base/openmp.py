"""Set how OpenMP's threads wait after a call: they sleep.

A thread that has finished its work stays awake for the next work, in libgomp for some 8 ms by default. The runtime
reads this time when it is loaded, so this module is imported before the core. Your own `OMP_WAIT_POLICY` or
`GOMP_SPINCOUNT` is respected. A process that loads libgomp before clothsim keeps its settings.
"""

import os
from importlib.util import find_spec

# Turns of a waiting loop, some 25 ns each: what the next stage or call of a running series takes.
_SPINS = "2000"

_NAMES = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")


def _load() -> None:
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


if any(name in os.environ for name in _NAMES):
    _load()
else:
    os.environ["GOMP_SPINCOUNT"] = _SPINS
    try:
        _load()
    finally:
        del os.environ["GOMP_SPINCOUNT"]  # children decide for themselves
