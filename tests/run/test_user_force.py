"""A user's function as a force: a part of the equation in every function that steps."""

import ctypes

import clothsim as cs
import numpy as np
import pytest
from clothsim.engine.force import types_in_signature

CLOTH = cs.Cloth((6, 7), mass=2.0, stiffness=200.0, damping=0.1)
SCENE = cs.Scene(CLOTH, force=np.full((6, 7, 3), 0.01))
START = SCENE.initial_position


def gust(t, x, v):
    """Return a smooth force of time, place and velocity."""
    assert not x.flags.writeable and not v.flags.writeable and x.shape == (6, 7, 3)
    return 0.3 * np.sin(9 * t + 3 * x) - 0.02 * v - 0.5 * (x - START)


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def c_function(function, data=None):
    """Return a LowLevelCallable that calls `function(t, x, v, f)` with arrays."""
    scipy = pytest.importorskip("scipy")
    pointer = ctypes.POINTER(ctypes.c_double)
    kinds = [ctypes.c_double, pointer, pointer, pointer, ctypes.c_int64]
    kinds += [ctypes.c_void_p] * (data is not None)

    def call(t, x, v, f, points, *more):
        arrays = [np.ctypeslib.as_array(p, (points, 3)) for p in (x, v, f)]
        function(t, *arrays, *more)

    pointer_to = ctypes.CFUNCTYPE(None, *kinds)(call)
    return scipy.LowLevelCallable(pointer_to, data)


@pytest.mark.parametrize("kernel", ["edge", "gather"])
@pytest.mark.parametrize("precision, bound", [("double", 1e-12), ("single", 1e-4)])
def test_it_is_added_to_the_acceleration(kernel, precision, bound):
    rng = np.random.default_rng(0)
    cloth = CLOTH.replace(mass=rng.uniform(0.01, 0.1, (6, 7)), drag=0.1)
    scene = SCENE.replace(cloth=cloth)
    x = START + rng.normal(0, 0.02, START.shape)
    v = rng.normal(0, 1, START.shape)
    options = {"t": 0.2, "kernel": kernel, "precision": precision}
    free = ~cloth.pinned[..., None]
    with_force, plain = (cs.acceleration(scene, x, v, force=f, **options) for f in (gust, None))
    v = v * free  # Pins have no velocity.
    x.flags.writeable = v.flags.writeable = False
    expected = gust(0.2, x, v) / cloth.mass_per_point[..., None] * free
    assert abs(with_force - plain - expected).max() < bound * abs(plain).max()


@pytest.mark.parametrize(
    "integrator, order",
    [("rk4", 4), ("velocity_verlet", 2), ("implicit_midpoint", 2), ("semi_implicit_euler", 1)],
)
def test_order(integrator, order):
    errors = cs.convergence(SCENE, 0.4, [4e-3, 2e-3, 1e-3], integrator, force=gust)
    assert errors.order == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(
    "options",
    [{"rtol": 1e-5}, {"rtol": 1e-9}, {"rtol": 1e-7, "integrator": "rk4"}, {"rtol": 1e-6, "fps": 7}],
)
def test_the_error_is_told(options):
    run = cs.simulate(SCENE, 0.6, force=gust, **options)
    solution = cs.reference(SCENE, 0.6, force=gust)
    assert float(solution.error_bound["max"][-1]) < 1e-13
    error = solution.error_of(run.x[-1])["rms"]
    assert run.report["tolerance"]["reached"]
    assert error <= 2 * run.report["error_estimate"]["rms"] <= 2 * options["rtol"]


def test_frames_change_nothing(same_bits):
    for options in ({"dt": 1e-3}, {"rtol": 1e-6}):
        plain = cs.simulate(SCENE, 0.3, force=gust, **options)
        framed = cs.simulate(SCENE, 0.3, force=gust, fps=377, **options)
        assert same_bits([plain.x[-1], plain.v[-1]], [framed.x[-1], framed.v[-1]])


@pytest.mark.parametrize(
    "integrator, bound",
    [("rk4", 1e-8), ("dopri5", 1e-11), ("velocity_verlet", 1e-4), ("semi_implicit_euler", 1e-2)],
)
def test_its_work_is_the_energy_that_it_brings(integrator, bound):
    scene = SCENE.replace(cloth=CLOTH.replace(damping=0.0))
    run = cs.simulate(scene, 0.5, dt=5e-4, integrator=integrator, force=gust)
    total = run.energy()["total"]
    work = run.report["force_work"]
    exact = cs.simulate(scene, 0.5, rtol=1e-10, force=gust).report["force_work"]
    assert abs(exact) > 0.05 and work == pytest.approx(exact, rel=bound)
    if integrator != "semi_implicit_euler":
        assert work == pytest.approx(total[-1] - total[0], rel=100 * bound)
    assert cs.simulate(scene, 0.1, dt=1e-3).report["force_work"] == 0.0


