# SPDX-License-Identifier: Apache-2.0
"""A sheet over a ball: scene, material, pins, frames."""

import numpy as np
import numpy.typing as npt

import cama


def grid(cells: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    line = np.linspace(-0.5, 0.5, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)], 1), faces


scene = cama.Scene(time_step=0.005, frames=2, gravity=(0, 0, -9.81), wind={"velocity": [1, 0, 0]})
linen = cama.Material.isotropic(1000, 0.3, bending=1e-5, density=0.15).with_thickness(1e-3)
vertices, faces = grid(4)
sheet = scene.add_cloth(vertices, faces, material=linen, name="sheet")
ball = scene.add_obstacle(shape={"sphere": {"radius": 0.25}}, motion=cama.Motion(velocity=(0, 0.1, 0)), friction=0.2)
scene.pin(sheet, vertices=[0, 4], release=0.5)
scene.attach(sheet, [1], ball)
scene.friction = 0.4
scene.gravity = np.array([0.0, 0.0, -9.0])
scene.options = {"accuracy": "production", "tolerance": 1e-4}
height: float = scene.gravity[2]
stretch: tuple[float, float] = sheet.start_strain

simulation = cama.Simulation(scene, backend="cpu", threads=1, preconditioner="jacobi")
for frame in simulation.frames(2):
    moved: npt.NDArray[np.float64] = frame.positions - simulation.velocities
    contacts: int = frame.report["contacts"]
    print(frame.index, frame.time, frame.contacts, frame.intersections, moved.shape, contacts)
residual: float = simulation.report["residual"]
normals = simulation.contacts["normal"]
origin: list[str] = [row["origin"] for row in simulation.chosen_options]
