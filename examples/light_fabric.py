"""Hang measured fabrics, and ask which term limits the time step of each.

Densities and moduli are those of the database of Wang, O'Brien and Ramamoorthi, ACM Trans. Graph.
30(4) 71 (2011): a rib knit of cotton and an 11 oz denim. With the tensile modulus Y and the shear
modulus G [N/m], shear springs of a square grid have the stiffness G and structural springs Y - G,
which stores the energy of the fabric in both strains.
"""

import clothsim as cs

FABRICS = {
    "cotton": (0.276, 108.0, 41.6),
    "denim": (0.324, 1219.2, 26.7),
}  # kg/m^2; Y, mean of warp and weft, and G [N/m]

for name, (density, tensile, shear) in FABRICS.items():
    stiffness = {"structural": tensile - shear, "shear": shear}
    scene = cs.Scene(
        cs.Cloth(
            (12, 12),
            mass=density,
            stiffness=stiffness,
            damping=0.01,
            springs=("structural", "shear"),
        )
    )
    print(f"{name:7} stable up to {cs.max_stable_dt(scene):.2e} s: {scene.explain()['limited_by']}")
    run = cs.simulate(scene, 0.05, dt=0.5 * cs.max_stable_dt(scene))
    print(f"        largest stretch {100 * run.report['stretch']['largest']:.2f} %")
    run.picture(path=f"light_fabric_{name}.png", color="stretch", label=True)
