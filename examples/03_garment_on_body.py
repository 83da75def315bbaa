# SPDX-License-Identifier: Apache-2.0
"""A wool skirt on a walking body, both generated: `python examples/03_garment_on_body.py`.

With a character of your own, replace "walker" by {"character": {"file": "walk.glb"}}; with a skirt of your own,
"garment" by {"file": "skirt.obj"}, or by {"file": {"path": "skirt.obj", "rest": "uv"}} if its texture coordinates are
its pattern in metres.
"""

import numpy as np

import cama

# A scene can be described in Python or, as here, in the words of scene.json; docs/guide/scenes.md explains them.
scene = cama.Scene.parse(
    {
        "name": "skirt",
        "frame_time": 0.02,
        "contact": {"thickness": 1.5e-3, "friction": 0.3},
        "obstacles": [
            {"name": "body", "walker": {"height": 1.7, "rest": 0.1, "duration": 1, "cell": 0.04}, "friction": 0.3}
        ],
        "cloth": [
            {
                "name": "skirt",
                "material": "wool",
                "triangles": 1200,
                "garment": {"skirt": {"body": "body", "waist": 1.06, "hip": 0.97, "length": 0.45, "panels": 8}},
            }
        ],
        # The top ring of the skirt follows the nearest points of the body's surface.
        "pins": [{"cloth": "skirt", "edge": "waist", "attach": "body"}],
    }
)
skirt = scene.cloths[0]
waist = scene.pins[0]["vertices"]

simulation = cama.Simulation(scene, accuracy="interactive")
first, last = simulation.cloth_ranges[0]

intersections, lowest = 0, np.inf
for frame in simulation.frames(25):
    intersections += frame.intersections
    lowest = min(lowest, frame.positions[first:last, 2].min())

print(f"triangles: {simulation.cloth_triangle_count}")
print(f"rest area: {skirt.rest_area:.6f} m^2, mass: {simulation.masses.sum():.6f} kg")
print(f"waist: {len(waist)} vertices, at z = {frame.positions[first:last][waist, 2].mean():.3f} m")
print(f"lowest point of the hem: z = {lowest:.3f} m")
print(f"intersections: {intersections}")
