"""Drape a sheet over a ball: whole triangles stay outside, friction holds the cloth."""

import clothsim as cs

cloth = cs.Cloth(
    shape=(16, 16),
    size=(1.0, 1.0),
    mass=0.3,
    stiffness=200.0,
    damping=0.02,
    pins=(),
    springs=("structural", "shear"),
)
ball = cs.Sphere(center=(0.5, -0.33, 0.5), radius=0.3, friction=0.5)
scene = cs.Scene(cloth, ball)

run = cs.simulate(scene, 0.4, fps=50)
print(run)
print("deepest triangle inside the ball [m]:", run.report["penetration"]["triangles"])
run.animate("drape.webp", fps=25, speed=0.25)
