"""Runs that go wrong: unstable states, Ctrl-C, adapters that are absent, lost or too small."""

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import clothsim as cs
import numpy as np
import pytest
from clothsim.gpu import device as devices
from clothsim.gpu.simulation import Simulation

GPU = {"backend": "gpu", "precision": "single"}
quiet = pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")


def arrays(stepper):
    return stepper.positions, stepper.velocities


def stiff(shape=(9, 20)):
    return cs.Scene(cs.Cloth(shape, damping=0.0))


def noisy_position(scene):
    noise = np.random.default_rng(2).normal(size=scene.initial_position.shape)
    return scene.initial_position + 1e-3 * noise


@quiet
def test_an_unstable_run_has_the_error_of_the_core(same_bits):
    """The speed of a point ends this run on both: it begins in contact, after which the core
    compares no energies.
    """
    ball = cs.Sphere((0.5, -0.2, 0.5), 0.21, response="ray", offset="edge")
    scene = stiff().replace(spheres=ball)
    x = noisy_position(scene)
    dt = 1.9 * cs.max_stable_dt(scene)
    errors = []
    steppers = []
    for backend in ("cpu", "gpu"):
        stepper = cs.Stepper(scene, x, t=0.5, precision="single", kernel="gather", backend=backend)
        stepper.advance(1, dt)
        with pytest.raises(cs.UnstableError) as raised:
            stepper.advance(5000, dt)
        errors.append(raised.value)
        steppers.append(stepper)
    cpu, gpu = errors
    assert 0 < gpu.step == cpu.step and gpu.point == cpu.point
    assert (gpu.time, gpu.dt, gpu.max_stable_dt) == (cpu.time, cpu.dt, cpu.max_stable_dt)
    assert np.isfinite(gpu.x).all() and np.isfinite(gpu.v).all()
    assert same_bits((gpu.x, gpu.v), arrays(steppers[1]))
    assert same_bits((gpu.x, gpu.v), (cpu.x, cpu.v))
    assert steppers[1].time == steppers[0].time


def test_a_state_that_is_not_finite_at_once_is_found():
    """No step is above the limit: only overflow makes it bad, in its first step."""
    scene = stiff()
    v = np.zeros_like(scene.initial_position)
    v[4, 7, 2] = 1e38
    with pytest.raises(cs.UnstableError) as raised:
        cs.step(scene, scene.initial_position, v, 1e-4, 500, **GPU)
    row, column = raised.value.point
    assert raised.value.step == 1 and max(abs(row - 4), abs(column - 7)) <= 8
    assert raised.value.v[4, 7, 2] == pytest.approx(1e38, rel=1e-7)


@quiet
def test_an_unstable_batch_names_its_member_and_goes_on_without_it(same_bits):
    bad = stiff()
    dt = 1.9 * cs.max_stable_dt(bad)
    soft = bad.replace(cloth=bad.cloth.replace(stiffness=1.0))
    x = noisy_position(bad)
    stepper = cs.Stepper([soft, bad], np.stack([x, x]), np.zeros((2, *x.shape)), t=0.0, **GPU)
    with pytest.raises(cs.UnstableError, match="of batch member 1") as raised:
        stepper.advance(5000, dt)
    assert raised.value.member == 1
    assert same_bits([raised.value.x], [stepper.positions[1]])
    stepper.freeze(1)
    stepper.advance(5, dt)
    single = cs.step(soft, x, 0 * x, dt, raised.value.step + 4, **GPU)
    assert (
        same_bits([stepper.positions[0]], [single[0]])
        and stepper.time == (raised.value.step + 4) * dt
    )


def test_ctrl_c_ends_a_long_advance_at_a_whole_step(same_bits):
    scene = cs.scenes.paper_swing()
    dt = 1e-4
    handler = signal.getsignal(signal.SIGINT)
    stepper = cs.Stepper(scene, **GPU)
    stepper.advance(1, dt)  # This compiles the shader.
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        stepper.advance(10**9, dt)
    timer.join()
    assert signal.getsignal(signal.SIGINT) is handler
    steps = round(stepper.time / dt)
    assert steps > 1 and stepper.time == steps * dt
    second = cs.Stepper(scene, **GPU)
    second.advance(steps, dt)
    assert same_bits(arrays(second), arrays(stepper))


