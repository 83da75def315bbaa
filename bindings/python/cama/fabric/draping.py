# SPDX-License-Identifier: Apache-2.0
"""The drape test of Cusick: BS 5058, ISO 9073-9. A round specimen hangs over the edge of a smaller disc."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import count, number
from ..errors import ArrayError
from ..material import Material
from ..measuring.surface import areas, drape_coefficient
from ..simulation import Simulation
from ..types import Integers, Reals
from .specimens import annulus_mesh, specimen

DISC, SPECIMEN = 0.09, 0.15  # radii, m
SECTORS = 144  # of the mesh
WAVES = range(2, 17)  # numbers of waves around the rim in the disturbance of the start
DISTURBANCE = 1e-3  # of the rim at the start, root mean square, m
MASS_DAMPING = 2.0  # 1/s; it brings the cloth to rest and does not change where
STILL = 1e-4  # root mean square of all velocities, m/s
LEAST_FOLD = 2e-3  # m, by which a node's rim stands out from the hollows beside it


@dataclass(frozen=True)
class Drape:
    """A specimen at rest over the disc."""

    coefficient: float  #: (shadow - disc) / (specimen - disc); 1: a board
    nodes: int  #: folds of the rim
    at_rest: bool  #: False: it still moved when the time was over
    vertices: Reals = field(repr=False)  #: [n, 3], m; the disc's top is at z = 0
    faces: Integers = field(repr=False)  #: [m, 3]


def count_nodes(radius: Reals, least: float = LEAST_FOLD) -> int:
    """Returns how often a closed curve of radii [n], m, rises by `least` and falls by it again."""
    start = int(np.argmin(radius))
    low = high = radius[start]
    nodes, rising = 0, True
    for r in [*np.roll(radius, -start), radius[start]]:
        low, high = min(low, r), max(high, r)
        if rising and high - r >= least and high - low >= least:
            nodes, rising, low = nodes + 1, False, r
        elif not rising and r - low >= least:
            rising, high = True, r
    return nodes


def disturbance(vertices: Reals, seed: int) -> Reals:
    """Returns heights [n], m, of a flat specimen that random waves of the rim disturb."""
    random = np.random.default_rng(seed)
    angle, radius = np.arctan2(vertices[:, 1], vertices[:, 0]), np.hypot(vertices[:, 0], vertices[:, 1])
    part = np.clip((radius - DISC) / (SPECIMEN - DISC), 0, None)
    waves = sum(random.normal() * np.cos(n * angle) + random.normal() * np.sin(n * angle) for n in WAVES)
    return DISTURBANCE / np.sqrt(len(WAVES)) * part**2 * waves


def drape(
    material: Material | str, seed: int = 0, sectors: int = SECTORS, seconds: float = 30.0, backend: str = "cpu"
) -> Drape:
    """Simulates Cusick's drape test: a specimen of 30 cm, held flat on a disc of 18 cm, falls from the plane.

    Like a real specimen, one fabric drapes in different ways: the random waves that disturb its start decide. The
    cloth's ring beyond the disc is simulated, with contact of the folds.

    Args:
        material: A `cama.Material`, or what `Material.of` accepts.
        seed: Of the random waves.
        sectors: Number of cells around; the mesh has about sectors^2 / 6 triangles.
        seconds: Simulated time after which it ends if the cloth has not come to rest.
        backend: "cpu", "cuda" or "opencl", as of a Simulation.

    Raises:
        ArrayError: An argument is out of its range.
        SolverError, CollisionError: A step cannot be computed.
    """
    fabric = Material.of(material)
    if count("drape: sectors", sectors) < 24:
        raise ArrayError(f"drape: sectors is {sectors}; give at least 24")
    rings = max(3, round(sectors * (SPECIMEN - DISC) / (np.pi * (SPECIMEN + DISC))))
    mesh = annulus_mesh(DISC, SPECIMEN, sectors, rings)
    return drape_mesh(fabric, mesh, sectors, count("drape: seed", seed), number("drape: seconds", seconds), backend)


def drape_mesh(
    material: Material,
    mesh: tuple[Reals, Integers],
    sectors: int,
    seed: int = 0,
    seconds: float = 30.0,
    backend: str = "cpu",
) -> Drape:
    """Drapes a ring of cloth of any mesh; see `drape`.

    Args:
        mesh: Vertices [n, 2], m, and faces. The first two rings of `sectors` vertices are held, the last is the rim.
    """
    fabric = Material(material)
    fabric.mass_damping = MASS_DAMPING
    vertices, faces = mesh
    start = np.column_stack([vertices, disturbance(vertices, seed)])
    held = np.arange(2 * sectors)
    scene = specimen(fabric, vertices, faces, held, start=start, contact=True)
    step = 1 / 60
    simulation = Simulation(
        scene,
        backend=backend,
        integrator="backward_euler",
        newton_iterations=4,
        precision="mixed",
        tolerance=1e-3,
        time_step=step,
    )
    at_rest = False
    for _ in range(round(seconds / step)):
        simulation.step()
        speed = float(np.sqrt(np.mean(np.sum(simulation.velocities**2, axis=1))))
        if speed < STILL and simulation.time > 0.5:
            at_rest = True
            break
    return _measured(simulation.positions, vertices, faces, sectors, at_rest)


def _measured(positions: Reals, rest: Reals, faces: Integers, sectors: int, at_rest: bool) -> Drape:
    """Returns the Drape of a ring of cloth, with the part on the disc as a fan about a vertex in its middle."""
    first = np.arange(sectors)
    fan = np.column_stack([np.full(sectors, len(positions)), first, np.roll(first, -1)])
    every = np.concatenate([faces, fan]).astype(np.int32)
    at = np.concatenate([positions, np.zeros((1, 3))])
    flat = np.concatenate([np.pad(rest, ((0, 0), (0, 1))), np.zeros((1, 3))])
    # the polygons of the mesh stand for the circles, so that a flat specimen has 100 %
    disc = float(np.sqrt(sectors / (2 * np.pi) * np.sin(2 * np.pi / sectors))) * DISC
    coefficient = drape_coefficient(at, every, disc, float(areas(flat, every).sum()))
    nodes = count_nodes(np.hypot(*positions[-sectors:, :2].T))
    return Drape(coefficient, nodes, at_rest, at, every)
