"""Shoot a small sphere at 300 m/s: responses after a step let it pass between two steps, penalty
contact under error control does not.
"""

import clothsim as cs

cloth = cs.Cloth(shape=(16, 16))
fast = cs.Sphere((0.47, -2.0, 0.52), 0.05, cs.Linear((0, 300, 0)), response="ray", offset="edge")
shots = ((fast, 1e-3, None), (fast.replace(response="penalty", offset="cell"), None, 1e-3))
for shot, dt, rtol in shots:
    scene = cs.Scene(cloth, shot)
    run = cs.simulate(scene, 0.01, dt=dt, rtol=rtol)
    caught = run.x[-1][..., 1].max() > 0.25
    print(
        f"{shot.response:7} {shot.offset:4} the cloth {'caught' if caught else 'missed'} the "
        f"sphere; triangles {1e3 * run.report['penetration']['triangles']:.0f} mm deep"
    )
    cs.picture(scene, run.x[-1], t=0.01, path=f"fast_sphere_{shot.response}.png")
