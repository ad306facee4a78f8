"""Experiment 4: what is measured, where the crossover is, and the command that runs unattended."""

import csv
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clothsim.paper import gpu_report as report
from clothsim.paper.gpu_runs import GPU, SCALAR, SIMD, Measurement, Settings, Target, run, touching_scene

ROOT = Path(__file__).parents[2]


SMALL = Settings(batches=(), methods=(2,), precisions=("single",), frame_steps=5, window_frames=4)


def made(kind, size, rate, members=1, method=2):
    one = Measurement(Target(kind, kind), method, "single", size, members)
    one.setup, one.first_frames, one.rates = [0.1], [[0.2, 0.01]], [rate] * 3
    one.steps, one.asked, one.frame_steps, one.limit = [10, 10, 4], 10, 5, 1.5
    return one


def speeds(*triples):
    """Measurements of (size, CPU steps/s, GPU steps/s)."""
    return [made(kind, size, rate) for size, cpu, gpu in triples for kind, rate in ((SIMD, cpu), (GPU, gpu))]


@pytest.mark.needs_no_adapter
def test_the_crossover_is_the_size_from_which_on_the_shader_is_faster():
    def found(measurements):
        first = report.crossover(measurements, GPU, "single", 2, False)
        return first and first.size

    assert found(speeds((32, 9, 1), (64, 5, 4), (128, 2, 3), (256, 1, 3))) == 128
    assert found(speeds((32, 9, 10), (64, 5, 4), (128, 2, 3))) == 128  # not by a lucky small one
    assert found(speeds((32, 1, 2), (64, 1, 2))) == 32
    assert found(speeds((32, 9, 10), (64, 5, 4))) is None
    (line,) = report.crossovers(speeds((32, 9, 1), (128, 2, 3)))
    assert "faster than the CPU from 128 x 128 on (1.5 times there)" in line


@pytest.mark.needs_no_adapter
def test_the_gain_is_over_the_fastest_of_the_cpu():
    fast, slow, gpu = made(SIMD, 32, 40.0), made("scalar", 32, 10.0), made(GPU, 32, 20.0)
    assert report.against_cpu(gpu, [fast, slow, gpu]) == 0.5
    assert [row["times_fastest_cpu"] for row in report.rows([fast, slow, gpu])] == [1.0, 0.25, 0.5]


@pytest.mark.needs_no_adapter
def test_the_papers_cloth_has_a_limit_of_its_own_and_others_end_early():
    settings = replace(SMALL, sizes=(32, 40), runs=1, seconds=0.0, paper_seconds=60.0, first_frames=3, first_seconds=0.0)
    for m in run(settings, []):
        assert m.shortened == (m.size == 40) == (m.steps[0] < 20) and m.steps[0] >= 1
        assert len(m.first_frames[0]) == 2  # the first and, as that was over time, one more


def test_a_target_that_fails_is_left_out_by_name_and_the_rest_goes_on(device, monkeypatch):
    from clothsim.gpu import AdapterLostError
    from clothsim.paper import gpu_runs as experiment

    real, told = experiment.measure, []

    def measure(m, scene, dt, settings):
        if m.target.kind == GPU and m.size == 40 and m.rates:
            raise AdapterLostError("gone")
        return real(m, scene, dt, settings)

    monkeypatch.setattr(experiment, "measure", measure)
    settings = replace(SMALL, sizes=(40, 20), runs=3, frame_steps=2, window_frames=1, first_frames=1)
    runs = []
    measurements = run(
        settings,
        [device.adapter],
        advance=runs.append,
        left_out=lambda m, why: told.append((m.target.kind, m.size, str(why))),
    )
    assert told == [(GPU, 40, "gone")]
    assert {(m.target.kind, m.size) for m in measurements if m.size == 40} == {(SCALAR, 40), (SIMD, 40)}
    assert any(m.target.kind == GPU and m.size == 20 for m in measurements)
    assert sum(runs) == experiment.count(settings, [device.adapter])


@pytest.mark.needs_no_adapter
@pytest.mark.parametrize("size", [16, 64, 200])
def test_the_scene_is_in_contact_and_stays_well(size):
    import clothsim as cs

    scene, dt = touching_scene(size, 2)
    sphere = scene.spheres[0]
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, dt, 50)
    away = np.linalg.norm(x - sphere.center, axis=-1) - sphere.contact_radius(scene.cloth)
    assert 0.03 < (away < 1e-6).mean() < 0.12
    free, _ = cs.step(scene.replace(spheres=()), scene.initial_position, 0 * v, dt, 50)
    assert np.abs(x - free).max() > 1e-9


def test_every_target_is_measured_and_a_software_adapter_reported(device):
    settings = replace(
        SMALL, sizes=(16,), batches=(2,), batch_size=16, runs=2, seconds=0.02, first_frames=2, first_seconds=0.01
    )
    snapshots = []
    measurements = run(settings, [device.adapter], finished=lambda m: snapshots.append(len(m)))
    kinds = {m.target.kind for m in measurements}
    assert kinds == {SCALAR, SIMD, GPU} and snapshots == [len(measurements) // 2, len(measurements)]
    for m in measurements:
        assert len(m.rates) == len(m.setup) == len(m.first_frames) == 2
        assert m.rate > 0 and all(seconds > 0 for seconds in m.first_frames[0])
        assert len(m.steps) == 2 and all(1 <= n <= 20 for n in m.steps)
    assert bool(report.warnings(measurements)) == device.adapter.software


def test_the_command_runs_unattended_and_saves_a_csv(tmp_path):
    script = str(ROOT / "benchmarks" / "gpu.py")
    options = "--quick --sizes 16 --batches --method 2 --runs 1 --seconds 0.02 --name here --out"
    command = [sys.executable, script, *options.split(), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, env=os.environ)
    assert done.returncode == 0, done.stderr
    (path,) = tmp_path.glob("here_*.csv")  # one file an adapter
    with open(path, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {"scalar", "SIMD", "GPU"} == {row["target"] for row in rows}
    for row in rows:
        rate = float(row["steps_per_second"])
        assert rate > 0 and row["mass_points"] == "256"
        assert [
            float(row[name]) for name in ("us_per_step", "cloth_steps_per_second", "ns_per_point_step")
        ] == pytest.approx([1e6 / rate, rate, 1e9 / (256 * rate)])
        # Of a memory: the state fits the cache of the CPU, and an adapter may be one.
        memory = float(row["memory_bytes_per_second"])
        assert 1e8 < memory < 1e14
        assert float(row["memory_bytes_per_point_step"]) == pytest.approx(memory / (256 * rate))
    assert "Where the shader becomes faster" in done.stdout
    refused = subprocess.run([*command, "--adapter", "none such"], capture_output=True, text=True)
    assert refused.returncode == 1 and "no graphics adapter to measure" in refused.stderr
