"""`clothsim sweep` and `clothsim plot`, and the pictures they draw."""

import io
import json
import re
import sys
import warnings

import clothsim as cs
import numpy as np
import pytest
from clothsim.cli import main
from clothsim.cli.sweep import parse_values
from clothsim.sweeps import workers
from clothsim.viewing import sweep_plots as plots
from commands import run

pytest.importorskip("xarray")
pytest.importorskip("zarr")
plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture
def scene(tmp_path):
    return cs.save_scene(cs.scenes.hanging(shape=(6, 7)), tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("name", "text", "values"),
    [
        ("stiffness", "1e3:1e5:log9", np.geomspace(1e3, 1e5, 9)),
        ("stiffness", "1e1:1e5:log5", [10.0, 100.0, 1e3, 1e4, 1e5]),
        ("mass", "1:3:lin5,9", [1, 1.5, 2, 2.5, 3, 9]),
        ("dt", "1e-5,1e-4, 1e-3", [1e-5, 1e-4, 1e-3]),
        ("precision", "single,double", ["single", "double"]),
        ("shape", "16,8x32", [(16, 16), (8, 32)]),
        ("gravity", "0;-9.8;0", [(0.0, -9.8, 0.0)]),
        ("springs", "structural+bend,shear", [("structural", "bend"), ("shear",)]),
        ("strict", "true,false", [True, False]),
        ("sphere_offset", "edge,0.01", ["edge", 0.01]),
    ],
)
def test_values(name, text, values):
    parsed = parse_values(name, text)
    if isinstance(values, np.ndarray):
        assert parsed == pytest.approx(values, rel=1e-11, abs=0)
    else:
        assert parsed == values and list(map(type, parsed)) == list(map(type, parse_values(name, text)))


@pytest.mark.parametrize("text", ["1:2", "1:2:3", "0:2:log4", "1:2:log1", "1:b:lin3", "1:2:geo4"])
def test_ranges_that_are_none(text):
    with pytest.raises(ValueError, match="--stiffness: a range must be"):
        parse_values("stiffness", text)


def test_a_sweep_from_a_file(capsys, scene, tmp_path):
    store, picture = tmp_path / "s.zarr", tmp_path / "s.png"
    options = "--stiffness 1e3:1e5:log3 --dt 1e-3,1e-2 --duration 0.3 --metric error,stable --plot --store"
    command = ("sweep", scene, *options.split(), store)
    code, out, err = run(capsys, *command)
    assert (code, err) == (0, "")
    expected = cs.sweep(
        cs.load_scene(scene),
        {"stiffness": [1e3, 1e4, 1e5], "dt": [1e-3, 1e-2]},
        duration=0.3,
        metrics=["error", "stable"],
        progress=False,
    )
    stored = cs.open_sweep(store)
    assert np.array_equal(stored.error, expected.error, equal_nan=True)
    assert out.startswith("6 members (4 done, 2 unstable); ")
    rows = [line.split() for line in out.splitlines()]
    assert ["1e+04", f"{expected.error.values[1, 0]:.4g}", "unstable"] in rows
    assert ["1e+04", "True", "False"] in rows
    assert picture.read_bytes().startswith(b"\x89PNG") and str(picture) in out
    code, out, _ = run(capsys, *command)
    assert code == 0 and "nothing was missing" in out.splitlines()[0]
    code, _, err = run(capsys, *command, "--no-resume")
    assert code == 2 and "without --no-resume it would be continued" in err and err.count("\n") == 1
    code, _, err = run(capsys, *[("4e3:1e5:log3" if "log" in str(c) else c) for c in command])
    assert code == 2 and "over[0].values.stiffness[0] (1000.0 in the store, 4000.0 given)" in err


def test_json_and_single_values(capsys):
    options = "--mass 100,200 --dt 1e-3 --duration 0.01 --precision single --stiffness-shear 5 --metric largest_stretch"
    code, out, err = run(capsys, "sweep", "paper_swing", *options.split(), "--json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["variables"]["largest_stretch"]["dims"] == ["mass"]
    assert data["coordinates"]["mass"] == {"dims": ["mass"], "values": [100.0, 200.0], "units": "kg"}
    settings = data["provenance"]["identity"]
    assert settings["settings"]["dt"] == 1e-3 and settings["settings"]["precision"] == "single"
    assert settings["scene"]["cloth"]["stiffness"]["shear"] == 5.0


def test_zip_and_set(capsys):
    options = "--mass 100,200 --dt 1e-3,2e-3 --zip mass,dt --set sphere0_radius=0.1,0.2,0.3 --duration 0.01 --metric stable"
    code, out, err = run(capsys, "sweep", "paper_static", *options.split(), "--json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["variables"]["stable"]["dims"] == ["mass_dt", "sphere0_radius"]
    assert data["coordinates"]["dt"]["dims"] == ["mass_dt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.toml"], "nowhere.toml"),
        (["paper_swng"], "did you mean 'paper_swing'?"),
        (["paper_swing", "--stifness", "3"], "--stifness 3 (did you mean --stiffness?) (see clothsim sweep --help)"),
        (["paper_swing", "--stiffness", "1e3:1e4"], "--stiffness: a range must be first:last:log9"),
        (["paper_swing", "--metric", "eror"], "did you mean 'error'?"),
        (["paper_swing", "--set", "stifness=3"], "did you mean 'stiffness'?"),
        (["paper_swing", "--set", "mass"], "NAME=VALUE"),
        (["paper_swing", "--shape", "16xa"], "like 32x32"),
        (["paper_swing", "--mass", "1,-2"], "mass must be"),
        (["paper_swing", "--mass", "1,2", "--zip", "mass,dt"], "several values"),
        (["paper_swing", "--mass", "1,2", "--dt", "1,2,3", "--zip", "mass,dt"], "as many values"),
        (["paper_swing", "--every", "often"], "--every: must be"),
        (["paper_swing", "--plot", "nowhere/p.png"], "existing folder"),
        (["paper_swing", "--strict", "yes,no"], "true or false"),
    ],
)
def test_bad_input_is_refused(capsys, arguments, message):
    code, _, err = run(capsys, "sweep", *arguments, "--duration", "0.01")
    assert code in (1, 2) and message in err and err.count("\n") == 1