@pytest.mark.parametrize("options", [{}, {"data": ctypes.c_void_p(5)}], ids=["plain", "data"])
def test_a_c_function_is_the_same_force(options, same_bits):
    def write(t, x, v, f, *data):
        assert list(data) == [5] * len(options) and not f.any()
        f -= 0.5 * v + t

    runs = [
        cs.simulate(SCENE, 0.1, dt=1e-3, force=force)
        for force in (c_function(write, **options), lambda t, x, v: -(0.5 * v + t))
    ]
    assert same_bits([runs[0].x, runs[0].v], [runs[1].x, runs[1].v])
    assert runs[0].report["force_work"] == runs[1].report["force_work"]


def test_a_cfunc_of_numba_is_the_same_force(same_bits):
    numba = pytest.importorskip("numba")
    double, pointer = numba.types.double, numba.types.CPointer(numba.types.double)

    @numba.cfunc(numba.types.void(double, pointer, pointer, pointer, numba.types.int64))
    def against(t, x, v, f, points):
        for k in range(3 * points):
            f[k] = -0.5 * v[k]

    scenes = [SCENE, SCENE.replace(gravity=(0, -3, 0)), SCENE]
    runs = cs.simulate(scenes, 0.1, dt=1e-3, force=against, threads=2)
    expected = cs.simulate(scenes[1], 0.1, dt=1e-3, force=lambda t, x, v: -0.5 * v)
    assert same_bits([runs[1].x, runs[0].x], [expected.x, runs[2].x])


@pytest.mark.parametrize(
    "signature, good",
    [
        ("void (double, double *, double *, double *, long)", True),
        ("void(double t, const double *x, const double *v, double *f, int64_t points)", True),
        ("void (double, const double*, double const *, double *, npy_intp, void *)", True),
        ("void (double, double *, double *, double *, long long)", True),
        ("void (double, double *, double *, double *, int)", False),
        ("double (double, double *, double *, double *, long)", False),
        ("void (double, float *, double *, double *, long)", False),
        ("", False),
    ],
)
def test_signatures(signature, good):
    expected = types_in_signature("void (double, double *, double *, double *, int64_t)")
    assert (types_in_signature(signature)[:6] == expected) == good


def test_a_c_function_of_another_signature_is_refused():
    scipy = pytest.importorskip("scipy")
    wrong = scipy.LowLevelCallable(ctypes.CFUNCTYPE(None, ctypes.c_double)(lambda t: None))
    with pytest.raises(ValueError, match=r"force must have the signature .* got 'void \(double\)'"):
        cs.simulate(SCENE, 0.1, dt=1e-3, force=wrong)


def test_steppers_and_steps_take_it(same_bits):
    expected = cs.simulate(SCENE, 0.05, dt=1e-3, force=gust)
    stepper = cs.Stepper(SCENE, force=gust)
    stepper.advance(20, 1e-3)
    snapshot = stepper.snapshot()
    with pytest.raises(ValueError, match="force must be given: the stepper had one"):
        cs.Stepper.restore(snapshot)
    other = cs.Stepper.restore(snapshot, force=gust)
    other.advance(30, 1e-3)
    x, v = cs.step(SCENE, START, SCENE.initial_velocity, 1e-3, 50, force=gust)
    assert same_bits([other.x, other.v, x, v], [expected.x[-1], expected.v[-1]] * 2)
    # No later call has the function.
    x, v = cs.step(SCENE, START, SCENE.initial_velocity, 1e-3, 50)
    assert same_bits([x], [cs.simulate(SCENE, 0.05, dt=1e-3).x[-1]])
    stepper.set_scene(SCENE.replace(gravity=(0, 0, 0)))
    stepper.advance(1, 1e-3)
    assert abs(stepper.v - other.v).max() > 0


def test_a_list_of_scenes_takes_a_force_or_a_list(same_bits):
    scenes = [SCENE, SCENE.replace(gravity=(0, -3, 0))]
    batch = cs.simulate(scenes, 0.1, dt=1e-3, force=gust)
    mixed = cs.simulate(scenes, 0.1, rtol=1e-4, force=[None, gust])
    for k, scene in enumerate(scenes):
        assert batch[k] == cs.simulate(scene, 0.1, dt=1e-3, force=gust)
    assert mixed[0] == cs.simulate(SCENE, 0.1, rtol=1e-4)
    assert mixed[1] == cs.simulate(scenes[1], 0.1, rtol=1e-4, force=gust)
    with pytest.raises(ValueError, match="a list of 2 for as many scenes, got 1"):
        cs.simulate(scenes, 0.1, dt=1e-3, force=[gust])


