"""Measure something of your own in a sweep: how far the free corner of a hanging cloth falls."""

import clothsim as cs


def drop(run: cs.Run) -> float:
    """Height that the far corner has lost at the end of the run [m]."""
    return float(run.x[0, -1, -1, 1] - run.x[-1, -1, -1, 1])


scene = cs.scenes.paper_swing()
table = cs.sweep(
    scene, over={"stiffness": [1e3, 1e4, 1e5]}, duration=0.3, metrics={"drop": drop}, progress=False
)
print(table["drop"].to_pandas())
