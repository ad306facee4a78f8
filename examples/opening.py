"""The film that opens README: the paper's moving sphere with continuous contact, which keeps all triangles out."""

import clothsim as cs

scene = cs.scenes.paper_moving(response="continuous")
scene = scene.replace(spheres=[sphere.replace(offset="cell", restitution=0.0) for sphere in scene.spheres])
run = cs.simulate(scene, 3.2, dt=2e-4, fps=12.5)
depth = run.report["penetration"]
print(f"deepest point inside the sphere {depth['points']} m, deepest triangle {depth['triangles']} m")
run.animate("opening.webp", fps=12.5, width=400)
