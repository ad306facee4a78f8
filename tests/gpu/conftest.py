"""Every test here needs wgpu and an adapter, and is skipped with the reason where one is missing;
CLOTHSIM_TEST_GPU=1 (as `make test-gpu` sets it) makes that a failure."""

import os
import pathlib

import pytest

# lavapipe's threads wait for each other after every dispatch: on a busy machine one is faster.
os.environ.setdefault("LP_NUM_THREADS", "1")


def _why_not():
    from clothsim.gpu.device import opened

    try:
        opened()
    except (ImportError, RuntimeError) as error:
        return str(error)
    return None


_NEEDS_NONE = "needs_no_adapter"


def pytest_configure(config):
    config.addinivalue_line("markers", f"{_NEEDS_NONE}: runs without wgpu or an adapter too")


def pytest_collection_modifyitems(items):
    here = pathlib.Path(__file__).parent
    mine = [i for i in items if here in i.path.parents and not i.get_closest_marker(_NEEDS_NONE)]
    reason = _why_not() if mine else None
    if reason is None:
        return
    if os.environ.get("CLOTHSIM_TEST_GPU") == "1":
        raise pytest.UsageError(f"CLOTHSIM_TEST_GPU=1, but {reason}")
    for item in mine:
        item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture
def device():
    from clothsim.gpu.device import opened

    return opened()


@pytest.fixture
def needs_float64(device):
    if not device.float64:
        pytest.skip(f"{device.adapter.name} has no float64")


@pytest.fixture(scope="session")
def rounding():
    from gpu_probe import arithmetic

    return arithmetic()


@pytest.fixture(scope="session")
def exact(rounding):
    """Whether every operation that the shader relies on is correctly rounded."""
    return all(
        error == 0
        for found in rounding.values()
        for operation, error in found.items()
        if operation not in ("compensation", "product and sum")  # the shader keeps these apart
    )
