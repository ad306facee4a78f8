"""Scene files: what is written is read back equal, and what is wrong is said."""

import clothsim as cs
import numpy as np
import pytest

FAMILIES = {"structural": 900.0, "shear": 350.5, "bend": 0.1}
SCENES = {
    "paper": cs.scenes.paper_static(),
    "moving": cs.scenes.paper_moving(),
    "hanging": cs.scenes.hanging(shape=(4, 5)),
    "no springs": cs.Scene(cs.Cloth((2, 3), springs=(), pins=())),
    "everything": cs.Scene(
        cs.Cloth((3, 4), (0.1, 1e-17), np.linspace(0.1, 0.3, 12).reshape(3, 4), FAMILIES, FAMILIES),
        (
            cs.Sphere(
                (1 / 3, -0.0, 5e-324),
                motion=cs.Linear((1e300, 0, 0)),
                offset=0.01,
                as_printed=True,
                response="ray",
            ),
            cs.Sphere(
                motion=cs.Keyframes([0, 1.5], np.eye(3)[:2], smooth=True),
                response="reflect",
                offset="none",
            ),
        ),
        (0.1, 0.2, 0.3),
        position=np.random.default_rng(0).normal(size=(3, 4, 3)),
        velocity=np.zeros((3, 4, 3)),
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_saved_file_loads_to_the_same_values(tmp_path, name):
    path = cs.save_scene(SCENES[name], tmp_path / "scene.toml")
    copy = cs.load_scene(path)
    assert copy == SCENES[name]
    assert cs.save_scene(copy, tmp_path / "again.toml").read_text() == path.read_text()


def test_the_layout(tmp_path):
    text = cs.save_scene(SCENES["moving"], tmp_path / "scene.toml").read_text()
    assert text.startswith(
        "schema = 2  # version of this layout\ngravity = [0.0, -9.80665, 0.0]  # m/s^2\n"
    )
    assert text.endswith("\n[file]\ncomplete = true\n")
    for line in (
        "[cloth]",
        "stiffness = 35000.0  # N/m, one number or one per family",
        "[[spheres]]",
        "[spheres.motion]",
        'kind = "reciprocate"',
    ):
        assert line in text.splitlines()
    text = cs.save_scene(SCENES["everything"], tmp_path / "scene.toml").read_text()
    assert "stiffness = { structural = 900.0, shear = 350.5, bend = 0.1 }" in text


def test_a_file_is_edited_by_hand(tmp_path):
    path = cs.save_scene(SCENES["paper"], tmp_path / "scene.toml")
    schema, *lines = [line.partition("#")[0] for line in path.read_text().splitlines()]
    head, cloth, sphere, end = "\n".join(lines).split("\n[")
    edited = "\n[".join(
        [f"\ufeff{head}\n{schema}", end, sphere.replace("radius = 0.25", "radius = 0.2 # m"), cloth]
    )
    path.write_bytes(edited.replace("\n", "\r\n").encode())
    expected = SCENES["paper"].spheres[0].replace(radius=0.2)
    assert cs.load_scene(path) == SCENES["paper"].replace(spheres=expected)


def test_a_cut_file_is_refused(tmp_path):
    path = cs.save_scene(SCENES["moving"], tmp_path / "scene.toml")
    data = path.read_bytes()
    for length in range(len(data) - 1):  # without the last line break it is whole
        path.write_bytes(data[:length])
        with pytest.raises(ValueError, match="no TOML file of a scene") as caught:
            cs.load_scene(path)
        assert data[length - 1 : length] != b"\n" or "it is cut: its end" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (
            "schema = 2\n[cloth]\nstifness = 3.0\n",
            ValueError,
            "unknown key 'stifness'.*'stiffness'",
        ),
        ("schema = 2\n[cloth]\n[[spheres]]\nradios = 1.0\n", ValueError, "'radios'.*'radius'"),
        ("schema = 3\n[cloth]\n", ValueError, "schema must be 2, the version read here, got 3$"),
        ("schema = 2\ncloth = 3\n", TypeError, "mapping"),
        ("schema = \n", ValueError, "no TOML file"),
        ("\xff\xfe", ValueError, "no TOML file"),
    ],
)
def test_a_bad_file_is_named_with_its_fault(tmp_path, text, error, message):
    path = tmp_path / "wrong.toml"
    path.write_bytes(f"{text}\n[file]\ncomplete = true\n".encode("latin-1"))
    with pytest.raises(error, match=message) as caught:
        cs.load_scene(path)
    assert str(caught.value).startswith(str(path))
