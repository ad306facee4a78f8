"""The sphere: contact radius, motion, and what it refuses."""

import copy
import pickle
from decimal import Decimal, getcontext

import clothsim as cs
import pytest
from clothsim.model.cloth import Cloth
from clothsim.model.obstacle import Sphere


def eq_13(rest_length, radius):
    """Return O = sqrt((D/2)^2 + R^2) - R of Kim et al., in 60 digits."""
    getcontext().prec = 60
    half = Decimal(rest_length) / 2
    radius = Decimal(radius)
    return float((half * half + radius * radius).sqrt() - radius)


@pytest.mark.parametrize("columns", [2, 32, 1_000, 1_000_000])
def test_edge_offset_is_eq_13_to_the_last_digits(columns):
    cloth = Cloth(shape=(2, columns), size=(1e-9, 1.0), pins=())
    sphere = Sphere(radius=0.25, offset="edge")
    exact = eq_13(cloth.spacing[1], 0.25)
    # At a million columns the subtraction of eq 13 as printed would keep no digit at all.
    assert sphere.offset_length(cloth) == pytest.approx(exact, rel=1e-15, abs=0)
    assert sphere.contact_radius(cloth) == pytest.approx(0.25 + exact, rel=1e-15, abs=0)


def test_edge_offset_takes_the_longest_structural_rest_length():
    for size in [(3.0, 1.0), (1.0, 3.0)]:
        for springs in [("structural",), ("shear",), ()]:
            cloth = Cloth(shape=(2, 2), size=size, springs=springs)
            assert Sphere(radius=2.0, offset="edge").contact_radius(cloth) == pytest.approx(
                2.5, rel=1e-15, abs=0
            )
    chain = Cloth(shape=(3, 1), size=(6.0, 99.0), pins=())
    assert Sphere(radius=2.0, offset="edge").contact_radius(chain) == pytest.approx(
        2.5, rel=1e-15, abs=0
    )


def test_other_offsets():
    assert Sphere(offset="none").contact_radius(Cloth()) == 0.25
    assert Sphere(offset=0.125).contact_radius(Cloth()) == 0.375
    assert Sphere(offset=0).offset_length(Cloth()) == 0.0
    with pytest.raises(TypeError, match="cloth must be a Cloth"):
        Sphere().contact_radius((32, 32))


def test_names_that_have_left_name_what_serves_instead():
    with pytest.raises(ValueError, match=r"offset must be one of .*'cell'.* or a length .*'face'"):
        Sphere(offset="face")
    for obstacle in (Sphere, cs.Plane):
        with pytest.raises(ValueError, match="got 'continuous'.*'penalty' takes its place"):
            obstacle(response="continuous")
        with pytest.raises(TypeError, match="push_out_speed.*; response 'penalty' pushes out"):
            obstacle(push_out_speed=0.5)


@pytest.mark.parametrize("obstacle", [Sphere(), cs.Plane()])
def test_files_with_names_that_have_left_name_what_serves_instead(obstacle, tmp_path):
    scene = cs.Scene(Cloth((2, 2)), obstacle)
    for name, value, match in (
        ("response", "continuous", "got 'continuous'.*'penalty' takes its place"),
        ("push_out_speed", 0.5, "unknown key 'push_out_speed'; response 'penalty' pushes out"),
    ):
        with pytest.raises(ValueError, match=match):
            type(obstacle).from_dict({**obstacle.to_dict(), name: value})
        path = cs.save_scene(scene, tmp_path / "scene.toml")
        lines = [line for line in path.read_text().splitlines() if not line.startswith(name)]
        at = lines.index("[[spheres]]") + 1
        lines.insert(at, f"{name} = {value!r}")
        path.write_text("\n".join(lines))
        with pytest.raises(ValueError, match=match):
            cs.load_scene(path)


def test_a_restitution_that_was_given_stays_and_a_default_follows_the_response():
    for copied in (
        copy.copy,
        copy.deepcopy,
        lambda s: pickle.loads(pickle.dumps(s)),
        lambda s: Sphere.from_dict(s.to_dict()),
    ):
        for value, expected in ((None, 1.0), (0.0, 0.0)):
            sphere = copied(cs.Sphere(response="reflect", restitution=value).replace(radius=0.1))
            assert sphere.restitution == sphere.replace(response="ray").restitution == expected
    assert cs.scenes.paper_static().spheres[0].replace(response="reflect").restitution == 1.0
    assert cs.Sphere().restitution is None and cs.Sphere().replace(response="ray").restitution == 1
