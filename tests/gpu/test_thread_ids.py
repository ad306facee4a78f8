"""The shader's own ids are those of `thread_grid`, which the core's kernels walk."""

import clothsim as cs
import numpy as np
import pytest
from gpu_probe import thread_ids


@pytest.mark.parametrize(
    "shape", [(32, 32), (16, 48), (128, 64), (1, 2), (2, 2), (17, 16), (16, 17), (20, 33), (5, 100)], ids=str
)
def test_every_point_has_the_same_ids_on_the_adapter_and_in_the_core(shape):
    written, expected = thread_ids(shape), cs.thread_grid(shape)
    assert written.dtype == expected.dtype and written.shape == shape
    for name in expected.dtype.names:
        np.testing.assert_array_equal(written[name], expected[name], err_msg=name)
    assert sorted(written["index"].ravel()) == list(range(shape[0] * shape[1]))
