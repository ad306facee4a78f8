"""Threads, batches, forks and Ctrl-C; tests/engine/test_same_bits.py has every feature's bits."""

import os
import signal
import sys
import threading
import warnings

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.engine.options import Options
from commands import python
from tables import each
from variants import NAMED_KERNELS, cases, pairs

LEAST_POINTS = _core.heuristics["points_per_thread_of_step"]
TEAM = int(np.sqrt(_core.heuristics["points_of_team"]))  # side of the smallest cloth for a team
BALL = cs.Sphere((0.6, -0.2, 0.4), 0.25, friction=0.1, response="ray", offset="edge")


@each("shape", [(33, 70), (64, 5), (5, 64)])
def test_any_number_of_threads_gives_the_same_bits(variant, crumpled, same_bits, shape):
    scene, x, v, dt = crumpled(shape=shape, spheres=BALL)
    expected = cs.step(scene, x, v, dt, 15, **variant.options)
    a = cs.acceleration(scene, x, v, **variant.options)
    for threads in (2, 3, 5):
        several = cs.step(scene, x, v, dt, 15, **variant.options | {"threads": threads})
        assert same_bits(several, expected), threads
        b = cs.acceleration(scene, x, v, **variant.options | {"threads": threads})
        assert same_bits([b], [a]), threads


FEATURES = [
    {"springs": families, "damped_by": damping}
    for families in (
        ("structural", "shear", "bend"),
        ("structural", "shear"),
        ("shear", "bend"),
        ("bend",),
        ("structural",),
    )
    for damping in ("springs", "nothing")
] + [{"damped_by": "points"}, {"damped_by": "both"}]


@cases()
def test_threads_exchange_the_halo_rows_of_every_set_of_springs(variant, crumpled, same_bits):
    rows = 4 * _core.heuristics["rows_per_thread"]
    for feature in FEATURES:
        scene, x, v, dt = crumpled(shape=(rows, 32), **feature)
        expected = cs.step(scene, x, v, dt, 6, **variant.options)
        # The second of three meets a neighbour where it begins and where it ends.
        for threads in (2, 3):
            several = cs.step(scene, x, v, dt, 6, **variant.options | {"threads": threads})
            assert same_bits(several, expected), (threads, feature)


@each("members", [3, 5, 7])
def test_members_that_a_team_steps_have_the_same_bits(variant, crumpled, same_bits, members):
    scene, x, v, dt = crumpled(shape=(64, 70), spheres=BALL)
    assert x[..., 0].size >= 4 * LEAST_POINTS
    xs, vs = np.stack([x + 0.01 * k for k in range(members)]), np.stack([v] * members)
    expected = cs.step(scene, xs, vs, dt, 15, **variant.options)
    for threads in (2, 4):
        several = cs.step(scene, xs, vs, dt, 15, **variant.options | {"threads": threads})
        assert same_bits(several, expected), threads


def test_an_unstable_member_that_a_team_steps_is_named(crumpled):
    scene, x, v, dt = crumpled(shape=(64, 70))
    vs = np.stack([v, v, v])
    vs[2, 20, 30] = 1e200  # its springs overflow
    for threads in (1, 2, 4):
        with pytest.raises(cs.UnstableError) as caught:
            cs.step(scene, np.stack([x] * 3), vs, dt, 15, threads=threads)
        assert (caught.value.member, caught.value.step) == (2, 1), threads


