# SPDX-License-Identifier: Apache-2.0
"""Meshes from NumPy arrays, states in and out, contacts as an array: `python examples/04_arrays_in_out.py`.

With a file name behind it, such as checkpoint.h5, the program also writes a checkpoint and continues from it.
"""

import sys

import numpy as np
from numpy.typing import NDArray

import cama

GRAVITY = 9.81  # m/s^2
HEIGHT = 0.3  # m


def grid(cells: int, size: float, z: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices [n, 3] and triangles [m, 3] of a square sheet around the z axis."""
    line = (np.arange(cells + 1) / cells - 0.5) * size
    x, y = np.meshgrid(line, line, indexing="ij")
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1), np.concatenate(
        [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    )


# --- Arrays in: any float array [n, 3] and any integer array [m, 3] ---------------------------------------------------
vertices, faces = grid(cells=12, size=0.4, z=HEIGHT)
scene = cama.Scene(thickness=2e-3, time_step=1 / 400, frame_time=1 / 50)
scene.add_cloth(vertices, faces, material=cama.Material.isotropic(1000, 0.3, bending=1e-5, density=0.15), name="napkin")
scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=0.5, name="table")  # the half space below z = 0
simulation = cama.Simulation(scene)

# --- Arrays out: copies of the state, float64 -------------------------------------------------------------------------
n = simulation.cloth_vertex_count
simulation.step(50)
steps, dt = simulation.step_count, simulation.time_step
fallen = HEIGHT - np.average(simulation.positions[:n, 2], weights=simulation.masses)
# BDF2, the scheme of the default level, begins with a step of backward Euler: in n steps it falls by the exact
# g (n dt)^2 / 2, and by 3/4 g dt^2 (1 - 3^-n) more.
closed_form = GRAVITY * dt**2 * (steps**2 / 2 + 0.75 * (1 - 3.0**-steps))
print(f"fallen: {fallen:.9f} m, closed form: {closed_form:.9f} m")

# --- A state in: put the cloth flat above the table, at rest ----------------------------------------------------------
positions = vertices.copy()
positions[:, 2] = 0.01
simulation.set_state(positions, np.zeros_like(positions))
simulation.step(100)

# Contacts of the last step: a structured array with vertices, weights, normal, distance and kind.
contacts = simulation.contacts
print(f"contacts: {len(contacts)}, closest: {contacts['distance'].min() * 1e3:.3f} mm")
print(f"weight: {simulation.masses.sum() * GRAVITY:.6f} N")
print(f"intersections: {simulation.count_intersections()}")

# --- A checkpoint: later steps are the same, bit by bit ---------------------------------------------------------------
if len(sys.argv) > 1:
    simulation.save_checkpoint(sys.argv[1])
    simulation.step(10)
    again = cama.Simulation(scene)
    again.load_checkpoint(sys.argv[1])
    again.step(10)
    print(f"the same after the checkpoint: {again.state_hash == simulation.state_hash}")
