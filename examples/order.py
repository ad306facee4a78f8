"""The order of RK4 and of explicit Euler by their errors, and a test with pytest: `pytest
examples/order.py`.

Explicit Euler amplifies undamped motion at every time step: the last run diverges.
"""

import clothsim as cs
import matplotlib.pyplot as plt
import pytest

STIFF = cs.scenes.paper_swing()
SOFT = cs.scenes.oscillator()
UNDAMPED = STIFF.replace(cloth=STIFF.cloth.replace(damping=0.0))


def test_rk4_has_order_4():
    assert cs.convergence(STIFF, 0.02, dts=[4e-4, 2e-4, 1e-4]).order == pytest.approx(4.0, abs=0.1)


def test_explicit_euler_has_order_1():
    found = cs.convergence(SOFT, 0.5, dts=[4e-4, 2e-4, 1e-4], integrator="explicit_euler")
    assert found.order == pytest.approx(1.0, abs=0.1)


if __name__ == "__main__":
    dts = [8e-3, 4e-3, 2e-3, 1e-3]
    figure, axes = plt.subplots(figsize=(6, 4))
    for name in ("rk4", "explicit_euler"):
        found = cs.convergence(SOFT, 0.5, dts, integrator=name)
        print(f"{name}: order {found.order:.2f}")
        axes.loglog(found.dt, found.rms, "o-", label=f"{name}, order {found.order:.2f}")
    axes.set(xlabel="time step [s]", ylabel="rms error [m]")
    axes.legend()
    figure.savefig("order.png")
    try:
        cs.simulate(UNDAMPED, 0.5, dt=4e-4, integrator="explicit_euler")
    except cs.UnstableError as error:
        print(error)
