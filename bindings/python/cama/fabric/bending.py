# SPDX-License-Identifier: Apache-2.0
"""The cantilever test of bending: ASTM D1388, option A; BS 3356; FAST-2."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import MaterialError, SolverError
from ..material import Material
from .specimens import GRAVITY, angle_of, equilibrium, settle, specimen, strip_mesh

SLOPE = 41.5  # degrees below the horizontal, of the line from the platform's edge to the tip
# Weight per area times length^3 over flexural rigidity of an inextensible heavy strip whose chord has that slope: the
# elastica B theta'' = w (L - s) cos(theta), theta(0) = 0, theta'(L) = 0. The standard rounds it to 8.
ELASTICA = 8.004197
WIDTH = 0.025  # m


@dataclass(frozen=True)
class Cantilever:
    """A strip that was pushed over an edge until its tip reached a slope of 41.5 degrees."""

    direction: str  #: "warp", "weft" or "bias"
    overhang: float  #: length beyond the edge, m
    bending_length: float  #: half the overhang, m
    flexural_rigidity: float  #: weight per area times bending length cubed, N m
    expected: float | None  #: the bending length by the elastica and the material's stiffness, m


def bending_stiffness(material: Material, direction: str) -> float | None:
    """Returns the plate's bending stiffness in a direction, N m; None if it varies with curvature.

    Along the bias it is the mean of warp and weft, as `Material.orthotropic` sets it.
    """
    per_plate = Material.isotropic(1.0, 0.0, 1.0, 1.0).bending[0][0]
    row = np.asarray(material.bending)[{"weft": 0, "bias": 1, "warp": 2}[direction]]  # rows: directions of fold lines
    return float(row[0] / per_plate) if np.ptp(row) <= 1e-12 * row.max() else None


def bending_length_of(stiffness: float, density: float) -> float:
    """Returns the bending length, m, of a bending stiffness, N m, and a mass per area, kg/m^2, by the elastica."""
    return (ELASTICA * stiffness / (density * GRAVITY)) ** (1 / 3) / 2


def flexural_rigidity_of(bending_length: float, density: float) -> float:
    """Returns w c^3, N m, of a bending length, m, and a mass per area, kg/m^2 (ASTM D1388)."""
    return density * GRAVITY * bending_length**3


def slope(material: Material, overhang: float, direction: str = "warp", cells: int = 24) -> float:
    """Returns how far the chord of a strip lies below the horizontal, degrees, at an overhang in m.

    Two strips hang from one line of held vertices, so that symmetry clamps both.
    """
    vertices, faces = strip_mesh(2 * overhang, min(WIDTH, overhang), 2 * cells)
    vertices[:, 0] -= overhang
    held = np.abs(vertices[:, 0]) < 0.1 * overhang / cells
    simulation = equilibrium(specimen(material, vertices, faces, held, angle_of(direction)))
    settle(simulation, 1e-5 * overhang, what=f"strip of {1e3 * overhang:.1f} mm")
    tip = simulation.positions[vertices[:, 0] > overhang * (1 - 1e-9)].mean(axis=0)
    return math.degrees(math.atan2(-tip[2], tip[0]))


def cantilever(material: Material | str, direction: str = "warp", cells: int = 24) -> Cantilever:
    """Simulates the cantilever test: the overhang at which the chord has a slope of 41.5 degrees.

    Args:
        material: A `cama.Material`, or what `Material.of` accepts.
        direction: Direction of the strip, 25 mm wide: "warp", "weft" or "bias".
        cells: Number of cells along the overhang.

    Raises:
        ArrayError: The direction is unknown.
        MaterialError: The fabric has no bending stiffness.
        SolverError: No overhang was found.
    """
    fabric = Material.of(material)
    angle_of(direction)
    if not np.any(fabric.bending):
        raise MaterialError(f"{fabric.name}: has no bending stiffness, so that its bending length is 0")
    stiffness = bending_stiffness(fabric, direction)
    near = float(np.asarray(fabric.bending).mean()) / Material.isotropic(1.0, 0.0, 1.0, 1.0).bending[0][0]
    overhang = 2 * bending_length_of(stiffness or near, fabric.density)
    for _ in range(20):
        found = slope(fabric, overhang, direction, cells)
        if abs(found - SLOPE) < 0.005:
            break
        # the slope grows with the cube of the length at first, later less: d(slope)/d(log length) is near 75 degrees
        overhang *= math.exp(min(max((SLOPE - found) / 75, -0.5), 0.5))
    else:
        raise SolverError(f"{fabric.name}: no overhang along the {direction} has a slope of {SLOPE} degrees")
    length = overhang / 2
    return Cantilever(
        direction,
        overhang,
        length,
        flexural_rigidity_of(length, fabric.density),
        None if stiffness is None else bending_length_of(stiffness, fabric.density),
    )