def test_run_takes_a_scene_file_too(capsys, scene):
    code, out, err = run(capsys, "run", scene, "--duration", "0.01", "--dt", "1e-3", "--json")
    assert (code, err) == (0, "") and json.loads(out)["steps"] == 10


def terminal_of(monkeypatch):
    """What a terminal gets."""
    shown = io.StringIO()
    shown.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", shown)
    return shown


def test_the_bar_shows_members_rate_and_time_left(monkeypatch):
    terminal = terminal_of(monkeypatch)
    cs.sweep(cs.scenes.hanging(shape=(6, 7)), {"dt": [1e-3, 5e-2]}, duration=0.3)
    last = terminal.getvalue().split("\r")[-1]
    assert "100%" in last and "2/2 members, 1 unstable, " in last and "/s [" in last and "<00:00]" in last


def test_the_bar_moves_while_a_long_member_runs(monkeypatch):
    terminal = terminal_of(monkeypatch)
    monkeypatch.setattr(workers, "_SECONDS_BETWEEN_SIGNS", 0.05)
    cs.sweep(cs.scenes.hanging(shape=(24, 24)), {"stiffness": [1e3]}, duration=40.0, dt=2e-4, threads=1)
    parts = [int(text) for text in re.findall(r"(\d+)%", terminal.getvalue())]
    assert parts == sorted(parts) and len({part for part in parts if 0 < part < 100}) >= 3


def test_warnings_go_above_the_bar(monkeypatch):
    terminal = terminal_of(monkeypatch)

    def warning(run):
        warnings.warn("mind the gap", RuntimeWarning, stacklevel=1)
        return 0.0

    show = warnings.showwarning
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
        cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0]}, dt=0.01, metrics=warning)
    assert warnings.showwarning is show
    before, line = terminal.getvalue().split("warning: mind the gap\n")[0], terminal.getvalue().count("mind the gap")
    # The bar is wiped before, so the warning begins at the left of an empty line.
    assert line == 1 and before.endswith("\r") and before.split("\r")[-2].strip() == ""


# Pictures


@pytest.fixture(scope="module")
def swept():
    scene = cs.scenes.hanging(shape=(6, 7))
    return cs.sweep(
        scene,
        {"stiffness": np.geomspace(500, 5e4, 4), "dt": [1e-3, 2e-3, 4e-3, 3e-2]},
        duration=0.3,
        metrics=["error", "largest_stretch"],
        progress=False,
    )


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_zipped_tolerances_and_steps_are_shown_by_their_values(capsys, scene):
    options = "--zip dt,rtol --dt 1e-3,none --rtol none,1e-6 --duration 0.05 --metric stable"
    command = ["sweep", str(scene), *options.split()]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "dt=0.001 rtol=none    True" in out and "dt=none rtol=1e-06    True" in out
    assert main([*command[:2], "--rtol", "1e-3", "--dt", "1e-3"]) != 0
    assert "dt must be None with rtol" in capsys.readouterr().err


def test_a_fan_over_tolerances():
    scene = cs.Scene(cs.Cloth((5, 5), mass=1.0, stiffness=200.0, damping=0.2))
    over = {"rtol": [1e-3, 1e-5, 1e-15], "stiffness": [100.0, 200.0]}
    swept = cs.sweep(scene, over, duration=0.1, metrics="error", progress=False)
    axes = swept.clothsim.plot()
    assert axes.get_xlabel() == "rtol" and axes.get_xscale() == axes.get_yscale() == "log"
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert np.array_equal(lines["200"].get_ydata(), swept.error.sel(stiffness=200.0).sortby("rtol"))
    assert "order 4" not in lines
    unsure = (swept.error < swept.reference_error).values.sum()
    assert unsure > 0 and "below the\nreference's own" in lines


