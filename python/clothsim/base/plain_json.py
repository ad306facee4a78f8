"""One form of JSON for output and for files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def as_json(data: Any) -> str:
    """`data` as indented JSON; NumPy arrays and scalars become lists and numbers."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return dict(value)
        if isinstance(value, (np.ndarray, np.generic)):
            return value.tolist()
        return str(value)

    return json.dumps(data, indent=1, default=plain)
