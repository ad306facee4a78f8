"""The gather kernel gives one set of bits, whatever the instruction set and number of threads."""

import hashlib
import os
import subprocess
import sys

import clothsim as cs

if len(sys.argv) > 1:
    scene = cs.scenes.paper_static(bend=True)
    x, v = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, x, v, 1e-4, 6_000, kernel="gather", threads=int(sys.argv[1]))
    print(hashlib.sha256(x.tobytes() + v.tobytes()).hexdigest()[:16])
else:
    for isa in cs.build_config()["instruction_sets_supported"]:
        for threads in "12":
            command = [sys.executable, sys.argv[0], threads]
            environment = {**os.environ, "CLOTHSIM_ISA": isa}
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=True
            )
            print(f"{isa:7} {threads} threads {done.stdout.strip()}")
    cs.simulate(cs.scenes.paper_static(bend=True), 0.6, dt=1e-4, kernel="gather").picture(
        path="gather_bits.png"
    )
