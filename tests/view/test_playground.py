"""The live viewer without a browser: a scene that is stepped by the clock while it is changed."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.playground import DRAG_SPEED, Playground


def level(**sphere):
    """A level cloth without weight, and a sphere below its middle."""
    cloth = cs.Cloth((9, 9), mass=1.0, stiffness=200.0, damping=0.2)
    return cs.Scene(
        cloth, cs.Sphere((0.5, -0.5, 0.5), 0.2, **{"response": "ray", "offset": "edge", **sphere}), gravity=(0, 0, 0)
    )


def run_for(playground, seconds, tick=0.02):
    for _ in range(round(seconds / tick)):
        playground.tick(tick)


def test_ticks_follow_the_clock_and_lose_no_part_of_a_step():
    playground = Playground(level(), dt=3e-4)
    for _ in range(100):
        playground.tick(0.01)
    assert playground.time == pytest.approx(1.0, abs=3e-4)
    assert playground.factor == pytest.approx(1.0, abs=0.05)
    assert playground.tick(60.0) * 3e-4 == pytest.approx(0.1, abs=3e-4)  # a pause is not made up for


def test_a_time_budget_ends_a_tick_and_lowers_the_real_time_factor():
    playground = Playground(cs.scenes.paper_static(), dt=5e-6)
    for _ in range(3):
        done = playground.tick(0.1, budget=0.0)
        assert 0 < done < 0.1 / 5e-6
    assert playground.factor < 0.9


def test_the_time_step_is_the_paper_s_where_the_machine_keeps_up(monkeypatch):
    for cost, expected in ((1e-6, 5e-6), (4e-6, 1e-5), (25e-6, 5e-5), (40e-6, 1e-4)):
        monkeypatch.setattr(Playground, "_measured_cost", lambda self, cost=cost: cost)
        assert Playground(cs.scenes.paper_static()).dt == pytest.approx(expected)
    monkeypatch.setattr(Playground, "_measured_cost", lambda self: 1.0)
    slow = Playground(cs.scenes.paper_static())
    assert slow.dt == pytest.approx(0.5 * slow.limit)


def held(monkeypatch, cost):
    """Let stepping cost `cost` [s] a step, as far as a playground can tell."""
    advance = Playground._advance

    def counted(self, steps, budget):
        self.cost = cost
        done = advance(self, steps if budget else max(1, steps // 2), np.inf)
        self.cost = cost
        return done

    monkeypatch.setattr(Playground, "_measured_cost", lambda self: cost)
    monkeypatch.setattr(Playground, "_advance", counted)


def small():
    """A cloth of the paper's point masses, springs and stable step, but of few points."""
    return cs.Scene(cs.Cloth((4, 4), mass=8.0))


def test_the_time_step_follows_the_machine_up_to_half_of_the_guarantee(monkeypatch):
    held(monkeypatch, 4e-6)
    playground = Playground(small())
    steps = [playground.dt]
    for _ in range(100):  # the machine does half of what is asked
        playground.tick(0.1, budget=0.0)
        steps.append(playground.dt)
    assert steps[0] == 1e-5 and sorted(set(steps)) == sorted(steps[k] for k in range(101) if steps[k] != steps[k - 1])
    assert steps[-1] == pytest.approx(0.5 * playground.limit) and len(set(steps)) >= 5
    for _ in range(100):  # the machine keeps up again
        playground.tick(0.1)
    assert playground.dt == pytest.approx(2e-5)  # 4 of 20 us: at 10 us stepping would take more than IDLE
    playground.change(stiffness={"structural": 3.5e6, "shear": 3.5e6}, damping=1e4)
    assert playground.dt <= 0.5 * playground.limit < 2e-5


def test_a_chosen_time_step_stays_until_it_may_follow_again(monkeypatch):
    held(monkeypatch, 4e-6)
    playground = Playground(small())
    playground.change(dt=1e-4)
    for _ in range(30):
        playground.tick(0.1, budget=0.0)
    assert playground.dt == 1e-4 and not playground.follows
    playground.change(follows=True)
    for _ in range(30):
        playground.tick(0.1)
    assert playground.dt == pytest.approx(2e-5) and playground.follows
    playground.change(dt=1e-4)
    playground.reset()
    assert playground.follows and playground.dt == 1e-5


