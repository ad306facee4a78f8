"""A flag in the wind: a force on each triangle, computed with NumPy once a frame."""

import clothsim as cs
import numpy as np

AIR_DENSITY = 1.2  # kg/m^3
WIND = np.array([6.0, 0.0, 1.0])  # m/s

cloth = cs.Cloth((20, 30), (1.0, 1.5), mass=0.2, stiffness=60.0, damping=0.01, pins=[(row, 0) for row in range(20)])
x = cloth.rest_positions[..., [0, 2, 1]] * (1, -1, 1)  # upright, in the plane z = 0
scene = cs.Scene(cloth, position=x)
triangles = cs.triangles(cloth.shape)


def wind_force(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Pressure rho (w . n)^2 / 2 on each triangle by the wind w relative to it, a third on each corner [N]."""
    corners, speeds = x.reshape(-1, 3)[triangles], v.reshape(-1, 3)[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    size = np.linalg.norm(area, axis=1, keepdims=True)
    along = ((WIND - speeds.mean(axis=1)) * area).sum(axis=1, keepdims=True) / size
    on_triangles = AIR_DENSITY / 2 * np.abs(along) * along * area
    force = np.zeros((cloth.rows * cloth.columns, 3))
    np.add.at(force, triangles, on_triangles[:, None] / 3)
    return force.reshape(x.shape)


stepper = cs.Stepper(scene)
t, frames, velocities = [0.0], [stepper.positions], [stepper.velocities]
for _ in range(60):
    stepper.set_force(wind_force(frames[-1], velocities[-1]))
    stepper.advance(100, 1 / 6000)
    t.append(stepper.time)
    frames.append(stepper.positions)
    velocities.append(stepper.velocities)
run = cs.Run(scene, np.array(t), np.array(frames), np.array(velocities), {})
run.animate("flag.webp", fps=20, speed=0.5)
tip = frames[-1][-1, -1]
print(f"after {t[-1]:.2f} s the lower corner is at ({tip[0]:.2f}, {tip[1]:.2f}, {tip[2]:.2f}) m")
