"""Writes the golden rows, figures and pictures anew: python tests/golden/make.py [bits | figures]

A processor of Intel with AVX-512 has all rows.
"""

import json
import os
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import clothsim as cs
import numpy as np
from golden import figures, rows
from pairwise import pairwise


def hashes():
    yield "# Hashes of final states (rows.py), made anew by: python tests/golden/make.py"
    for row in (
        [" ".join(row) for row in pairwise(*rows.COLUMNS)] + rows.OF_THREADS + rows.OF_LAYERS
    ):
        new_hashes = {}
        for isa in cs.build_config()["instruction_sets_supported"]:
            os.environ["CLOTHSIM_ISA"] = isa
            digest = rows.digest(row)
            assert new_hashes.setdefault(rows.key(row, isa), digest) == digest, (row, isa)
            free = rows.scene_of(row).replace(spheres=())
            assert " free " in row or rows.digest(row, scene=free) != digest, f"no contact: {row}"
        old_hashes = rows.golden().get(row, {})
        if all(old_hashes.get(key, digest) == digest for key, digest in new_hashes.items()):
            new_hashes = {**old_hashes, **new_hashes}  # hashes of other vendors' processors stay
        yield row + ": " + " ".join("=".join(pair) for pair in new_hashes.items())
    del os.environ["CLOTHSIM_ISA"]


def make_figures():
    figures.references.cache_clear()
    solutions = {
        row: figures.solution(*row.split()[3:])
        for row in figures.ROWS
        if row.startswith("error_control")
    }
    np.savez_compressed(figures.REFERENCES, **solutions)
    lines = [f"{json.dumps(row)}: {json.dumps(figures.compute(row))}" for row in figures.ROWS]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    figures.FILE.write_text(
        re.sub(r"\d+\.\d+(e-\d+)?", lambda number: f"{float(number[0]):.7g}", text)
    )
    for name in figures.PICTURES:
        figures.picture(name).save(figures.FOLDER / f"{name}.png")


if __name__ == "__main__":
    if "figures" not in sys.argv:
        rows.FILE.write_text("\n".join(hashes()) + "\n")
    if "bits" not in sys.argv:
        make_figures()