@each(
    "available, shape, members, threads",
    [
        (16, (32, 32), 1, 1),
        (16, (TEAM - 1, TEAM + 1), 1, 1),
        (16, (TEAM, TEAM), 1, 16),
        (64, (TEAM, TEAM), 1, TEAM**2 // LEAST_POINTS),
        (16, (TEAM, TEAM), 3, 16),
        (64, (TEAM, TEAM), 40, 40),
        (16, (32, 32), 3, 3),
        (2, (32, 32), 3, 2),
        (400, (32, 32), 300, 256),
    ],
)
def test_without_a_number_the_size_decides(monkeypatch, available, shape, members, threads):
    monkeypatch.setattr("clothsim.engine.options.available_thread_count", lambda: available)
    assert Options().thread_count_for(shape, members) == threads
    assert Options(threads=5).thread_count_for(shape, members) == 5


_SETTINGS = """
import os
import clothsim as cs

stepper = cs.Stepper(cs.scenes.paper_swing(), threads=3)
stepper.advance(5, 1e-4)
report = cs.simulate(cs.scenes.paper_swing(), 0.001, 1e-4, threads=3).report
print(cs.build_config()["threads"], report["threads"], len(os.listdir("/proc/self/task")))
"""


@pytest.mark.unsanitized("thread", reason="TSan has a thread of its own in the process")
@pytest.mark.skipif(sys.platform != "linux", reason="counts threads in /proc")
@each(
    "settings, available, threads",
    [
        ({"OMP_NUM_THREADS": "1,2"}, 1, 3),
        ({"OMP_NUM_THREADS": "many"}, None, 3),
        ({"OMP_PROC_BIND": "true"}, None, 3),  # this binds the caller to one processor
        ({"OMP_DYNAMIC": "true"}, None, 3),
        ({"OMP_THREAD_LIMIT": "2"}, None, 2),
    ],
)
def test_settings_of_openmp_mean_what_openmp_says(settings, available, threads):
    variables = {"OPENBLAS_NUM_THREADS": "1"}
    expected = [available or len(os.sched_getaffinity(0)), threads, threads]
    quiet = "import warnings; warnings.simplefilter('ignore')\n"
    run = python(quiet + _SETTINGS, **settings, **variables)
    assert [*map(int, run.stdout.split())] == expected, run.stderr


def test_more_threads_than_processors_warn_once(monkeypatch):
    monkeypatch.setattr("clothsim.engine.options.processor_count", lambda: 2)
    monkeypatch.setattr("clothsim.engine.options._past_warnings", set())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for threads in (2, 3, 8):
            cs.Stepper(cs.scenes.oscillator(), threads=threads)
    assert [str(warning.message)[:60] for warning in caught] == [
        "threads = 3 is above the 2 processors that this process may "
    ]


def test_a_batch_of_scenes_is_each_scene_bit_for_bit(variant, crumpled, same_bits):
    scenes, xs, vs, steps = [], [], [], []
    features = [{}, {"springs": ("structural",)}, {"damped_by": "points"}, {"mass": "uniform"}]
    for k, feature in enumerate(features):
        scene, x, v, dt = crumpled(seed=k, spheres=BALL if k % 2 else (), **feature)
        scenes.append(scene), xs.append(x), vs.append(v), steps.append(dt)
    dt = min(steps)
    batch = cs.step(scenes, np.stack(xs), np.stack(vs), dt, 15, **variant.options)
    for k, member in enumerate(zip(scenes, xs, vs)):
        single = cs.step(*member, dt, 15, **variant.options)
        assert same_bits([part[k] for part in batch], single), features[k]
    a = cs.acceleration(scenes, np.stack(xs), np.stack(vs), **variant.options)
    for k, member in enumerate(zip(scenes, xs, vs)):
        assert same_bits([a[k]], [cs.acceleration(*member, **variant.options)])


_FORK = """
import os, signal
import numpy as np
import clothsim as cs

scene = cs.scenes.paper_swing()
state = scene.initial_position, scene.initial_velocity
expected = cs.step(scene, *state, 1e-4, 20, threads=2, kernel="{kernel}")
for n in range(30):
    cs.step(scene, *state, 1e-4, 5, threads=2, kernel="{kernel}")
    pid = os.fork()
    if pid == 0:
        signal.alarm(20)  # a child that hangs dies of it
        x, v = cs.step(scene, *state, 1e-4, 20, threads=2, kernel="{kernel}")
        os._exit(0 if (x == expected[0]).all() and (v == expected[1]).all() else 1)
    _, status = os.waitpid(pid, 0)
    assert status == 0, (n, status)
print("30 forks")
"""


@pytest.mark.unsanitized("thread", reason="TSan starts no thread after a fork of several threads")
def test_a_forked_child_steps_after_its_parent_used_threads(kernel):
    run = python(_FORK.format(kernel=kernel))
    assert run.stdout == "30 forks\n", run.stderr


@pairs(kernel=NAMED_KERNELS, shape=[(32, 32), (200, 200)], threads=[1, 2])
def test_ctrl_c_ends_a_long_advance_at_a_whole_step(kernel, same_bits, shape, threads):
    scene = cs.Scene(cs.Cloth(shape))
    dt = 0.5 * cs.max_stable_dt(scene)
    stepper, uncut = (cs.Stepper(scene, threads=n, kernel=kernel) for n in (threads, 1))
    with pytest.raises(KeyboardInterrupt):
        timer = threading.Timer(0.15, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        stepper.advance(10**6, dt)
    timer.join()
    steps = round(stepper.time / dt)
    uncut.advance(steps, dt)
    assert stepper.time == uncut.time
    assert same_bits((uncut.positions, uncut.velocities), (stepper.positions, stepper.velocities))


def test_ctrl_c_leaves_the_arrays_of_step_as_they_were(crumpled):
    scene, x, v, dt = crumpled()
    out = np.full_like(x, 7.0), np.full_like(v, 8.0)
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        cs.step(scene, x, v, dt, 10**7, out=out)
    timer.join()
    assert (out[0] == 7.0).all() and (out[1] == 8.0).all()
