"""Writes the golden rows anew: python tests/golden/make.py (a processor with AVX-512 has all of them)."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import clothsim as cs
from golden import rows
from pairwise import pairwise


def hashes():
    yield "# Hashes of final states (rows.py), made anew by: python tests/golden/make.py"
    for row in [" ".join(row) for row in pairwise(*rows.COLUMNS)] + rows.OF_THREADS:
        found = {}
        for isa in cs.build_config()["instruction_sets_supported"]:
            os.environ["CLOTHSIM_ISA"] = isa
            digest = rows.digest(row)
            assert found.setdefault(rows.key(row, isa), digest) == digest, (row, isa)
            free = rows.scene_of(row).replace(spheres=())
            assert " free " in row or rows.digest(row, scene=free) != digest, f"no contact: {row}"
        yield row + ": " + " ".join("=".join(pair) for pair in found.items())


if __name__ == "__main__":
    rows.FILE.write_text("\n".join(hashes()) + "\n")
