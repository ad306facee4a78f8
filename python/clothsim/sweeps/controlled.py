"""Run a member with error control. `simulate` runs it alone, because the method chooses its steps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from ..errors import ContactError, UnstableError
from ..run.frames import as_every
from ..run.simulate import simulate
from ..stability.limit import max_stable_dt
from .batch import Stopped
from .member import Member, Outcome


def run_controlled(
    member: Member,
    needs: frozenset[str],
    *,
    every: int | float | None = None,
    sampling: int = 32,
    threads: int | None = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Run a member whose step is chosen by `rtol` and `atol`; the arguments are as for `run_batch`.

    Raises
    ------
    Stopped
        If `stopped` says so; it is asked before the run, not during it.
    """
    outcome = Outcome(member)
    if stopped():
        raise Stopped
    try:
        run = simulate(
            member.scene,
            member.duration,
            rtol=member.rtol,
            atol=member.atol,
            every=as_every(every),
            threads=threads,
            sampling=sampling,
            **member.numerics,
        )
    except (UnstableError, ContactError) as error:
        outcome.error = error
        return outcome
    report = run.report
    limit = float(max_stable_dt(member.scene, report["integrator"]))
    outcome.member = dataclasses.replace(member, max_stable_dt=limit)
    outcome.itself = run
    outcome.watched = {
        "first_contact": report["first_contact"]["time"],
        "point_depth": report["penetration"]["points"],
        "triangle_depth": report["penetration"]["triangles"],
        "stretch": report["stretch"]["largest"],
        "energy_gained": report["energy"]["gained"],
    }
    outcome.steps, outcome.seconds = report["steps"], report["wall_time"]
    kept = range(len(run.t)) if "frames" in needs else (0, -1)
    for k in kept:
        outcome.t.append(float(run.t[k]))
        outcome.x.append(run.x[k])
        outcome.v.append(run.v[k])
    return outcome
