"""Shoot a small sphere at 300 m/s at a sheet: response "ray" misses it between two steps, a layer
that is too soft ends the run, and the layer for its speed catches it.

The blow stretches cells to six times their length, larger than the sphere. Their points stay out,
and a warning tells how deep their triangles are.
"""

import clothsim as cs

cloth = cs.Cloth(shape=(16, 16))
fast = cs.Sphere((0.47, -2.0, 0.52), 0.05, cs.Linear((0, 300, 0)))
soft = fast.replace(stiffness=10 * 35_000.0)  # the default of a still sphere
shots = {
    "ray": (fast.replace(response="ray", offset="edge"), 1e-3, None),
    "soft": (soft, None, 1e-3),
    "stiff": (fast, None, 1e-3),  # the default of its motion
}
for name, (sphere, dt, rtol) in shots.items():
    scene = cs.Scene(cloth, sphere)
    try:
        run = cs.simulate(scene, 0.01, dt=dt, rtol=rtol)
    except cs.ContactError as error:
        print(f"{name}: {error}")
        continue
    caught = run.x[-1][..., 1].max() > 0.25
    print(
        f"{name}: the cloth {'caught' if caught else 'missed'} the sphere; "
        f"triangles {1e3 * run.report['penetration']['triangles']:.0f} mm deep"
    )
    cs.picture(scene, run.x[-1], t=0.01, path=f"fast_sphere_{name}.png")
