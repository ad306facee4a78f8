"""Judge error control on random scenes: is the error had, is the estimate true, what does it cost?

    python benchmarks/error_control.py                  # judges, on scenes that tuned nothing
    python benchmarks/error_control.py --stream tune    # the scenes that constants were found on
    python benchmarks/error_control.py --scenes 350     # about 2,000 runs

Errors are against another model and method (random_cloths.py), kept in --folder. A request is
judged where that solution is ten times more accurate than it; an estimate where it is ten times
more accurate than the error. Costs are force evaluations of everything over the cheapest fixed
choice of method and step that reaches what was asked, found by search, for runs of 100 steps or
more.
"""

from __future__ import annotations

import argparse
import math
import pickle
import tempfile
import warnings
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import clothsim as cs
import numpy as np
from random_cloths import Case, draw, rms, truth

STREAMS = {"tune": 1, "judge": 2, "judge2": 3, "judge3": 4, "judge4": 5}
RATIO = 1.08  # between the steps that are searched
# Explicit Euler has no stable step without damping.
NAMED = [
    name for name, one in cs.integrators().items() if one.explicit and name != "explicit_euler"
]
AUTO, BY_NAME = 4, 2  # requests of a scene, beside the default call
LOOSEST, TIGHTEST = 3, 10  # exponents of what is asked
SURE = 10.0  # times more accurate than what is judged is the true solution


@dataclass
class Judgement:
    """One run: all errors over the size of the cloth."""

    case: str
    start: str
    kind: str
    request: float
    error: float
    estimate: float
    reason: str
    uncertainty: float
    evaluations: int
    steps: int
    best: float = math.nan  # evaluations of the cheapest fixed choice


def requests(case: Case) -> list[tuple[str, int]]:
    """Kinds of run and exponents of the error asked for, drawn for a scene."""
    rng = np.random.default_rng([int(n) for n in case.name.split("/")] + [7])
    exponents = rng.permutation(np.arange(LOOSEST, TIGHTEST + 1))[:AUTO]
    kinds = [("auto", int(k)) for k in exponents]
    for name in rng.permutation(NAMED)[:BY_NAME].tolist():
        # The low orders are asked for what they can do.
        loosest = LOOSEST + cs.integrators()[name].order
        kinds.append((name, int(rng.integers(LOOSEST, min(loosest, TIGHTEST) + 1))))
    return [*kinds, ("default", 3)]


def run(case: Case, kind: str, exponent: int) -> cs.Run:
    if kind == "default":
        return cs.simulate(case.scene, case.duration, threads=1)
    return cs.simulate(case.scene, case.duration, rtol=10.0**-exponent, integrator=kind, threads=1)


def judge(case: Case, kind: str, exponent: int, exact: np.ndarray, uncertainty: float) -> Judgement:
    size = max(case.scene.cloth.size)
    result = run(case, kind, exponent)
    report = result.report
    estimate = report["error_estimate"]
    return Judgement(
        case.name,
        case.start,
        kind,
        10.0**-exponent,
        rms(result.x[-1] - exact) / size,
        estimate["rms"] / size,
        estimate.get("reason", ""),
        uncertainty / size,
        report["force_evaluations"],
        report["steps"],
    )


def cheapest(
    case: Case, exact: np.ndarray, errors: list[float], limit: float
) -> dict[float, float]:
    """Force evaluations of the cheapest fixed method and step for each error [m]."""
    scene = case.scene
    best = dict.fromkeys(errors, math.inf)
    state = scene.initial_position, scene.initial_velocity
    for name in NAMED:
        cost = scene.explain(integrator=name)["force_evaluations_per_step"]
        steps = max(2, int(0.5 * case.duration / cs.max_stable_dt(scene, name)))
        open_errors = set(errors)
        while open_errors and steps * cost < min(limit, max(best[bound] for bound in open_errors)):
            try:
                x = cs.step(
                    scene, *state, case.duration / steps, steps, integrator=name, threads=1
                )[0]
                error = rms(x - exact)
            except cs.UnstableError:
                error = math.inf
            for bound in [bound for bound in open_errors if error <= bound]:
                best[bound] = min(best[bound], steps * cost)
                open_errors.discard(bound)
            steps = max(steps + 1, math.ceil(RATIO * steps))
    return best


