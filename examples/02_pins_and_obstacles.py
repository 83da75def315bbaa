# SPDX-License-Identifier: Apache-2.0
"""A curtain hangs by two corners, a ball pushes into it, and one corner is let go.

Run it with `python examples/02_pins_and_obstacles.py`.
"""

import numpy as np

import cama

RELEASE = 0.5  # s
SPEED = 0.8  # m/s
START = (0.1, -0.5, 0)  # m, where the ball's centre starts

# The friction of a scene is that of cloth against cloth, for materials that give none of their own.
scene = cama.Scene(thickness=1.5e-3, friction=0.3)

# "plane": "xz" makes the sheet stand upright, with its top edge at z = 0.5 m.
curtain = scene.add_cloth(
    shape={"grid": {"size": [1, 1], "plane": "xz"}, "triangles": 600}, material="silk", name="curtain"
)

# The handle of a cloth has its vertices, so pins can be chosen by position: here the two corners at the top.
x, z = curtain.vertices[:, 0], curtain.vertices[:, 2]
left = int(np.argmin(x - z))
right = int(np.argmax(x + z))
scene.pin(curtain, [left])  # held in place for the whole run
scene.pin(curtain, [right], release=RELEASE)  # held, then let go

# An obstacle moves as it is told; the cloth does not push it back.
ball = scene.add_obstacle(
    shape={"shape": {"sphere": {"radius": 0.15}}},
    translate=START,
    friction=0.2,
    name="ball",
    motion=cama.Motion(velocity=(0, SPEED, 0)),
)

simulation = cama.Simulation(scene, accuracy="interactive")

# Vertices are numbered through all cloths, then all obstacles; the ranges say which belong to which object.
first, last = simulation.cloth_ranges[0]
centre = simulation.obstacle_ranges[0][0]  # an exact sphere has one vertex, its centre
held = simulation.positions[first:last][[left, right]]

intersections, before_release = 0, 0.0
for frame in simulation.frames(54):
    intersections += frame.intersections
    moved = np.linalg.norm(frame.positions[first:last][[left, right]] - held, axis=1)
    if frame.time < RELEASE:
        before_release = max(before_release, moved.max())

print(f"time: {simulation.time:.3f} s")
print(f"corners moved before the release: {before_release:.3e} m")
print(f"corners moved at the end: {moved[0]:.3e} m held, {moved[1]:.3f} m let go")
print(f"ball is at y = {frame.positions[centre, 1]:.6f} m")
print(f"intersections: {intersections}")
