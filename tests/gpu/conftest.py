"""Every test of this folder needs wgpu and an adapter.

It is skipped with the reason where these are missing. CLOTHSIM_TEST_GPU=1, as `make test-gpu` sets
it, makes that a failure.
"""

import os
import pathlib

import pytest

# Threads of lavapipe wait for each other after every dispatch: on a busy machine one is faster.
os.environ.setdefault("LP_NUM_THREADS", "1")


def pytest_configure(config):
    config.addinivalue_line("markers", "needs_no_adapter: runs without wgpu or an adapter too")


def pytest_collection_modifyitems(items):
    from clothsim.gpu.device import open_device

    folder = pathlib.Path(__file__).parent
    needy_items = [
        item
        for item in items
        if folder in item.path.parents and not item.get_closest_marker("needs_no_adapter")
    ]
    try:
        if needy_items:
            open_device()
    except (ImportError, RuntimeError) as error:
        if os.environ.get("CLOTHSIM_TEST_GPU") == "1":
            raise pytest.UsageError(f"CLOTHSIM_TEST_GPU=1, but {error}") from error
        for item in needy_items:
            item.add_marker(pytest.mark.skip(reason=str(error)))


@pytest.fixture
def device():
    from clothsim.gpu.device import open_device

    return open_device()


@pytest.fixture
def narrow(device, monkeypatch):
    """Hide the float64 of the adapter in a test, as shaders of Metal have none."""
    from clothsim.gpu import device as devices

    narrow = devices.Device(device.adapter, float64=False)
    monkeypatch.setattr(devices, "open_device", lambda: narrow)
    return narrow


@pytest.fixture(scope="session")
def rounding():
    from gpu_probe import arithmetic

    return arithmetic()


@pytest.fixture(scope="session")
def exact(rounding):
    """Tell whether every operation that the shader relies on is correctly rounded."""
    return all(
        error == 0
        for errors in rounding.values()
        for operation, error in errors.items()
        # The shader keeps these apart.
        if operation not in ("compensation", "product and sum")
    )


@pytest.fixture
def needs_exact(device, exact):
    if not (exact and device.float64):
        pytest.skip(f"{device.adapter.name} does not round as the core does")