def test_threads_change_no_bit(same_bits):
    cloth = cs.Cloth((160, 140), mass=20.0, damping=0.01)
    scene = cs.Scene(cloth, wind=cs.Wind((3, 0, 1)))
    runs = [
        cs.simulate(scene, 2e-3, dt=1e-4, threads=n, force=lambda t, x, v: -0.01 * v - t)
        for n in (1, 2)
    ]
    assert same_bits([runs[0].x, runs[0].v], [runs[1].x, runs[1].v])
    for name in ("force_work", "wind_work"):
        assert runs[0].report[name] == runs[1].report[name] != 0


def test_a_force_that_the_step_cannot_follow_is_named():
    with pytest.raises(cs.UnstableError, match="does not know the function given as force"):
        cs.simulate(SCENE, 1.0, dt=1e-3, force=lambda t, x, v: -1e6 * (x - START))
    with pytest.raises(ValueError, match="does not converge .* no derivative of `force`"):
        magnet = {"integrator": "implicit_midpoint", "force": lambda t, x, v: -1e8 * (x - START)}
        cs.simulate(SCENE, 1.0, dt=1e-2, **magnet)
    calm = cs.simulate(SCENE, 1.0, dt=1e-2, force=lambda t, x, v: -2.0 * v)
    assert calm.report["energy"]["gained"] == 0 and abs(calm.x).max() < 2


def test_an_exception_leaves_the_last_whole_step():
    calls = []

    def sensor(t, x, v):
        calls.append(t)
        if t > 0.1:
            raise KeyError("sensor")
        return 0 * x

    with pytest.raises(KeyError, match="sensor") as raised:
        cs.simulate(SCENE, 0.5, dt=1e-3, fps=50, force=sensor)
    run = raised.value.run
    good = cs.simulate(SCENE, 0.1, dt=1e-3, force=lambda t, x, v: 0 * x)
    assert run.t[-1] == pytest.approx(0.1) and abs(run.x[-1] - good.x[-1]).max() < 1e-15
    # Nobody calls the function with a state that is no longer known.
    assert len(calls) < 1000
    stepper = cs.Stepper(SCENE, force=sensor)
    with pytest.raises(KeyError):
        stepper.advance(500, 1e-3)
    assert stepper.t == pytest.approx(0.1) and np.isfinite(stepper.x).all()


def test_an_interrupt_within_it_ends_the_run():
    interrupts = iter([*[None] * 40, KeyboardInterrupt])

    def function(t, x, v):
        if next(interrupts, None):
            raise KeyboardInterrupt
        return 0 * x

    with pytest.raises(cs.RunInterrupted) as raised:
        cs.simulate(SCENE, 0.5, dt=1e-3, force=function)
    assert np.isfinite(raised.value.run.x).all()


@pytest.mark.parametrize(
    "options, error, words",
    [
        ({"force": lambda t, x, v: x[0]}, ValueError, r"force\(t, x, v\) must be .*\(6, 7, 3\)"),
        ({"force": lambda t, x, v: x * np.nan}, ValueError, "finite"),
        ({"force": 3}, TypeError, "force must be a function"),
        ({"force": gust, "backend": "gpu"}, ValueError, "backend 'gpu'"),
    ],
)
def test_refused(options, error, words):
    with pytest.raises(error, match=words):
        cs.simulate(SCENE, 0.1, **{"dt": 1e-3, **options})


def test_a_c_function_that_writes_nan_is_refused():
    def write(t, x, v, f):
        f[8, 1] = np.nan if t > 0.02 else 0.0

    with pytest.raises(
        ValueError, match=r"force must write finite .* mass point \(1, 1\) at t = 0"
    ):
        cs.simulate(SCENE, 0.1, dt=1e-3, force=c_function(write))


def test_settle_holds_its_time():
    scene = SCENE.replace(cloth=CLOTH.replace(drag=0.1))
    rest = cs.settle(scene, t=0.5, force=lambda t, x, v: (0.0, 0.0, 0.4 * t) + 0 * x)
    constant = SCENE.force + (0.0, 0.0, 0.2)
    expected = cs.settle(scene.replace(force=constant))
    assert rest.report["residual"] < 1e-6 and rms(rest.x[-1] - expected.x[-1]) < 1e-4


