"""The film that opens README: a ball lifts a sheet, by method 2 of the paper as printed (left) and
by penalty contact (right).
"""

import clothsim as cs
from PIL import Image

cloth = cs.Cloth(
    mass=512.0, springs=("structural", "shear"), pins=[(0, 0), (-1, 0), (0, -1), (-1, -1)]
)
ball = cs.Sphere((0.5, -0.55, 0.5), 0.2, cs.Reciprocate((0, 1, 0), 0.5, 2.0))
printed = ball.replace(response="ray", offset="edge", as_printed=True)
runs = {
    "method 2, as printed": cs.simulate(cs.Scene(cloth, printed), 1.6, dt=1e-4, fps=25),
    "penalty contact": cs.simulate(cs.Scene(cloth, ball), 1.6, dt=1e-4, fps=25),
}
for name, run in runs.items():
    print(
        f"{name}: deepest triangle {1e3 * run.report['penetration']['triangles']:.1f} mm "
        "inside the ball"
    )

both = cs.compare(runs)
films = [Image.fromarray(both.picture(t=t, width=400).pixels) for t in runs["penalty contact"].t]
films[0].save(
    "opening.webp", save_all=True, append_images=films[1:], duration=80, loop=0, quality=60
)  # half speed
