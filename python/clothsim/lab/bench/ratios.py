"""Ratios of speed: the core against its peers, with equal work."""

from __future__ import annotations

from collections.abc import Iterable

from .figures import FEATURE, PAPER_WORKS, Figure

PEERS = ("reference", "numpy", "numba gather", "numba strided")
COLUMNS = {peer: "x_" + peer.replace(" ", "_") for peer in PEERS}
"""The name under which a figure has its ratio to each peer."""

_OTHER_FORCES = {FEATURE + name for name in ("no damping", "point damping", "mass per point")}
"""On as many springs as the peers have, which damp them and know one mass."""


def ratios(figure: Figure, figures: Iterable[Figure]) -> dict[str, float | None]:
    """Time of each peer's step over the time of a step of the core.

    Parameters
    ----------
    figure : Figure
    figures : iterable of Figure
        All figures of the run.

    Returns
    -------
    dict
        Keys are `COLUMNS`. A ratio is the peer's least time over the figure's time. The peer has equal precision, mass
        points and springs, and its fastest number of threads. The reference has double only and stands beside both
        precisions. The peer steps an equal grid or batch. The paper's cloth, with or without spheres, is compared with
        `swing`. None where there is no such peer, and for figures of peers.
    """
    others = list(figures)
    found = {peer: [f.minimum for f in others if _alike(figure, f, peer)] for peer in PEERS}
    return {
        COLUMNS[peer]: min(times) / figure.minimum if times and figure.by not in PEERS else None
        for peer, times in found.items()
    }


def _alike(figure: Figure, other: Figure, peer: str) -> bool:
    """Whether the figure `other` of a peer is for the same work as the core's figure `figure`."""
    if other.by != peer or (other.points, other.springs) != (figure.points, figure.springs):
        return False
    if other.precision != ("double" if peer == "reference" else figure.precision):
        return False
    if figure.work in _OTHER_FORCES:
        return False
    if figure.work.startswith((*PAPER_WORKS, FEATURE)):
        return other.work.startswith("swing")  # the peers have no collision pass
    return other.work == figure.work
