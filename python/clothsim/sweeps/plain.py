"""Values of a sweep as plain data, as a label, and as a digest."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base import check
from ..base.record import Record

_LARGEST_LISTED = 64  # entries of an array that are written out; a larger one is known by its digest


def plain(value: Any) -> Any:
    """`value` as data for JSON; equal values give equal data."""
    if isinstance(value, Record):
        return plain(value.to_dict())
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        if value.size > _LARGEST_LISTED:
            digits = _sha256(np.ascontiguousarray(value).tobytes())
            return {"shape": list(value.shape), "dtype": value.dtype.str, "sha256": digits}
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a swept value must be a number, text, sequence, array, or part of a scene, got {check.shown(value)}")


def digest(value: Any) -> str:
    """A short text that is equal for equal values alone."""
    return _sha256(json.dumps(plain(value), sort_keys=True).encode())


def _sha256(data: bytes) -> str:
    import hashlib  # loads OpenSSL, which `import clothsim` shall not wait for

    return hashlib.sha256(data).hexdigest()


def label(value: Any) -> str:
    """`value` as a short text for a coordinate."""
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, int, float)):
        return f"{value:g}" if isinstance(value, float) else str(value)
    if isinstance(value, (list, tuple)) and value:
        if all(isinstance(entry, str) for entry in value):
            return "+".join(value)
        if all(isinstance(entry, int) for entry in value):
            return "x".join(map(str, value))
        if all(isinstance(entry, (int, float)) for entry in value):
            return ",".join(f"{entry:g}" for entry in value)
    if isinstance(value, Mapping) and value:
        return ",".join(f"{key}={label(entry)}" for key, entry in value.items())
    text = json.dumps(plain(value))
    return text if len(text) <= 24 else f"{type(value).__name__} {digest(value)[:8]}"


def differences(theirs: Any, mine: Any, path: str = "") -> list[str]:
    """The differences of two plain values, as "path: theirs, mine" texts."""
    if isinstance(theirs, Mapping) and isinstance(mine, Mapping):
        found = []
        for key in dict.fromkeys([*theirs, *mine]):
            there = f"{path}.{key}" if path else str(key)
            if key not in mine or key not in theirs:
                has = "store" if key in theirs else "call"
                found.append(f"{there} (only in the {has})")
            else:
                found += differences(theirs[key], mine[key], there)
        return found
    if isinstance(theirs, list) and isinstance(mine, list) and len(theirs) == len(mine):
        pairs = zip(theirs, mine, strict=True)
        return [d for k, (a, b) in enumerate(pairs) for d in differences(a, b, f"{path}[{k}]")]
    if theirs == mine and isinstance(theirs, bool) == isinstance(mine, bool):
        return []
    return [f"{path} ({_short(theirs)} in the store, {_short(mine)} given)"]


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
