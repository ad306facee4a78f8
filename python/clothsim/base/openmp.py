"""How OpenMP's threads wait: asleep, once a call has returned.

A thread of a team that is done stays awake for the next piece of work, libgomp's for some 8 ms by
default. It reads for how long when it is loaded, so this module is imported before the core. Your
own `OMP_WAIT_POLICY` or `GOMP_SPINCOUNT` is respected, as is a process that has loaded libgomp
before clothsim.
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
