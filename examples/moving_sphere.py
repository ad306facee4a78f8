"""The paper's second experiment: a sphere travels to and fro; method 1 lets the cloth through."""

import clothsim as cs

for response in ("reflect", "ray"):
    scene = cs.scenes.paper_moving(response=response)
    # The paper's words exactly: reflect the absolute velocity, whether the point approaches or
    # leaves.
    scene = scene.replace(spheres=[sphere.replace(as_printed=True) for sphere in scene.spheres])
    run = cs.simulate(scene, 2.0, dt=5e-4, fps=12.5)
    depth = run.report["penetration"]
    first = run.report["first_contact"]["time"]
    print(f"{response:8} first contact {first:.3f} s, deepest point {1e3 * depth['points']:.1f} mm")
    run.animate(f"moving_sphere_{response}.webp", fps=12.5)
