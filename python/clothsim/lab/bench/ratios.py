"""How many times faster the core is than its peers, like compared with like."""

from __future__ import annotations

from collections.abc import Iterable

from .figures import FEATURE, PAPER_WORKS, Figure

PEERS = ("reference", "numpy", "numba gather", "numba strided")
COLUMNS = {peer: "x_" + peer.replace(" ", "_") for peer in PEERS}
"""The name under which a figure has its ratio to each peer."""

_OTHER_FORCES = {FEATURE + name for name in ("no damping", "point damping", "mass per point")}
"""On as many springs as the peers have, which damp them and know one mass."""


def ratios(figure: Figure, figures: Iterable[Figure]) -> dict[str, float | None]:
    """How many times faster a step of the core is than one of each peer.

    Parameters
    ----------
    figure : Figure
    figures : iterable of Figure
        All figures of the run.

    Returns
    -------
    dict
        By `COLUMNS`: the peer's least time over the figure's. The peer has equal precision, mass
        points and springs, and its fastest number of threads. The reference has double only and
        stands beside both precisions. It steps the same grid or batch; for the paper's cloth, with
        spheres or without, `swing`. None where there is no such peer, and for figures of peers.
    """
    others = list(figures)
    found = {peer: [f.minimum for f in others if _alike(figure, f, peer)] for peer in PEERS}
    return {
        COLUMNS[peer]: min(times) / figure.minimum if times and figure.by not in PEERS else None
        for peer, times in found.items()
    }


def _alike(figure: Figure, other: Figure, peer: str) -> bool:
    """Whether `other` is the peer's figure of what `figure` is one of the core's."""
    if other.by != peer or (other.points, other.springs) != (figure.points, figure.springs):
        return False
    if other.precision != ("double" if peer == "reference" else figure.precision):
        return False
    if figure.work in _OTHER_FORCES:
        return False
    if figure.work.startswith((*PAPER_WORKS, FEATURE)):
        return other.work.startswith("swing")  # the peers have no collision pass
    return other.work == figure.work