def test_slow_motion_takes_shorter_steps_and_less_time(monkeypatch):
    held(monkeypatch, 4e-6)
    playground = Playground(small())
    playground.change(speed=0.1)
    for _ in range(300):
        playground.tick(0.01)
    assert playground.time == pytest.approx(0.3, abs=1e-5)
    assert playground.factor == pytest.approx(0.1, abs=0.01)
    assert playground.dt == 5e-6
    with pytest.raises(ValueError, match="speed must be"):
        playground.change(speed=0.0)
    playground.reset()
    assert playground.speed == 1.0


def test_another_integrator_goes_on_from_the_present_state():
    scene = cs.scenes.paper_static()
    playground = Playground(scene, dt=1e-4)
    run_for(playground, 0.1)
    x, v, t = np.array(playground.stepper.positions), np.array(playground.stepper.velocities), playground.time
    playground.change(integrator="velocity_verlet")
    assert playground.time == t and np.array_equal(playground.stepper.positions, x)
    assert playground.limit == cs.max_stable_dt(scene, "velocity_verlet")
    steps = playground.tick(0.01)
    stepper = cs.Stepper(scene, x, v, integrator="velocity_verlet")
    stepper.advance(steps, 1e-4)
    assert np.array_equal(playground.stepper.positions, stepper.positions)
    playground.change(follows=True)
    with pytest.raises(ValueError, match="no stable time step"):
        playground.change(integrator="explicit_euler")
    with pytest.raises(ValueError, match="integrator must be one of"):
        playground.change(integrator="rk5")
    assert playground.options["integrator"] == "velocity_verlet" and playground.follows
    playground.reset()
    assert playground.options["integrator"] == "rk4"


def test_the_present_scene_starts_where_the_playground_is(tmp_path):
    playground = Playground(cs.scenes.paper_static(), dt=1e-4)
    run_for(playground, 0.2)
    playground.change(gravity=3.0)
    scene = cs.load_scene(cs.save_scene(playground.present(), tmp_path / "scene.toml"))
    assert scene.gravity[1] == -3.0
    assert np.array_equal(scene.initial_position, playground.stepper.positions)
    assert np.array_equal(scene.initial_velocity, playground.stepper.velocities)


def test_a_point_has_the_stretch_and_speed_of_the_measures():
    playground = Playground(cs.scenes.paper_static(), dt=1e-4)
    run_for(playground, 0.3)
    stretch, speed = playground.at((1, 1))
    assert speed == np.linalg.norm(playground.stepper.velocities[1, 1])
    table = playground.scene.cloth.spring_table()
    x, k = playground.stepper.positions.reshape(-1, 3), 33
    ends = table[(table["i"] == k) | (table["j"] == k)]
    lengths = np.linalg.norm(x[ends["i"]] - x[ends["j"]], axis=-1)
    assert stretch == pytest.approx((lengths / ends["rest_length"] - 1).max())


def test_the_steps_are_those_of_a_stepper():
    scene = cs.scenes.paper_static()
    playground, stepper = Playground(scene, dt=1e-4), cs.Stepper(scene)
    run_for(playground, 0.2)
    stepper.advance(round(playground.time / 1e-4), 1e-4)
    assert np.array_equal(playground.stepper.positions, stepper.positions)


def test_pause_single_step_and_reset():
    playground = Playground(level(), dt=1e-3)
    playground.paused = True
    assert playground.tick(0.1) == 0 and playground.time == 0
    assert playground.tick(0.0, single=True) == 1 and playground.time == pytest.approx(1e-3)
    playground.change(gravity=5.0, dt=2e-3, radius=0.1)
    playground.reset()
    assert (playground.time, playground.dt, playground.paused) == (0.0, 1e-3, False)
    assert playground.scene == playground.start
    assert np.array_equal(playground.stepper.positions, playground.start.initial_position)


def test_gravity_acts_at_once_and_keeps_the_state():
    playground = Playground(level(), dt=1e-3)
    run_for(playground, 0.1)
    playground.change(gravity=9.0)
    before, t = playground.stepper.velocities[4, 4, 1], playground.time
    run_for(playground, 0.02)
    middle = playground.stepper.velocities[4, 4, 1] - before
    assert middle == pytest.approx(-9.0 * (playground.time - t), rel=0.05)


