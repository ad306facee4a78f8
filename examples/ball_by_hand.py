"""Move a sphere by hand: give its centre at each call's end, here on a circle under the cloth."""

import clothsim as cs
import numpy as np

cloth = cs.Cloth(
    (20, 20), mass=0.2, stiffness=100.0, damping=0.02, pins=[(0, 0), (-1, 0), (0, -1), (-1, -1)]
)
ball = cs.Sphere((0.7, -0.35, 0.5), 0.15)
scene = cs.Scene(cloth, ball)
stepper = cs.Stepper(scene)
pushed = []
for angle in np.linspace(0, 2 * np.pi, 61)[1:]:
    center = (0.5 + 0.2 * np.cos(angle), -0.3 + 0.25 * np.sin(angle), 0.5)
    stepper.advance(50, 5e-4, centers={0: center})
    moved = scene.replace(spheres=[ball.replace(center=center)])
    pushed.append(cs.penetration(stepper.positions, moved.spheres[0])["triangles"])
    if len(pushed) == 30:
        cs.picture(moved, stepper.positions, path="ball_by_hand.png")
print(f"after {stepper.time:.2f} s; deepest triangle inside the ball {1e3 * max(pushed):.3f} mm")
