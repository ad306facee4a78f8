"""The simulated objects as plain data: cloth, spheres, motions, scenes, mesh."""