def test_every_control_changes_its_field_and_the_stable_step_follows():
    playground = Playground(level(response="ray"), dt=1e-3)
    limit = playground.limit
    playground.change(stiffness={"shear": 800.0})
    stiffness = playground.scene.cloth.family_stiffness
    assert stiffness["shear"] == 800.0 and stiffness["structural"] == 200.0
    assert playground.limit < 0.9 * limit
    playground.change(damping=0.5)
    assert set(playground.scene.cloth.family_damping.values()) == {0.5}
    playground.change(response="continuous", offset="face", restitution=0.5, friction=0.3, radius=0.1)
    (sphere,) = playground.scene.spheres
    assert (sphere.response, sphere.offset, sphere.restitution) == ("continuous", "face", 0.5)
    assert (sphere.friction, sphere.radius) == (0.3, 0.1)
    assert playground.stepper.scene == playground.scene


@pytest.mark.parametrize(
    "change", [{"stiffness": {"shear": -1.0}}, {"offset": "face"}, {"radius": 0.0}, {"dt": 0.0}, {"damping": np.nan}]
)
def test_a_refused_change_changes_nothing(change):
    playground = Playground(level(), dt=1e-3)
    run_for(playground, 0.1)
    scene, dt, t = playground.scene, playground.dt, playground.time
    with pytest.raises(ValueError):
        playground.change(**change)
    assert (playground.scene, playground.dt, playground.time) == (scene, dt, t)
    playground.tick(0.02)
    assert playground.time > t


def test_a_dragged_sphere_travels_no_faster_than_allowed_and_pushes_the_cloth():
    playground = Playground(level(response="continuous", offset="face"), dt=1e-3)
    playground.drag_sphere(0, (0.5, 0.0, 0.5))
    centers = [playground.centers()[0, 1]]
    for _ in range(10):
        playground.tick(0.02)
        centers.append(playground.centers()[0, 1])
    assert np.diff(centers).max() == pytest.approx(0.02 * DRAG_SPEED, rel=0.06)
    assert centers[-1] == pytest.approx(0.0, abs=1e-9)
    assert playground.stepper.positions[4, 4, 1] > 0.19
    sphere = playground.scene.spheres[0]
    assert np.array_equal(sphere.velocity_at(playground.time), (0, 0, 0))  # it stands where it was dragged
    assert cs.penetration(playground.stepper.positions, sphere, playground.time)["points"] < 1e-9


def test_contact_sees_the_velocity_of_the_drag():
    """A free point, elastic contact: it leaves with twice the speed of the sphere."""
    cloth = cs.Cloth((2, 2), mass=4.0, stiffness=0.0, damping=0.0, pins=((0, 0), (0, 1), (1, 0)))
    sphere = cs.Sphere((1.0, -0.5, 1.0), 0.2, None, "continuous", "none", restitution=1.0)
    playground = Playground(cs.Scene(cloth, sphere, gravity=(0, 0, 0)), dt=1e-3)
    for k in range(1, 22):  # 0.02 m in each 0.02 s
        playground.drag_sphere(0, (1.0, -0.5 + 0.02 * k, 1.0))
        playground.tick(0.02)
    assert playground.stepper.velocities[1, 1] == pytest.approx((0.0, 2.0, 0.0), abs=0.1)


def test_a_dragged_pin_comes_where_it_is_dragged_and_takes_the_cloth_along():
    playground = Playground(level(), dt=1e-3)
    row, column = (int(k) for k in np.argwhere(playground.scene.cloth.pinned)[0])
    target = playground.stepper.positions[row, column] + (0.0, 0.3, 0.0)
    playground.drag_pin((row, column), target)
    run_for(playground, 0.02)
    assert 0.1 < playground.stepper.positions[row, column, 1] <= 0.02 * DRAG_SPEED + 1e-9
    run_for(playground, 0.4)
    x = playground.stepper.positions
    assert x[row, column] == pytest.approx(target, abs=1e-9)
    assert x[row + 1, column + 1, 1] > 0.05
    with pytest.raises(ValueError, match="point must be pinned"):
        playground.drag_pin((4, 4), target)


