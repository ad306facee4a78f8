"""Shoot a small sphere at 300 m/s: it passes between two steps, unless contact is continuous."""

import clothsim as cs

cloth = cs.Cloth(shape=(16, 16))
fast = cs.Sphere((0.47, -2.0, 0.52), 0.05, cs.Linear((0, 300, 0)), response="ray", offset="edge")
for shot in (fast, fast.replace(response="continuous", offset="cell")):
    scene = cs.Scene(cloth, shot)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, dt=1e-3, steps=10, t=0.0)
    caught = x[..., 1].max() > 0.5
    print(
        f"{shot.response:10} {shot.offset:5} the cloth {'caught' if caught else 'missed'} "
        "the sphere"
    )
    cs.picture(scene, x, t=0.01, path=f"fast_sphere_{shot.response}.png")
