"""One form of JSON for output and for files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def as_json(data: Any) -> str:
    """`data` as indented JSON that every reader takes: a number that is not finite becomes null.

    NumPy arrays and scalars become lists and numbers; other objects become their text.

    Examples
    --------
    >>> print(as_json({"speed": [1.0, float("nan")]}).replace("\\n", ""))
    { "speed": [  1.0,  null ]}
    """

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {str(key): plain(one) for key, one in value.items()}
        if isinstance(value, (np.ndarray, np.generic)):
            value = value.tolist()
        if isinstance(value, (list, tuple)):
            return [plain(one) for one in value]
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        return value if value is None or isinstance(value, (bool, int)) else str(value)

    return json.dumps(plain(data), indent=1, allow_nan=False)