def test_above_the_limit_it_says_unstable_and_stops_with_a_finite_state():
    playground = Playground(cs.scenes.paper_static(), dt=1e-4)
    run_for(playground, 0.3)
    playground.change(dt=5 * playground.limit)
    for _ in range(200):
        playground.tick(0.05)
    assert playground.problem.startswith("UNSTABLE at point (")
    assert f"{1e6 * playground.limit:.4g} us are guaranteed" in playground.problem
    assert np.isfinite(playground.stepper.positions).all()
    t = playground.time
    assert playground.tick(0.1) == 0 and playground.time == t
    playground.reset()
    assert playground.tick(0.1) > 0 and playground.problem == ""


@pytest.mark.parametrize("dt", [1e-314, 1e302])
def test_odd_time_steps_stop_no_playground(dt):
    playground = Playground(cs.scenes.paper_static(), dt=1e-4)
    playground.change(dt=dt)
    t = playground.time
    playground.tick(0.02, budget=0.01)
    assert not playground.problem and playground.time >= t


def test_a_recording_is_a_run_whose_spheres_were_dragged(tmp_path):
    playground = Playground(level(response="continuous", offset="face"), dt=1e-3)
    with pytest.raises(ValueError, match="needs 2 recorded frames, got 0"):
        playground.recorded()
    run_for(playground, 0.1)
    playground.record(True)
    playground.drag_sphere(0, (0.5, -0.1, 0.5))
    run_for(playground, 0.2)
    playground.record(False)
    run_for(playground, 0.1)
    run = playground.recorded()
    assert len(run.t) == 11 and run.t[0] == pytest.approx(0.1) and run.t[-1] == pytest.approx(0.3)
    sphere = run.scene.spheres[0]
    assert sphere.center_at(run.t[0])[1] == -0.5 and sphere.center_at(run.t[-1])[1] == pytest.approx(-0.1)
    assert run.x[-1, 4, 4, 1] > 0.05
    lines = str(run).splitlines()
    assert lines[2] == "200 steps of 0.001 s by rk4 in double" and lines[5] == "recorded in the live viewer"
    energy = cs.energy(run.scene, run.x[-1], run.v[-1])["total"]
    assert run.report["energy"]["end"]["total"] == energy and f"{energy:.4g} J at the end" in lines[3]
    assert run.report["penetration"]["triangles"] == run.penetration()["triangles"].max()
    assert run.to_html(tmp_path / "run.html").stat().st_size > 10_000
    assert cs.load_run(run.save(tmp_path / "run.npz")).scene == run.scene


def test_measures_are_those_of_the_state():
    playground = Playground(cs.scenes.paper_static(), dt=1e-4)
    run_for(playground, 0.4)
    total, depth = playground.measures()
    x, v = playground.stepper.positions, playground.stepper.velocities
    assert total == cs.energy(playground.scene, x, v)["total"]
    assert depth == cs.penetration(x, playground.scene.spheres[0])["triangles"] > 0


def test_a_host_that_is_not_this_machine_is_refused():
    for host in ("no.such.host", "203.0.113.7", "a b", "::ffff:127.0.0.1"):
        with pytest.raises(ValueError, match=f"^host must be a name or address of this machine.*got {host!r}: "):
            cs.view(cs.scenes.paper_static(), block=False, host=host)


def test_what_is_inside_a_sphere_is_shown_on_it_as_large_as_it_is():
    stage = pytest.importorskip("clothsim.viewing.stage", exc_type=ImportError)
    radius, height, n = 0.3, 0.25, 40
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
    flat = np.stack([u, np.full_like(u, height), v], -1).reshape(-1, 3)
    corners = flat[cs.triangles((n, n))]
    shown = stage.inside_spheres(corners, np.zeros((1, 3)), [radius])
    area = np.linalg.norm(np.cross(shown[:, 1] - shown[:, 0], shown[:, 2] - shown[:, 0]), axis=-1).sum() / 2
    cap = 2 * np.pi * stage.LIFT**2 * radius * (radius - height)
    assert cap < area < 1.15 * cap  # triangles that the border crosses count
    distance = np.linalg.norm(shown, axis=-1)
    assert distance.min() == pytest.approx(stage.LIFT * radius)
    assert len(stage.inside_spheres(corners + (0.0, 0.051, 0.0), np.zeros((1, 3)), [radius])) == 0
