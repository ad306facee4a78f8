"""A member with error control: run alone by `simulate`, and looked at without changing its bits.

Its steps are the method's own, so it shares no call with others. States between the first and the
last come from the method's dense output, which leaves the steps as they are. "auto" may choose a
method with a fixed step, which has none: then the run found is repeated at that step and watched.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from ..errors import ContactError, UnstableError
from ..integration import integrators
from ..measures import largest_stretch, max_stable_dt, penetration
from ..run import Run
from ..simulation import simulate
from .batch import Stopped, run_batch
from .member import Member, Outcome

_WATCHED = frozenset({"stretch", "penetration", "contact"})


def run_controlled(
    member: Member,
    needs: frozenset[str],
    *,
    every: int | float | None = None,
    sampling: int = 32,
    threads: int | None = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Run a member whose step is chosen by `rtol` and `atol`; arguments are those of `run_batch`.

    Raises
    ------
    Stopped
        If `stopped` says so; it is asked before each run, not during one.
    """
    outcome = Outcome(member)
    watched = needs & _WATCHED

    def run(between: int | float | None) -> Run:
        if stopped():
            raise Stopped
        return simulate(
            member.scene, member.duration, rtol=member.rtol, atol=member.atol, every=between,
            threads=threads, **member.numerics,
        )  # fmt: skip

    between = member.duration / sampling
    # Frames of dense output are for free where nobody asks for others.
    whole = bool(watched) and every is None and "frames" not in needs
    try:
        run_itself = run(between if whole else every)
        method = run_itself.report["integrator"]
        dense = integrators()[method].adaptive
        outcome.member = dataclasses.replace(
            member, max_stable_dt=float(max_stable_dt(member.scene, method))
        )
        if watched and dense:
            _look_at_frames(outcome, run_itself if whole else run(between))
        elif watched:
            run_itself = run(every)  # without frames that would have cut its steps
            _look_again(outcome, run_itself, watched, sampling, threads, stopped)
    except (UnstableError, ContactError) as error:
        outcome.error = error
        return outcome
    report = run_itself.report
    outcome.itself = run_itself
    outcome.steps, outcome.seconds = report["steps"], report["wall_time"]
    kept = range(len(run_itself.t)) if "frames" in needs else (0, -1)
    for k in kept:
        outcome.t.append(float(run_itself.t[k]))
        outcome.x.append(run_itself.x[k])
        outcome.v.append(run_itself.v[k])
    return outcome


def _look_at_frames(outcome: Outcome, frames: Run) -> None:
    scene = outcome.scene
    outcome.largest_stretch = float(largest_stretch(scene, frames.x).max())
    for sphere in scene.spheres:
        depths = [penetration(x, sphere, t) for x, t in zip(frames.x, frames.t, strict=True)]
        points, triangles = outcome.penetration
        outcome.penetration = (
            max(points, *(float(depth["points"]) for depth in depths)),
            max(triangles, *(float(depth["triangles"]) for depth in depths)),
        )
    outcomes: Any = frames.report["outcomes"]
    first = outcomes["first_contact"]["value"] if outcomes else None
    outcome.first_contact = math.nan if first is None else first


def _look_again(
    outcome: Outcome,
    run: Run,
    watched: frozenset[str],
    sampling: int,
    threads: int | None,
    stopped: Callable[[], bool],
) -> None:
    report = run.report
    at_that_step = dataclasses.replace(
        outcome.member, rtol=None, atol=None, dt=report["dt"], integrator=report["integrator"],
        precision=report["precision"],
    )  # fmt: skip
    between = float(run.t[1]) if len(run.t) > 2 else None
    (looked,) = run_batch(
        [at_that_step], watched, every=between, sampling=sampling, threads=threads, stopped=stopped
    )
    outcome.largest_stretch = looked.largest_stretch
    outcome.penetration, outcome.first_contact = looked.penetration, looked.first_contact