def test_the_convergence_fan(swept):
    axes = swept.clothsim.plot()
    lines = {line.get_label(): line for line in axes.get_lines()}
    for stiffness in swept.stiffness.values:
        line = lines[f"{stiffness:.4g}"]
        assert np.array_equal(line.get_ydata(), swept.error.sel(stiffness=stiffness), equal_nan=True)
        assert np.array_equal(line.get_xdata(), swept.dt)
    slope = np.diff(np.log(lines["order 4"].get_ydata())) / np.diff(np.log(swept.dt.values))
    assert slope == pytest.approx([4, 4, 4], rel=1e-9)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert axes.get_xlabel() == "dt [s]" and axes.get_legend().get_title().get_text() == "stiffness [N/m]"
    crosses = sum(len(line.get_xdata()) for line in axes.get_lines() if line.get_marker() == "x")
    assert crosses == int((swept.status == 2).sum()) > 0


def test_the_stability_map(swept):
    axes = swept.clothsim.plot.stability()
    (mesh,) = axes.collections
    assert np.array_equal(mesh.get_array(), swept.status.values.T)
    line = axes.get_lines()[0]
    assert np.array_equal(line.get_ydata(), swept.max_stable_dt.isel(dt=0))
    assert np.array_equal(line.get_xdata(), swept.stiffness)


def test_heat_maps(swept):
    axes = swept.clothsim.plot.heatmap("largest_stretch", x="dt", y="stiffness")
    mesh = axes.collections[0]
    assert np.array_equal(np.ma.filled(mesh.get_array(), np.nan), swept.largest_stretch, equal_nan=True)
    line = swept.isel(dt=0).clothsim.plot.heatmap().get_lines()[0]
    assert np.array_equal(line.get_ydata(), swept.error.isel(dt=0))
    corners = {"corners": lambda run: run.x[-1, 0], "height": lambda run: run.x[-1, ..., 1].mean()}
    framed = cs.sweep(cs.scenes.hanging(), {"dt": [1e-3, 2e-3]}, duration=0.01, metrics=corners, frames=True, progress=False)
    axes = framed.clothsim.plot.heatmap()  # of a metric with one number a member, not of frames
    assert np.array_equal(axes.get_lines()[0].get_ydata(), framed.height)
    assert plots.suggested(swept.drop_vars("error")) == "stability"
    assert plots.suggested(swept.isel(dt=[0]).drop_vars("error")) == "heatmap"


def test_labels_on_an_axis():
    over = {"shape": [(4, 4), (4, 8), (8, 8)], "mass": [1.0, 2.0]}
    result = cs.sweep(cs.scenes.paper_swing(), over, duration=0.01, dt=1e-4, progress=False)
    axes = result.clothsim.plot.heatmap("energy_drift")
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["4x4", "4x8", "8x8"]


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda ds: plots.convergence(ds.drop_vars("error")), "needs the metric 'error'"),
        (lambda ds: plots.convergence(ds.isel(dt=0)), "needs a sweep over 'dt'"),
        (lambda ds: plots.stability(ds.isel(stiffness=0)), "beside dt"),
        (lambda ds: plots.stability(ds.expand_dims(mass=[1, 2])), r"ds.isel\(stiffness=0\)"),
        (lambda ds: plots.heatmap(ds, "eror"), "'error'"),
        (lambda ds: plots.heatmap(ds.expand_dims(mass=[1, 2])), "two dimensions"),
        (lambda ds: plots.heatmap(ds.isel(dt=0, stiffness=0)), "longer than one"),
        (lambda ds: plots.plot(ds, "pie"), "kind must be"),
    ],
)
def test_pictures_that_cannot_be(swept, draw, message):
    with pytest.raises(ValueError, match=message):
        draw(swept)


def test_plot_draws_a_store(capsys, scene, tmp_path):
    store = tmp_path / "s.zarr"
    over = {"stiffness": [1e3, 1e4], "dt": [1e-3, 2e-2], "mass": [1.0, 2.0]}
    cs.sweep(cs.load_scene(scene), over, duration=0.1, metrics=["error"], store=store, progress=False)
    code, _, err = run(capsys, "plot", store)
    assert code == 2 and "room for one dimension" in err
    for options in (["--kind", "stability"], ["--metric", "error_rms"], []):
        picture = tmp_path / "p.png"
        code, out, err = run(capsys, "plot", store, "--select", "mass=1.1", "--out", picture, *options)
        assert (code, err) == (0, "") and picture.read_bytes().startswith(b"\x89PNG")
        picture.unlink()
    for wrong, message in (
        (["--select", "mess=1"], "NAME=VALUE"),
        (["--kind", "stability", "--metric", "error"], "heatmap"),
        (["--out", "nowhere/x.png"], "existing folder"),
    ):
        code, _, err = run(capsys, "plot", store, *wrong)
        assert code == 2 and message in err
    code, _, err = run(capsys, "plot", tmp_path)
    assert code == 2 and "no store of a sweep" in err
