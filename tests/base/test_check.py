"""Checks of arguments."""

import sys
import types

import numpy as np
from clothsim.base import check


def test_arrays_are_checked_while_another_thread_imports_numpy_ma(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpy.ma", types.ModuleType("numpy.ma"))  # as it is at the start of its import
    assert check.array("x", np.arange(3), (3,)).tolist() == [0.0, 1.0, 2.0]
