"""The core's folders, and the one list of springs: what a change reaches, or breaks aloud."""

import re

import numpy as np
import pytest
from clothsim import _core
from clothsim.gpu.shader import springs_wgsl


def written_springs(text, rows, columns, x, y):
    """Return (index of the neighbour, family, kind) of the springs of a mass point.

    They are in the order in which the shader's text adds them.
    """
    names = {"rows": rows, "columns": columns, "id_x": x, "id_y": y, "at": y * columns + x}

    def value(wgsl):
        for old, new in (("&&", "and"), ("id.", "id_"), ("constants.", "")):
            wgsl = wgsl.replace(old, new)
        return eval(re.sub(r"(\d)u\b", r"\1", wgsl), {}, names)

    springs_in_order = []
    family = None
    for line in text.splitlines():
        if block := re.fullmatch(r"    if \((\w+)\) \{", line):
            family = block[1]
        elif pull := re.fullmatch(
            r" +if \((.+)\) \{ a = add_spring\(a, x, v, (.+), first \+ (\d+)u\); \}", line
        ):
            condition, place, first = map(value, pull.groups())
            springs_in_order += [(place, family, first // 3)] if condition else []
    return springs_in_order


@pytest.mark.parametrize("more", [False, True])
def test_the_shader_follows_the_list_of_springs(more):
    """Each mass point of a cloth, its neighbours in order: those of the core, or of a list with a
    further family.
    """
    neighbours = list(_core.neighbours)
    kinds = len(_core.spring_kinds)
    if more:
        neighbours += [(down, 3 * right, "skew", kinds) for down in (1, -1) for right in (1, -1)]
    text = springs_wgsl(neighbours)
    rows = 4
    columns = 5
    for y, x in np.ndindex(rows, columns):
        ends = [(y + row, x + column, family, kind) for row, column, family, kind in neighbours]
        springs_of_point = [
            (r * columns + c, f, k) for r, c, f, k in ends if 0 <= r < rows and 0 <= c < columns
        ]
        assert written_springs(text, rows, columns, x, y) == springs_of_point
    assert f"first + {3 * (kinds + more - 1)}u" in text
    assert ("override skew: bool = true;" in text) == more
