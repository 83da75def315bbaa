# SPDX-License-Identifier: Apache-2.0
"""Two balls fall into a hammock and come to rest; the cloth carries their weight: `python examples/12_hammock.py`."""

import sys

import numpy as np

import cama

SIDE = 0.8  # m
CELLS = 32
RADIUS = 0.11  # m
MASS = 0.8  # kg
SETTLE = 4.0  # s
DAMPING = 0.1  # s, of the hammock: a ball would bounce on plain cotton for long

scene = cama.Scene(thickness=2e-3, name="hammock")
last = CELLS * (CELLS + 1)
material = cama.Material.fabric("cotton")
material.damping = DAMPING
scene.add_cloth(shape={"grid": {"size": [SIDE, SIDE], "cells": [CELLS, CELLS]}}, material=material, name="hammock")
scene.pin("hammock", [0, CELLS, last, last + CELLS])
BALLS = {"ball": (0.03, 0.01, RADIUS + 0.15), "second ball": (-0.06, 0.0, 3 * RADIUS + 0.25)}  # places, m
for name, place in BALLS.items():
    scene.add_obstacle(
        shape={"sphere": {"radius": RADIUS, "triangles": 720}},
        translate=place,
        rigid=cama.Rigid(mass=MASS, angular_velocity=(0, 3, 0)),
        name=name,
    )
if len(sys.argv) > 1:  # for `cama render`
    scene.save(sys.argv[1])
    sys.exit()

simulation = cama.Simulation(scene, time_step=1 / 120)
solves = []
while simulation.time < SETTLE:
    simulation.step()
    solves.append(simulation.report["rigid_solves"])
steps = 60
simulation.step(steps)
poses = [simulation.rigid_pose(name) for name in BALLS]
load = sum(simulation.force_on(name).impulse for name in BALLS) / (steps * simulation.time_step)
apart = np.linalg.norm(poses[1].center - poses[0].center)

print(f"time: {simulation.time:.3f} s")
for name, pose in zip(BALLS, poses, strict=True):
    print(f"the {name} is {-pose.center[2]:.3f} m below the pins, at {np.linalg.norm(pose.velocity):.1e} m/s")
print(f"they are {1000 * (apart - 2 * RADIUS):.2f} mm apart")
print(f"load: {load[2]:.4f} N, weight: {2 * MASS * 9.81:.4f} N")
print(f"solves of the cloth a step: {np.mean(solves):.2f}")
print(f"intersections: {simulation.count_intersections()}")
