# SPDX-License-Identifier: Apache-2.0
"""The strip tensile test: ISO 13934-1, 200 mm between the jaws, 50 mm wide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import count, reals
from ..errors import ArrayError
from ..material import Material
from .specimens import angle_of, equilibrium, settle, specimen, strip_mesh

LENGTH, WIDTH = 0.2, 0.05  # m
STRETCHES = (0.01, 0.02, 0.05)


@dataclass(frozen=True)
class Tensile:
    """A strip between two jaws."""

    direction: str  #: "warp", "weft" or "bias"
    stretch: tuple[float, ...]  #: of the jaws' distance, 1
    force: tuple[float, ...]  #: on a jaw, over the strip's width, N/m
    middle_stretch: tuple[float, ...]  #: of the middle tenth, where the jaws do not hold the width, 1
    expected: tuple[float, ...] | None  #: force by the constitutive law at the stretch of the middle, N/m


def is_constant(material: Material) -> bool:
    """Whether the stretching stiffness does not depend on the strain."""
    return bool(np.ptp(material.stretching, axis=0).max() == 0)


def modulus(material: Material, direction: str) -> float:
    """Returns Young's modulus times thickness in a direction, N/m, of a material of constant stiffness.

    It is one over the compliance: 1/Y = c^4 S11 + s^4 S22 + c^2 s^2 (2 S12 + S66), with c and s of the angle from the
    warp, S the inverse of the stiffness and S66 = 1/G.
    """
    k11, k12, k22, k33 = material.stretching[0]
    determinant = k11 * k22 - k12 * k12
    if not (determinant > 0 and k33 > 0):
        return 0.0
    c, s = np.cos(angle_of(direction)), np.sin(angle_of(direction))
    s11, s22, s12, s66 = k22 / determinant, k11 / determinant, -k12 / determinant, 2 / k33
    return float(1 / (c**4 * s11 + s**4 * s22 + c * c * s * s * (2 * s12 + s66)))


def uniaxial_force(young: float, stretch: float) -> float:
    """Returns the force over the width at rest, N/m, of a strip that is free to narrow: Y (1 + e) (e + e^2/2)."""
    return young * (1 + stretch) * (stretch + stretch * stretch / 2)


def tensile(
    material: Material | str,
    direction: str = "warp",
    stretches: Sequence[float] = STRETCHES,
    length: float = LENGTH,
    width: float = WIDTH,
    cells: int = 40,
) -> Tensile:
    """Simulates the strip tensile test.

    Args:
        material: A `cama.Material`, or what `Material.of` accepts.
        direction: Direction of the strip: "warp", "weft" or "bias".
        stretches: Increases of the jaws' distance over their distance, rising from above 0.
        length: Distance of the jaws at the start, m.
        width: m; rounded to an even number of cells.
        cells: Number of cells along the strip, at least 4.

    Raises:
        ArrayError: The direction is unknown, the stretches do not rise, or there are too few cells.
        SolverError: The strip did not come to rest.
    """
    fabric = Material.of(material)
    wanted = reals("tensile: stretches", list(stretches), (None,))
    if not (np.diff(wanted, prepend=0) > 0).all():
        raise ArrayError(f"tensile: stretches {wanted.tolist()} do not rise from above 0")
    if count("tensile: cells", cells) < 4:
        raise ArrayError(f"tensile: cells is {cells}; give at least 4")
    vertices, faces = strip_mesh(length, width, cells)
    low, high = (np.flatnonzero(np.abs(vertices[:, 0] - x) < 1e-9) for x in (0.0, length))
    scene = specimen(fabric, vertices, faces, low, angle_of(direction), gravity=0.0)
    simulation = equilibrium(scene, forces=True)
    simulation.pin(high)
    cell, half = length / cells, max(1, round(cells / 20))
    ends = [np.abs(vertices[:, 0] / cell - k) < 0.1 for k in (cells // 2 - half, cells // 2 + half)]
    force, middle = [], []
    at_jaw = np.pad(vertices[high], ((0, 0), (0, 1)))
    for stretch in wanted:
        simulation.set_targets(high, at_jaw + [stretch * length, 0, 0])
        settle(simulation, 1e-8 * length, what=f"strip along the {direction}")
        force.append(-float(simulation.force_on(high).force[0]) / float(np.ptp(vertices[:, 1])))
        x = simulation.positions[:, 0]
        middle.append(float(x[ends[1]].mean() - x[ends[0]].mean()) / (2 * half * cell) - 1)
    expected = None
    if is_constant(fabric):
        expected = tuple(uniaxial_force(modulus(fabric, direction), e) for e in middle)
    return Tensile(direction, tuple(wanted.tolist()), tuple(force), tuple(middle), expected)
