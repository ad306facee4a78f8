"""Draw docs/images/rkc2_region.png: where a step of rkc2 does not amplify y' = lambda y, in the
plane of z = lambda h, with the modes of a cloth whose damping is in proportion to its stiffness.

python tools/draw_region.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

_CIRCLES = {5: 2.2, 10: 2.4}  # stages: h / tau
_EPSILON = 2 / 13  # as in cpp/integrators/rkc2.cpp


def amplification(stages: int, z: np.ndarray) -> np.ndarray:
    """Return the size of the stability polynomial 1 - b T(w0) + b T(w0 + w1 z)."""
    w0 = 1 + _EPSILON / stages**2
    chebyshev = np.polynomial.Chebyshev.basis(stages)
    first = chebyshev.deriv(1)(w0)
    second = chebyshev.deriv(2)(w0)
    b, w1 = second / first**2, first / second
    return np.abs(1 - b * chebyshev(w0) + b * chebyshev(w0 + w1 * z))


def main() -> None:
    figure, axes = plt.subplots(len(_CIRCLES), figsize=(8, 4.6), layout="constrained", sharex=True)
    x, y = np.meshgrid(np.linspace(-68, 3, 1400), np.linspace(-8, 8, 500))
    z = x + 1j * y
    rk4 = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    for axis, (stages, radius) in zip(axes, _CIRCLES.items(), strict=True):
        circle = radius * (turn - 1)
        axis.contourf(x, y, amplification(stages, z), [0, 1], colors=["#56B4E9"])
        axis.contour(x, y, rk4, [1], colors=["#D55E00"])
        axis.plot(circle.real, circle.imag, color="black", linewidth=1)
        axis.plot([], [], color="#D55E00", label="rk4")
        axis.plot([], [], color="#56B4E9", linewidth=8, label=f"rkc2, {stages} stages")
        axis.plot([], [], color="black", linewidth=1, label=f"modes of c = tau k, h = {radius} tau")
        axis.set(ylabel="imaginary part of z", aspect="equal")
        axis.legend(loc="upper left", ncols=3, fontsize=8, frameon=False)
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_ylim(-8, 12)
    axes[-1].set_xlabel("real part of z = lambda h")
    folder = Path(__file__).parent.parent / "docs" / "images"
    figure.savefig(folder / "rkc2_region.png", dpi=120)


if __name__ == "__main__":
    main()