def judged_runs(stream: str, first: int, scenes: int, folder: Path, cost: bool) -> list[Judgement]:
    judgements: list[Judgement] = []
    file = folder / "cheapest.pkl"
    known_costs = pickle.loads(file.read_bytes()) if file.exists() else {}
    for number in range(first, first + scenes):
        case = draw(STREAMS[stream], number)
        exact, uncertainty = truth(case, folder)
        size = max(case.scene.cloth.size)
        for kind, exponent in requests(case):
            if 10.0**-exponent * size < SURE * uncertainty:
                continue
            judgement = judge(case, kind, exponent, exact, uncertainty)
            judgements.append(judgement)
            if cost and kind == "auto" and judgement.steps >= 100:
                key = case.name, exponent
                if key not in known_costs:
                    request = judgement.request * size
                    limit = 3.0 * judgement.evaluations
                    known_costs[key] = cheapest(case, exact, [request], limit)[request]
                    file.write_bytes(pickle.dumps(known_costs))
                judgement.best = known_costs[key]
    return judgements


def quantile(values: list[float], q: float) -> float:
    return float(np.quantile(values, q)) if values else math.nan


def table(judgements: list[Judgement]) -> str:
    lines = [
        "| runs of | judged | error / asked <= 1 | <= 1.5 | worst | no estimate | estimates "
        "judged | "
        "within 3 times | least estimate / error | median asked / error |",
        "|" + " --- |" * 10,
    ]
    kinds = defaultdict(list)
    for run in judgements:
        kinds["all"].append(run)
        kinds[run.kind].append(run)
    for kind, runs in sorted(kinds.items(), key=lambda item: (item[0] == "all", item[0])):
        estimates = [run for run in runs if not run.reason]
        over = [run.error / run.request for run in estimates]
        ratios = [
            run.estimate / run.error for run in estimates if run.error > SURE * run.uncertainty
        ]
        within = [1 / 3 <= ratio <= 3 for ratio in ratios]
        lines.append(
            f"| {kind} | {len(runs)} | {np.mean([o <= 1 for o in over]):.2%} | "
            f"{np.mean([o <= 1.5 for o in over]):.2%} | {max(over):.2f} | "
            f"{np.mean([bool(run.reason) for run in runs]):.1%} | {len(ratios)} | "
            f"{np.mean(within):.1%} | {min(ratios, default=math.nan):.2f} | "
            f"{1 / quantile(over, 0.5):.1f} |"
        )
    costs = [run.evaluations / run.best for run in judgements if math.isfinite(run.best)]
    lines += [
        "",
        f"Cost of everything over the cheapest fixed choice, {len(costs)} runs: median "
        f"{quantile(costs, 0.5):.2f}, 95 % {quantile(costs, 0.95):.2f}",
    ]
    return "\n".join(lines)


def main() -> None:
    warnings.simplefilter("ignore", cs.StabilityWarning)
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--stream",
        choices=STREAMS,
        default="judge4",
        help="judge to judge3 have served choices already",
    )
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--no-cost", action="store_true", help="leave the search out")
    parser.add_argument("--bad", action="store_true", help="list the runs that miss a figure")
    parser.add_argument(
        "--folder", type=Path, default=Path(tempfile.gettempdir()) / "clothsim-error-control"
    )
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    judgements = judged_runs(args.stream, args.first, args.scenes, args.folder, not args.no_cost)
    print(table(judgements))
    for run in judgements if args.bad else []:
        ratio = run.estimate / max(run.error, 1e-300)
        is_sure = run.error > SURE * run.uncertainty
        if run.reason or run.error > run.request or (is_sure and not 0.5 <= ratio <= 3):
            print(run)


if __name__ == "__main__":
    main()
