# SPDX-License-Identifier: Apache-2.0
"""A towel on a table is grasped by two corners, lifted, folded over and let go, one control interval after another.

Run it with `python examples/06_fold_a_towel.py`.
"""

import numpy as np

import cama

SIDE = 0.4  # m
HEIGHT = 0.15  # m, of the lifted corners at half of the way
INTERVAL = 1 / 60  # s, between two commands
FOLD = 90  # intervals
SETTLE = 60

scene = cama.Scene(thickness=2e-3, friction=0.3)
towel = scene.add_cloth(
    shape={"grid": {"size": [SIDE, SIDE], "cells": [16, 16]}}, material="cotton", translate=(0, 0, 0.003), name="towel"
)
scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=0.6, name="table")

simulation = cama.Simulation(scene, accuracy="interactive", time_step=INTERVAL / 3)
steps = round(INTERVAL / simulation.time_step)

# The two corners at the far side are grasped where they are.
x, y, _ = towel.vertices.T
corners = [int(np.argmax(y - x)), int(np.argmax(y + x))]
start = simulation.positions[corners]
simulation.pin(corners)

# They go over to the near side along half an ellipse; each interval says where they are at its end.
intersections, missed = 0, 0.0
for k in range(1, FOLD + 1):
    angle = np.pi * k / FOLD
    target = start.copy()
    target[:, 1] = start[:, 1] * np.cos(angle) + 0.02 * (1 - np.cos(angle)) / 2
    target[:, 2] = start[:, 2] + HEIGHT * np.sin(angle) + 0.006 * (1 - np.cos(angle)) / 2
    simulation.set_targets(corners, target, duration=INTERVAL)
    simulation.step(steps)
    missed = max(missed, np.abs(simulation.positions[corners] - target).max())
    intersections += simulation.count_intersections()

simulation.release(corners)
for _ in range(SETTLE):
    simulation.step(steps)
    intersections += simulation.count_intersections()

cloth = simulation.positions[: simulation.cloth_vertex_count]
print(f"time: {simulation.time:.3f} s")
print(f"corners missed their targets by: {missed:.3e} m")
print(f"folded from: {SIDE:.3f} m to {np.ptp(cloth[:, 1]):.3f} m")
print(f"intersections: {intersections}")