def test_sweeps_fits_and_derivatives_take_it():
    pytest.importorskip("xarray")
    pytest.importorskip("scipy")
    over = {"stiffness": [150.0, 200.0]}
    results = cs.sweep(SCENE, over, duration=0.2, metrics=("error",), progress=False, force=gust)
    assert (results.error < 1e-3).all() and (results.status == 1).all()
    with pytest.raises(ValueError, match="force must be given: the sweep had"):
        results.clothsim.member(stiffness=200.0)
    run = results.clothsim.member(stiffness=200.0, force=gust)
    assert run == cs.simulate(SCENE, 0.2, force=gust)
    times = np.linspace(0.05, 0.4, 8)
    noise = np.random.default_rng(0).normal(0, 1e-4, (8, 6, 7, 3))
    data = cs.simulate(SCENE, 0.4, rtol=1e-9, times=times, force=gust).x[1:] + noise
    guess = SCENE.replace(cloth=CLOTH.replace(stiffness=150.0))
    fit = cs.fit(guess, times, data, over=["stiffness"], sigma=1e-4, force=gust)
    assert abs(fit.values["stiffness"] - 200) < 4 * fit.errors["stiffness"] < 1
    slopes = cs.sensitivity(SCENE, [0.2], ["stiffness"], force=gust)
    higher = SCENE.replace(cloth=CLOTH.replace(stiffness=200.1))
    ends = [cs.reference(scene, 0.2, force=gust).x[-1] for scene in (higher, SCENE)]
    np.testing.assert_allclose(slopes.dx[0, 0], (ends[0] - ends[1]) / 0.1, atol=2e-7)
    table = cs.work_precision(SCENE, 0.1, ["rk4"], dts=[2e-3, 1e-3], windows=1, force=gust)
    assert table.rms_error[0, 1] < table.rms_error[0, 0] / 12


def test_a_run_with_a_force_goes_on_with_one(same_bits, tmp_path):
    expected = cs.simulate(SCENE, 0.4, dt=1e-3, fps=50, force=gust)
    first = cs.simulate(SCENE, 0.2, dt=1e-3, fps=50, force=gust)
    with pytest.raises(ValueError, match="force must be given"):
        cs.load_run(first.save(tmp_path / "run")).resume(0.2)
    joined = first + first.resume(0.2, force=gust)
    assert same_bits([joined.t, joined.x, joined.v], [expected.t, expected.x, expected.v])
    assert joined.report["force_work"] == pytest.approx(expected.report["force_work"], rel=1e-12)


@pytest.mark.parametrize("name, instead", [("wind", "cs.Wind"), ("air", "drag=")])
def test_other_names_for_it_are_hinted_at(name, instead):
    with pytest.raises(TypeError, match=f"unknown argument '{name}'.*{instead}"):
        cs.simulate(SCENE, 0.1, **{name: 1.0})


@pytest.mark.parametrize("response", ["ray", "penalty"])
def test_a_run_and_its_continuation_are_the_whole_run(response):
    ball = cs.Sphere(
        (0.5, -0.3, 0.5),
        0.25,
        cs.Linear((0.0, 0.5, 0.1)),
        friction=0.1,
        response=response,
        offset="edge",
    )
    scene = cs.Scene(CLOTH.replace(damping=0.1), ball)
    run, first = (cs.simulate(scene, duration, dt=5e-4, fps=50) for duration in (0.8, 0.4))
    joined = first + first.resume(0.4)
    assert joined == run and joined.resume(0.1) == run.resume(0.1)
    for name in ("steps", "force_evaluations", "first_contact", "dt", "stopped", "version"):
        assert joined.report[name] == run.report[name]
    depth = joined.report["penetration"]
    expected = run.report["penetration"]
    assert depth["points"] == expected["points"]
    assert depth["triangles"] == pytest.approx(expected["triangles"], rel=0.1)
    for name in ("impulse", "obstacle_work"):
        np.testing.assert_allclose(joined.report[name], run.report[name], rtol=1e-9)
    assert (run.report["obstacle_work"][0] > 0) == (response == "penalty")
    assert joined.report["energy"]["end"] == run.report["energy"]["end"]
    assert joined.report.keys() == run.report.keys()
    early = cs.simulate(scene, 0.02, dt=5e-4, fps=50)
    assert (early + early.resume(0.78)).report["first_contact"] == run.report["first_contact"]


def test_only_a_continuation_can_be_added():
    run = cs.simulate(SCENE, 0.1, dt=1e-3)
    for other in (run, cs.simulate(SCENE.replace(gravity=(0, 0, 0)), 0.1, dt=1e-3)):
        with pytest.raises(ValueError, match="goes on from the last frame"):
            run + other
    with pytest.raises(TypeError):
        run + 3
