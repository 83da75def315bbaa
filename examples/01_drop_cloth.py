# SPDX-License-Identifier: Apache-2.0
"""A cotton sheet falls on a ball: `python examples/01_drop_cloth.py`.

With a file name behind it, such as ball.json, the program also writes the scene: `cama run ball.json` records it, and
`cama render` draws the recording.
"""

import sys

import cama

THICKNESS = 1.5e-3  # m: contact acts below this distance
RADIUS = 0.25  # m

# A scene is what to simulate. Lengths are in metres, z is up, gravity pulls down by 9.81 m/s^2.
scene = cama.Scene(name="ball", thickness=THICKNESS, frames=48)

# A square of 1 m x 1 m in a horizontal plane, made of about 500 triangles, 10 mm above the ball. "cotton" is a shipped
# fabric; cama.fabrics() lists them all.
scene.add_cloth(
    shape={"grid": {"size": [1, 1]}, "triangles": 500}, material="cotton", translate=(0, 0, RADIUS + 0.01), name="sheet"
)

# {"shape": {"sphere": ...}} is an exact sphere; {"sphere": ...} without "shape" would be a mesh of triangles.
scene.add_obstacle(shape={"shape": {"sphere": {"radius": RADIUS}}}, friction=0.3, name="ball")

if len(sys.argv) > 1:
    scene.save(sys.argv[1])

# A simulation is how to compute it. "interactive" is fast; the default, "production", is more accurate and slower.
simulation = cama.Simulation(scene, accuracy="interactive")

# A frame is 1/60 s here and takes several time steps. Each frame has the positions of all vertices, [n, 3], and counts
# how many edges pass through a face: with exact arithmetic, so 0 means that nothing intersects.
intersections = 0
for frame in simulation.frames(48):
    intersections += frame.intersections

# Contacts of the last step: a structured array, one row for each pair of features that touch.
contacts = simulation.contacts

print(f"triangles: {simulation.cloth_triangle_count}")
print(f"time: {simulation.time:.3f} s in {simulation.step_count} steps")
print(f"contacts: {len(contacts)}, closest: {contacts['distance'].min() * 1e3:.3f} mm")
print(f"intersections: {intersections}")
