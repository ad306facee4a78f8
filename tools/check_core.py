"""Check that the folders of cpp/ include one another one way only.

Usage: python tools/check_core.py
"""

import re
import sys
from pathlib import Path

CORE = Path(__file__).parent.parent / "cpp"
# Each folder may include the folders of its own entry and itself.
BELOW = {"model": set[str]()}
for room, *rooms_below in (
    ("lanes", "model"),
    ("forces", "lanes", "model"),
    ("kernels", "forces", "lanes", "model"),
    ("memory", "kernels", "forces", "lanes", "model"),
    ("measure", "memory"),
    ("responses", "measure"),
    ("integrators", "memory"),
    ("engines", "integrators", "responses"),
    ("driver", "engines"),
    ("picture", "memory"),
):
    BELOW[room] = set(rooms_below).union(*(BELOW[below] for below in rooms_below))
# The reference takes the threads alone from memory: it shares no arithmetic with what it judges.
BELOW["reference"] = {"memory", "model"}
BELOW["bindings"] = set(BELOW)


def upward(core: Path) -> list[str]:
    """Includes of `core` that lead to a folder which may not be included from there."""
    problems = []
    for path in sorted(core.rglob("*.[ch]pp")):
        room = path.relative_to(core).parts[0]
        for number, line in enumerate(path.read_text().splitlines(), 1):
            match = re.match(r'\s*#\s*include\s+"(\w+)/', line)
            if match and match[1] != room and match[1] not in BELOW[room]:
                problems.append(
                    f"cpp/{path.relative_to(core)}:{number}: {room} may not include "
                    f"{match[1]}: {line.strip()}"
                )
            if room != "bindings" and re.match(r"\s*#\s*include\s+<(pybind11/|Python\.h)", line):
                problems.append(
                    f"cpp/{path.relative_to(core)}:{number}: only bindings may include "
                    f"Python: {line.strip()}"
                )
    return problems


if __name__ == "__main__":
    problems = upward(CORE)
    print(
        "\n".join(problems) or f"{len(list(CORE.rglob('*.[ch]pp')))} files of cpp/ include one way"
    )
    sys.exit(bool(problems))
