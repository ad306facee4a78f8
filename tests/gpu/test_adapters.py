"""Which adapter is used, and a machine that has none."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from clothsim.gpu import device as devices

ROOT = Path(__file__).parents[2]


@pytest.fixture
def three(device, monkeypatch):
    """Three adapters in no order of theirs."""
    kinds = {"soft": "CPU", "Iris Xe": "IntegratedGPU", "RTX": "DiscreteGPU"}

    class Wgpu:
        class gpu:
            enumerate_adapters_sync = staticmethod(lambda: list(kinds))

    def described(name):
        return replace(device.adapter, name=name, kind=kinds[name])

    monkeypatch.setattr(devices, "load_wgpu", lambda: Wgpu)
    monkeypatch.setattr(devices, "_described", described)


@pytest.mark.parametrize("asked, name", [("", "RTX"), ("0", "RTX"), ("2", "soft"), ("iris", "Iris Xe"), ("sof", "soft")])
def test_the_best_is_used_or_the_one_that_is_asked_for(asked, name, three, monkeypatch):
    monkeypatch.setenv("CLOTHSIM_GPU_ADAPTER", asked)
    assert [adapter.name for adapter in devices.adapters()] == ["RTX", "Iris Xe", "soft"]
    assert devices.chosen_adapter().name == name


def run(*command):
    """A command on a machine whose Vulkan has no driver."""
    env = {k: v for k, v in os.environ.items() if k != "CLOTHSIM_TEST_GPU"}
    env |= {"VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent"}
    return subprocess.run([sys.executable, *command], cwd=ROOT, env=env, capture_output=True, text=True, timeout=300)


@pytest.mark.skipif(sys.platform != "linux", reason="drivers are taken away as Linux finds them")
def test_without_an_adapter_tests_skip_and_commands_report_the_reason():
    done = run("-m", "pytest", "-rs", "-p", "no:cacheprovider", "tests/gpu/test_backend.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "backend 'gpu' found no Vulkan, Metal or Direct3D 12 adapter; install" in done.stdout
    assert "mesa-vulkan-drivers" in done.stdout
    counts = {word: int(n) for n, word in re.findall(r"(\d+) (passed|skipped|failed)", done.stdout)}
    assert counts["skipped"] > 10 and counts["passed"] >= 6 and "failed" not in counts
    assert "none found" in run("-m", "clothsim", "info").stdout
