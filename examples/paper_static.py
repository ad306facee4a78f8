"""The paper's first experiment, two steps per frame: method 1 against 2 on a sphere at rest."""

import clothsim as cs

FRAME = 1.6e-3  # s

ends = {}
for name, scene in (
    ("method 1", cs.scenes.paper_static("reflect")),
    ("method 2", cs.scenes.paper_static("ray")),
):
    run = cs.simulate(scene, 800 * FRAME, dt=FRAME / 2, every=2)
    depths = [1e3 * run.penetration()["triangles"][frame] for frame in (150, 500, 800)]
    print(
        f"{name}: deepest triangle {depths[0]:.2f}, {depths[1]:.2f}, {depths[2]:.2f} mm at "
        "frames 150, 500, 800"
    )
    ends[name] = run
ends["method 2"].animate("paper_static.webp", fps=12, speed=0.5)
