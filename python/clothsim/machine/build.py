"""The build of this package, and its settings on this machine."""

from __future__ import annotations

import platform
from typing import Any

import numpy as np

from .. import _core
from ..base.threads import available_threads


def build_config() -> dict[str, Any]:
    """The build of clothsim, and its settings on this machine.

    Returns
    -------
    dict
        "version", "compiler", "build_type", "flags", "kernel_flags" (per instruction set),
        "instruction_sets_built", "instruction_sets_supported" (of this processor),
        "instruction_set" (the one used; the environment variable CLOTHSIM_ISA overrides it),
        "threads" (available to this process), "eigen", "xsimd", "python" and "numpy" (versions).

    Raises
    ------
    ValueError
        If CLOTHSIM_ISA names an instruction set that is not built or not supported.

    Examples
    --------
    >>> import clothsim as cs
    >>> config = cs.build_config()
    >>> config["instruction_set"] in config["instruction_sets_supported"]
    True
    """
    return {
        **_core.build_facts(),
        "instruction_set": _core.choose_instruction_set(""),
        "threads": available_threads(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
