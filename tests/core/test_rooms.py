"""The folders of the core, and the one list of springs: what a change of them reaches, or breaks aloud."""

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from clothsim import _core
from clothsim.gpu.shader import springs
from clothsim.model.cloth import FAMILIES, Cloth

ROOT = Path(__file__).parents[2]
CORE = ROOT / "cpp"
COMPILER = shutil.which("g++") or shutil.which("clang++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")


def check_core():
    spec = importlib.util.spec_from_file_location("check_core", ROOT / "tools" / "check_core.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_folders_of_the_core_include_one_way(tmp_path):
    tool = check_core()
    assert tool.upward(CORE) == []
    core = shutil.copytree(CORE, tmp_path / "cpp")
    planted = {
        "kernels/lanes.hpp": '#include "memory/plan.hpp"',
        "reference/contact.hpp": '#include "contact/exact.hpp"',
        "memory/plan.hpp": "#include <pybind11/numpy.h>",
    }
    for name, line in planted.items():
        path = core / name
        path.write_text(line + "\n" + path.read_text())
    found = tool.upward(core)
    assert len(found) == len(planted)
    assert all(any(problem.startswith(f"cpp/{name}:1:") for problem in found) for name in planted)


def compiled(core, source, tmp_path):
    """Errors of `source`, a file of `core` or a program, and what the program prints."""
    path = core / source if isinstance(source, Path) else tmp_path / "program.cpp"
    if not isinstance(source, Path):
        path.write_text(source)
    program = tmp_path / "program"
    action = ["-fsyntax-only"] if isinstance(source, Path) else ["-o", str(program)]
    run = subprocess.run(
        [COMPILER, "-std=c++20", "-I", str(core), *action, "-x", "c++", str(path)], capture_output=True, text=True
    )
    if run.returncode or isinstance(source, Path):
        return run.stderr if run.returncode else ""
    return subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout


PROGRAM = """
#include <cstdio>
#include "kernels/gather/gather_arguments.hpp"
#include "model/cloth.hpp"
int main() {
    using namespace clothsim;
    for (const MirroredNeighbour& n : neighbours)
        std::printf("%d,%d,%s,%d ", n.row, n.column, family_names[n.family], int(n.kind));
    Cloth cloth;
    cloth.rows = 7;
    cloth.columns = 5;
    cloth.present.fill(true);
    int springs = 0;
    cloth.each_spring([&](int, int, const Neighbour&) { ++springs; });
    std::printf("| %d %d %d", springs, stencil_reach, int(sizeof(LanesWithNeighbour) / 2));
}
"""


def with_a_further_family(tmp_path):
    """A copy of the core with springs to the points three columns and one row on."""
    core = shutil.copytree(CORE, tmp_path / "more")
    stencil = core / "model" / "stencil.hpp"
    text = stencil.read_text()
    for old, new in (
        (r"(enum Family : int \{[^}]*?),?(\s*\};)", r"\1, skew\2"),
        (r"(family_names\{[^}]*)\}", r'\1, "skew"}'),
        (r"(enum SpringKind : int \{[^}]*?),?(\s*\};)", r"\1, to_skew\2"),
        (r"(spring_kinds\{\s*\{[^;]*)\}\};", r"\1, {1, 3, skew}}};"),
        (r"(?<=family_count = )\d+", lambda count: str(int(count[0]) + 1)),
        (r"(?<=spring_kind_count = )\d+", lambda count: str(int(count[0]) + 1)),
    ):
        text, count = re.subn(old, new, text)
        assert count == 1, old
    stencil.write_text(text)
    return core


@needs_compiler
def test_the_gather_kernel_and_the_measures_follow_the_list_of_springs(tmp_path):
    before, sizes = compiled(CORE, PROGRAM, tmp_path).split("| ")
    assert before.split() == [
        *("0,1,structural,0", "0,-1,structural,0", "1,0,structural,1", "-1,0,structural,1"),
        *("1,1,shear,2", "1,-1,shear,2", "-1,1,shear,2", "-1,-1,shear,2"),
        *("0,2,bend,3", "0,-2,bend,3", "2,0,bend,4", "-2,0,bend,4"),
    ]  # the order is part of the strict class
    assert [int(n) for n in sizes.split()] == [7 * 4 + 6 * 5 + 2 * 6 * 4 + 7 * 3 + 5 * 5, 2, 4]
    after, sizes = compiled(with_a_further_family(tmp_path), PROGRAM, tmp_path).split("| ")
    assert after == before + "1,3,skew,5 1,-3,skew,5 -1,3,skew,5 -1,-3,skew,5 "
    assert [int(n) for n in sizes.split()] == [152 + 2 * 6 * 2, 3, 6]


@needs_compiler
@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("kernels/edge/edge_legs.hpp", "a spring without a leg here"),
        ("measure/mode_bounds.cpp", "largest_symbol knows"),
        ("reference/springs.cpp", "a list of springs of its own"),
    ],
)
def test_a_new_spring_family_does_not_compile_until_every_table_has_it(tmp_path, source, says):
    assert compiled(CORE, Path(source), tmp_path) == ""
    errors = compiled(with_a_further_family(tmp_path), Path(source), tmp_path)
    assert re.search(rf"static assertion failed:.*{says}", errors), errors


def written_springs(text, rows, columns, x, y):
    """(index of the neighbour, family, kind) in the order in which the shader's text adds springs at a mass point."""
    names = {"rows": rows, "columns": columns, "id_x": x, "id_y": y, "at": y * columns + x}

    def value(wgsl):
        for old, new in (("&&", "and"), ("id.", "id_"), ("constants.", "")):
            wgsl = wgsl.replace(old, new)
        return eval(re.sub(r"(\d)u\b", r"\1", wgsl), {}, names)

    found, family = [], None
    for line in text.splitlines():
        if opened := re.fullmatch(r"    if \((\w+)\) \{", line):
            family = opened[1]
        elif pull := re.fullmatch(r" +if \((.+)\) \{ a = pulled\(a, x, v, (.+), first \+ (\d+)u\); \}", line):
            condition, place, first = map(value, pull.groups())
            found += [(place, family, first // 3)] if condition else []
    return found


@pytest.mark.parametrize("more", [False, True])
def test_the_shader_follows_the_list_of_springs(more):
    """Each mass point of a cloth, its neighbours in order: those of the core, or of a list with a further family."""
    neighbours, kinds = list(_core.neighbours), len(_core.spring_kinds)
    if more:
        neighbours += [(down, 3 * right, "skew", kinds) for down in (1, -1) for right in (1, -1)]
    text, rows, columns = springs(neighbours), 4, 5
    for y, x in np.ndindex(rows, columns):
        ends = [(y + row, x + column, family, kind) for row, column, family, kind in neighbours]
        inside = [(r * columns + c, f, k) for r, c, f, k in ends if 0 <= r < rows and 0 <= c < columns]
        assert written_springs(text, rows, columns, x, y) == inside
    assert f"first + {3 * (kinds + more - 1)}u" in text
    assert ("override skew: bool = true;" in text) == more


def test_python_has_the_springs_of_the_core():
    """The table from which the reference solution is made is written out in Python: it must be the core's list."""
    kinds = _core.spring_kinds
    assert tuple(dict.fromkeys(family for family, *_ in kinds)) == FAMILIES
    cloth = Cloth(shape=(6, 5), springs=FAMILIES)
    found = set()
    for spring in cloth.spring_table():
        (row, column), (other_row, other_column) = (divmod(int(spring[end]), 5) for end in ("i", "j"))
        found.add((str(spring["family"]), abs(other_row - row), abs(other_column - column)))
    assert found == set(kinds)
