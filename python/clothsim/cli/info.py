"""`clothsim info`: how this installation was built and what it runs on."""

from __future__ import annotations

import argparse
from typing import Any

import clothsim as cs

from ._common import add_command, as_json, as_text


def add_parser(subparsers: Any) -> None:
    add_command(
        subparsers, "info", run, "Print version, compiler, instruction sets, threads and libraries."
    )


def run(args: argparse.Namespace) -> None:
    config = dict(cs.build_config())
    print(as_json(config) if args.json else as_text(config))
