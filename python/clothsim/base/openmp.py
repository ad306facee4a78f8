"""Set how OpenMP's threads wait after a call: they sleep.

A thread that has finished its work stays awake for the next work, in libgomp for some 8 ms by default. The runtime
reads this time when it is loaded, so this module is imported before the core. Your own `OMP_WAIT_POLICY` or
`GOMP_SPINCOUNT` is respected. A process that loads libgomp before clothsim keeps its settings.
"""

import os

# Turns of a waiting loop, some 25 ns each: what the next stage or call of a running series takes.
_SPINS = "2000"

_NAMES = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")

if not any(name in os.environ for name in _NAMES):
    os.environ["GOMP_SPINCOUNT"] = _SPINS
    try:
        from .. import _core  # noqa: F401
    finally:
        del os.environ["GOMP_SPINCOUNT"]  # children decide for themselves
