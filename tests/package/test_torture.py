"""Kills, Ctrl-C, and calls from several threads at random, for `make torture`."""

import os
import random
import signal
import threading
import time
import warnings

import clothsim as cs
import numpy as np
import pytest

ROUNDS = int(os.environ.get("CLOTHSIM_TEST_ROUNDS", "1"))
SEED = int(os.environ.get("CLOTHSIM_TEST_SEED", "0"))

pytestmark = pytest.mark.torture

BALL = cs.Sphere((0.6, -0.2, 0.4), 0.25, friction=0.1)


def test_a_kill_at_any_moment_leaves_a_whole_file_or_the_old_one(tmp_path):
    rng, path = random.Random(SEED), tmp_path / "run.npz"
    runs = [cs.simulate(cs.scenes.hanging(), seconds, dt=1e-3, every=1) for seconds in (0.01, 0.02)]
    runs[0].save(path)
    for _ in range(10 * ROUNDS):
        child = os.fork()
        if child == 0:
            while True:
                for run in runs:
                    run.save(path)
        time.sleep(rng.uniform(0, 0.03))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert cs.load_run(path) in runs, f"seed {SEED}"
    left = {file.name for file in tmp_path.iterdir()} - {"run.npz"}
    assert all(name.startswith(".clothsim-") for name in left)


def test_ctrl_c_at_any_moment_leaves_a_whole_step():
    """A state that was interrupted at random has the bits of one that was left alone."""
    rng = random.Random(SEED)
    for _ in range(3 * ROUNDS):
        shape = rng.choice([(9, 7), (64, 64), (120, 130)])
        ball = cs.Sphere(
            (0.5, -0.26, 0.5), 0.25, response="ray", offset=rng.choice(["none", "cell"])
        )
        cloth = cs.Cloth(shape, mass=1.0, stiffness=10.0, damping=0.0, pins=())
        scene = cs.Scene(
            cloth,
            rng.choice([(), (BALL.replace(center=(0.6, -0.27, 0.4)),), (ball,)]),
            velocity=np.full((*shape, 3), (0, -3.0, 0)),
        )
        scenes = [scene] * rng.choice([1, 1, 3, 40])
        dt = 0.4 * cs.max_stable_dt(scene)
        stepper, whole = (
            cs.Stepper(scenes, threads=threads) for threads in (rng.choice([1, 2]), 1)
        )
        for _ in range(rng.randrange(3)):
            stepper.advance(1, dt)
        for _ in range(3):
            timer = threading.Timer(rng.uniform(0, 0.1), os.kill, (os.getpid(), signal.SIGINT))
            with pytest.raises(KeyboardInterrupt):
                timer.start()
                stepper.advance(100_000, dt)
            timer.join()
        steps = round(stepper.time / dt)
        whole.advance(steps, dt)
        assert whole.time == stepper.time and np.array_equal(whole.positions, stepper.positions), (
            f"seed {SEED}"
        )
        assert np.array_equal(whole.velocities, stepper.velocities), f"seed {SEED}"


def _work(seed):
    """Make calls at random, of a scene at random, and return all arrays that they give."""
    rng = random.Random(seed)
    shape = rng.choice([(2, 2), (9, 7), (32, 32), (40, 33)])
    kernel, precision = rng.choice(["edge", "gather"]), rng.choice(["double", "single"])
    scene = cs.Scene(cs.Cloth(shape), rng.choice([(), (BALL,)]))
    dt = 0.3 * cs.max_stable_dt(scene)
    options = {"kernel": kernel, "precision": precision, "threads": rng.choice([None, 1, 2, 3])}
    stepper, found = cs.Stepper(scene, **options), []
    for _ in range(30):
        call = rng.randrange(5)
        if call == 0:
            stepper.advance(rng.randrange(20), dt)
        elif call == 1:
            stepper = cs.Stepper.restore(stepper.snapshot())
        elif call == 2:
            x, v = cs.step(
                scene,
                stepper.positions,
                stepper.velocities,
                dt,
                rng.randrange(1, 9),
                t=0.0,
                **options,
            )
            stepper.set_state(x, v, 0.0)
        elif call == 3:
            found.append(
                cs.acceleration(scene, stepper.positions, stepper.velocities, precision=precision)
            )
        else:
            stepper.set_scene(scene.replace(gravity=(0.0, -rng.uniform(5, 15), 0.0)))
        found += [stepper.positions, stepper.velocities]
    return found


def test_calls_from_several_threads_give_the_bits_of_one():
    for first in range(SEED, SEED + 4 * ROUNDS, 4):
        seeds, together = range(first, first + 4), {}

        def work(seed, together=together):
            together[seed] = _work(seed)

        workers = [threading.Thread(target=work, args=(seed,)) for seed in seeds]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for worker in workers:
                worker.start()
            for worker in workers:
                worker.join()
            for seed in seeds:
                for one, other in zip(_work(seed), together[seed], strict=True):
                    assert np.array_equal(one, other, equal_nan=True), f"seed {seed}"
