# SPDX-License-Identifier: Apache-2.0
"""Specimens of the tests: regular meshes in material space, directions of cutting, and rest."""

from __future__ import annotations

import numpy as np

from ..errors import ArrayError, SolverError
from ..hints import similar
from ..material import Material
from ..scene import Scene
from ..simulation import Simulation
from ..types import ArrayLike, Integers, Reals

GRAVITY = 9.81  # m/s^2
DIRECTIONS = {"warp": 0.0, "weft": 90.0, "bias": 45.0}  # degrees from the warp
STEP = 0.1  # s, long against every vibration of a specimen


def angle_of(direction: str) -> float:
    """Returns the angle of a direction from the warp, radians. Raises ArrayError."""
    if direction not in DIRECTIONS:
        raise ArrayError(f"direction: {direction!r} is not one of warp, weft and bias{similar(direction, DIRECTIONS)}")
    return float(np.radians(DIRECTIONS[direction]))


def _alternating(first: Integers, second: Integers, third: Integers, fourth: Integers) -> Integers:
    """Returns two triangles for each quad of corners a, b, c, d [m, n], with diagonals that alternate."""
    i, j = np.indices(first.shape)
    even = (i + j) % 2 == 0
    halves = ((first, second, third), (first, third, fourth)), ((first, second, fourth), (second, third, fourth))
    faces = [
        np.stack([corner[chosen] for corner in triangle], axis=1)
        for chosen, pair in zip((even, ~even), halves)
        for triangle in pair
    ]
    return np.concatenate(faces).astype(np.int32)


def strip_mesh(length: float, width: float, cells: int) -> tuple[Reals, Integers]:
    """Returns vertices [n, 2], m, and faces of a strip of square cells from x = 0, centred about y = 0.

    Args:
        length, width: m; the width is rounded to an even number of cells.
        cells: Number of cells along the length.
    """
    cell = length / cells
    rows = max(2, 2 * round(width / cell / 2))
    along, across = cell * np.arange(cells + 1), cell * (np.arange(rows + 1) - rows / 2)
    x, y = np.meshgrid(along, across, indexing="ij")
    index = np.arange(x.size).reshape(x.shape)
    faces = _alternating(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    return np.stack([x.ravel(), y.ravel()], axis=1), faces


def annulus_mesh(inner: float, outer: float, sectors: int, rings: int) -> tuple[Reals, Integers]:
    """Returns vertices [n, 2], m, and faces of a ring of cloth that is clamped at the radius `inner`.

    The two innermost rings of vertices, half a cell inside `inner` and half a cell outside it, are those to hold. A
    plate of triangles is clamped in the middle between them: moments at the outer one bend the held triangles too, as
    far as half of their height goes. The vertices lie ring by ring; the last `sectors` are the rim.
    """
    cell = (outer - inner) / (rings - 0.5)
    radius = inner + cell * (np.arange(rings + 1) - 0.5)
    angle = 2 * np.pi / sectors * np.arange(sectors)
    r, a = np.meshgrid(radius, angle, indexing="ij")
    index = np.arange(r.size).reshape(r.shape)
    turned = np.roll(index, -1, axis=1)
    faces = _alternating(index[:-1], index[1:], turned[1:], turned[:-1])
    return np.stack([(r * np.cos(a)).ravel(), (r * np.sin(a)).ravel()], axis=1), faces


def specimen(
    material: Material,
    vertices: Reals,
    faces: Integers,
    held: ArrayLike,
    direction: float = 0.0,
    start: Reals | None = None,
    gravity: float = GRAVITY,
    contact: bool = False,
) -> Scene:
    """Returns a scene with one cloth, "specimen", whose x axis was cut at an angle from the warp.

    Args:
        material: The fabric.
        vertices: Rest shape [n, 2], m.
        faces: Triangles [m, 3].
        held: Vertices that are held where they start.
        direction: Angle of the x axis from the warp, radians.
        start: Starting positions [n, 3], m; None: flat in z = 0.
        gravity: Downward along z, m/s^2.
        contact: Whether the cloth collides with itself.
    """
    cosine, sine = np.cos(direction), np.sin(direction)
    scene = Scene(gravity=(0, 0, -gravity), contact=contact)
    scene.add_cloth(
        np.pad(vertices, ((0, 0), (0, 1))) if start is None else start,
        faces,
        material=material,
        material_vertices=vertices @ np.array([[cosine, sine], [-sine, cosine]]),
        name="specimen",
    )
    scene.pin("specimen", held)
    return scene


def equilibrium(scene: Scene, forces: bool = False) -> Simulation:
    """Returns a simulation whose steps lead to a static equilibrium: long ones of backward Euler, solved exactly."""
    return Simulation(
        scene,
        backend="cpu",
        threads=1,
        integrator="backward_euler",
        newton_iterations=8,  # whose line search settles tables of stiffness too
        solver="direct",
        precision="double",
        time_step=STEP,
        forces=forces,
    )


def settle(simulation: Simulation, still: float, steps: int = 400, what: str = "specimen") -> None:
    """Steps until no vertex moves by more than `still`, m, in a step. Raises SolverError after that many steps."""
    for _ in range(steps):
        simulation.step()
        moved = float(np.abs(simulation.velocities).max()) * simulation.time_step
        if moved < still:
            return
    raise SolverError(f"the {what} did not come to rest in {steps} steps: it still moves by {moved:.2g} m in a step")