def test_a_lost_adapter_is_an_error_that_asks_for_another_process(device, monkeypatch):
    lost = devices.Device(device.adapter)
    monkeypatch.setattr(devices, "open_device", lambda: lost)
    scene = cs.scenes.paper_static()
    stepper = cs.Stepper(scene, t=0.1, **GPU)
    lost.handle.destroy()
    for use in (
        lambda: stepper.advance(10, 1e-4),
        lambda: stepper.positions,
        lambda: cs.Stepper(scene, **GPU),
    ):
        with pytest.raises(
            RuntimeError, match="was lost; restart the process, and go on from a snapshot"
        ):
            use()


def test_a_forked_process_gets_an_error_that_asks_for_spawn(monkeypatch):
    scene = cs.scenes.paper_swing()
    stepper = cs.Stepper(scene, **GPU)
    monkeypatch.setattr(os, "getpid", lambda: 1)
    for use in (lambda: stepper.advance(1, 1e-4), lambda: cs.Stepper(scene, **GPU)):
        with pytest.raises(RuntimeError, match="'spawn'"):
            use()


def test_a_cloth_of_more_bytes_than_a_buffer_is_refused(device):
    cloth = cs.Cloth((1000, device.adapter.largest_buffer // (6 * 4 * 1000) + 1))
    message = (
        "too large for the graphics adapter: 1 of shape 1000 x .* "
        f"at most {device.adapter.largest_buffer:,}"
    )
    with pytest.raises(ValueError, match=message):
        Simulation([cs.Scene(cloth)], 0.0, "single")


def test_it_warns_as_the_core_does():
    sphere = cs.Sphere((0.2, -0.35, 0.2), 0.25, cs.Linear((-1.0, 1.5, -1.0)))
    for backend in ("cpu", "gpu"):
        stepper = cs.Stepper(
            cs.Scene(cs.Cloth((20, 20)), sphere), t=0.0, precision="single", backend=backend
        )
        with pytest.warns(cs.ContactWarning, match="pinned mass point .* is inside a"):
            stepper.advance(500, 4e-4)


@pytest.mark.parametrize(
    "choice, name", [("", "RTX"), ("0", "RTX"), ("2", "soft"), ("iris", "Iris Xe"), ("sof", "soft")]
)
def test_the_best_adapter_is_used_or_the_one_that_is_asked_for(choice, name, device, monkeypatch):
    def handle(name, kind):
        info = {"device": name, "adapter_type": kind, "backend_type": "Vulkan", "description": ""}
        return SimpleNamespace(info=info, features=(), limits=device.adapter.handle.limits)

    handles = [
        handle("soft", "CPU"),
        handle("Iris Xe", "IntegratedGPU"),
        handle("RTX", "DiscreteGPU"),
    ]
    wgpu = SimpleNamespace(gpu=SimpleNamespace(enumerate_adapters_sync=lambda: handles))
    monkeypatch.setattr(devices, "import_wgpu", lambda: wgpu)
    monkeypatch.setenv("CLOTHSIM_GPU_ADAPTER", choice)
    assert [adapter.name for adapter in devices.adapters()] == ["RTX", "Iris Xe", "soft"]
    assert devices.chosen_adapter().name == name


@pytest.mark.skipif(sys.platform != "linux", reason="drivers are taken away as Linux finds them")
def test_without_an_adapter_tests_skip_and_commands_report_the_reason():
    env = {k: v for k, v in os.environ.items() if k != "CLOTHSIM_TEST_GPU"}
    env |= {"VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent"}
    options = ["-rs", "-p", "no:cacheprovider"]
    command = [sys.executable, "-m", "pytest", *options, "tests/gpu/test_backend.py"]
    process = subprocess.run(
        command, cwd=Path(__file__).parents[2], env=env, capture_output=True, text=True, timeout=300
    )
    assert process.returncode == 0, process.stdout + process.stderr
    assert "backend 'gpu' found no Vulkan, Metal or Direct3D 12 adapter; install" in process.stdout
    counts = {
        word: int(n) for n, word in re.findall(r"(\d+) (passed|skipped|failed)", process.stdout)
    }
    assert counts["skipped"] >= 14 and counts["passed"] >= 4 and "failed" not in counts
