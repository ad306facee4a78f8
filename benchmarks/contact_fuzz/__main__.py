"""Run a fuzzer of contact and print its figures.

python benchmarks/contact_fuzz cells --count 250 --seed 7
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

from contact_fuzz import cells, crossings

# Function, and how many points times steps, or shots, in short and in full.
FUZZERS = {"crossings": (crossings, 10**6, 10**8), "cells": (cells, 100, 10_000)}


def main() -> None:
    parser = argparse.ArgumentParser(prog="contact_fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("fuzzer", choices=FUZZERS)
    parser.add_argument(
        "--count", type=int, help="points times steps, or shots (default: seconds of work)"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--full", action="store_true", help="the count that is claimed; many minutes"
    )
    args = parser.parse_args()
    run, short, full = FUZZERS[args.fuzzer]
    print(json.dumps(run(args.count or (full if args.full else short), seed=args.seed)))


if __name__ == "__main__":
    main()
