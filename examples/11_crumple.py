# SPDX-License-Identifier: Apache-2.0
"""Walls crumple a sheet of linen and draw back: with a yield curvature it stays crumpled, without one it lies flat.

Run it with `python examples/11_crumple.py`; with `--record out/crumpled` it records the end of both, for `cama render`,
and with `--film out/crumple` how the one that yields is crumpled.
"""

import argparse

import numpy as np

import cama

SIDE, CLOSED = 0.3, 0.16  # m, of the sheet and between the walls
CLOSING, OPENING, RESTING = 1.2, 0.6, 1.7  # s
WALLS = {"left": (1, 0, 0), "right": (-1, 0, 0), "front": (0, 1, 0), "back": (0, -1, 0)}  # and their normals

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--triangles", type=int, default=3000)
arguments.add_argument("--yield-curvature", type=float, default=25.0, help="1/m")
arguments.add_argument("--record", help="folder to write to")
arguments.add_argument("--film", help="folder to write all frames of the one that yields to")
arguments = arguments.parse_args()


def crumple(yield_curvature, folder=None):
    """Returns the simulation at its end; folder: where to record it."""
    linen = cama.Material.fabric("linen")
    linen.yield_curvature, linen.damping, linen.mass_damping = yield_curvature, 2e-3, 3.0
    scene = cama.Scene(thickness=1.5e-3, frame_time=1 / 30)
    grid = {"grid": {"size": [SIDE, SIDE]}, "triangles": arguments.triangles}
    sheet = scene.add_cloth(shape=grid, material=linen, translate=(0, 0, 0.004), name="sheet")
    scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=0.05, name="floor")
    away = SIDE / 2 + 0.02
    for name, normal in WALLS.items():
        scene.add_obstacle(
            shape={"shape": {"plane": {"normal": list(normal)}}},
            translate=[-away * c for c in normal],
            friction=0.1,
            name=name,
        )
    simulation = cama.Simulation(scene, accuracy="interactive", time_step=1 / 120)
    x, y, z = sheet.vertices.T  # a small bump and ripples, so that it buckles upwards
    bump = 0.012 * np.exp(-((x - 0.03) ** 2 + (y + 0.02) ** 2) / 0.004) + 0.008 * np.sin(40 * x + 25 * y) ** 2
    simulation.set_state(np.column_stack([x, y, z + bump]), np.zeros_like(sheet.vertices))

    def push(simulation):
        time = simulation.time + simulation.time_step
        closed = min(time / CLOSING, max(0.0, 1 - (time - CLOSING) / OPENING))
        for name, normal in WALLS.items():
            simulation.set_obstacle_pose(name, [closed * (away - CLOSED / 2) * c for c in normal])

    simulation.before_step = push
    frames = round((CLOSING + OPENING + RESTING) / scene.frame_time)
    if folder:
        cama.record(simulation, folder, frames)
    else:
        simulation.step(round(frames * scene.frame_time / simulation.time_step))
    return simulation


def height(simulation):
    """Mean of all vertices, m."""
    return simulation.positions[: simulation.cloth_vertex_count, 2].mean()


elastic, plastic = crumple(0.0), crumple(arguments.yield_curvature, arguments.film)
print(f"height: {1e3 * height(elastic):.1f} mm elastic, {1e3 * height(plastic):.1f} mm plastic")
kept = np.linalg.norm(plastic.plastic_curvature * (1, 1, np.sqrt(0.5)), axis=1)
print(f"creased: {100 * (kept > 0).mean():.0f} % of the triangles, by up to {kept.max():.0f} 1/m")
print(f"intersections: {elastic.count_intersections() + plastic.count_intersections()}")

if arguments.record:
    both = cama.Scene(gravity=(0, 0, 0), contact=False)
    for name, simulation, shift in (("elastic", elastic, -0.19), ("plastic", plastic, 0.19)):
        positions = simulation.positions[: simulation.cloth_vertex_count]
        faces = simulation.scene.cloths[0].faces
        middle = positions.mean(axis=0) * (1, 1, 0)
        both.add_cloth(positions - middle + (shift, 0, 0), faces, material="linen", name=name)
    both.add_obstacle(shape={"shape": {"plane": {}}}, name="floor")
    cama.record(cama.Simulation(both), arguments.record, frames=1)
