"""Readers of any colour vision: simulated colours, their distances, and lines of figures that must
differ.

The deficiencies are simulated by the matrices of severity 1.0 of Machado, Oliveira and Fernandes,
"A physiologically-based model for simulation of color vision deficiency", IEEE Transactions on
Visualization and Computer Graphics 15 (6), 2009, for linear RGB. Distances are Euclidean in CIELAB
(D65).
"""

from itertools import combinations

import numpy as np
from matplotlib.colors import to_rgb

LEAST = 15.0
SEEN_BY = {
    "full colour vision": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
WHITE = TO_XYZ.sum(axis=1)


def lab(linear):
    f = TO_XYZ @ linear / WHITE
    f = np.where(f > (6 / 29) ** 3, np.cbrt(f), f / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(a, b):
    """Return the least distance of two colours over all readers."""
    rgb = np.array([to_rgb(color) for color in (a, b)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    pairs = [
        [lab(np.clip(np.array(matrix) @ color, 0, 1)) for color in linear]
        for matrix in SEEN_BY.values()
    ]
    return min(np.linalg.norm(color - neighbour) for color, neighbour in pairs)


def look(line):
    face = to_rgb(line.get_markerfacecolor())
    return line.get_marker(), str(line._unscaled_dash_pattern), face, line.get_linewidth()


def check_lines(axes):
    lines = [
        line
        for line in axes.get_lines()
        if not line.get_label().startswith("_") and len(line.get_xdata())
    ]
    for a, b in combinations(lines, 2):
        names = a.get_label(), b.get_label()
        if a.get_color() == b.get_color():
            assert look(a) != look(b), names
        else:
            assert distance(a.get_color(), b.get_color()) >= LEAST, names
    return lines
