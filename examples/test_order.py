"""Check with pytest that RK4 converges with order 4: `pytest examples/test_order.py`."""

import clothsim as cs
import pytest


@pytest.mark.parametrize("bend", [False, True])
def test_rk4_has_order_4(bend):
    scene = cs.scenes.paper_swing(bend=bend)
    result = cs.convergence(scene, 0.02, dts=[4e-4, 2e-4, 1e-4], integrator="rk4")
    assert result.order == pytest.approx(4.0, abs=0.1)
