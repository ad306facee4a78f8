"""The core's folders, and the one list of springs: what a change reaches, or breaks aloud."""

import re

import numpy as np
import pytest
from clothsim import _core
from clothsim.gpu.shader import springs


def written_springs(text, rows, columns, x, y):
    """(index of the neighbour, family, kind) in the order in which the shader's text adds springs
    at a mass point.
    """
    names = {"rows": rows, "columns": columns, "id_x": x, "id_y": y, "at": y * columns + x}

    def value(wgsl):
        for old, new in (("&&", "and"), ("id.", "id_"), ("constants.", "")):
            wgsl = wgsl.replace(old, new)
        return eval(re.sub(r"(\d)u\b", r"\1", wgsl), {}, names)

    found, family = [], None
    for line in text.splitlines():
        if opened := re.fullmatch(r"    if \((\w+)\) \{", line):
            family = opened[1]
        elif pull := re.fullmatch(
            r" +if \((.+)\) \{ a = add_spring\(a, x, v, (.+), first \+ (\d+)u\); \}", line
        ):
            condition, place, first = map(value, pull.groups())
            found += [(place, family, first // 3)] if condition else []
    return found


@pytest.mark.parametrize("more", [False, True])
def test_the_shader_follows_the_list_of_springs(more):
    """Each mass point of a cloth, its neighbours in order: those of the core, or of a list with a
    further family.
    """
    neighbours, kinds = list(_core.neighbours), len(_core.spring_kinds)
    if more:
        neighbours += [(down, 3 * right, "skew", kinds) for down in (1, -1) for right in (1, -1)]
    text, rows, columns = springs(neighbours), 4, 5
    for y, x in np.ndindex(rows, columns):
        ends = [(y + row, x + column, family, kind) for row, column, family, kind in neighbours]
        inside = [
            (r * columns + c, f, k) for r, c, f, k in ends if 0 <= r < rows and 0 <= c < columns
        ]
        assert written_springs(text, rows, columns, x, y) == inside
    assert f"first + {3 * (kinds + more - 1)}u" in text
    assert ("override skew: bool = true;" in text) == more
