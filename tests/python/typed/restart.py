# SPDX-License-Identifier: Apache-2.0
"""A run that stops, and one that goes on from its checkpoint."""

import tempfile
from pathlib import Path

import cama

scene = cama.Scene.load("drape", resolution=100)
first = cama.Simulation(scene, backend="cpu", accuracy="preview")
first.step(2)
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "state.h5"
    first.save_checkpoint(file)
    second = cama.Simulation(scene.copy(), backend="cpu", accuracy="preview")
    different: list[str] = second.load_checkpoint(file)
assert not different and second.state_hash == first.state_hash
second.set_state(second.positions[: second.cloth_vertex_count], 0 * second.velocities[: second.cloth_vertex_count])
energy = second.energy()
total: float = energy["kinetic"] + energy["gravity"]
milliseconds: dict[str, float] = second.timings
print(total, milliseconds)
