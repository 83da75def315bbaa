# SPDX-License-Identifier: Apache-2.0
"""The picture frame test of shear: a square of cloth in four hinged bars, pulled along a diagonal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import reals
from ..errors import ArrayError
from ..material import Material
from .specimens import equilibrium, settle, specimen, strip_mesh
from .stretching import is_constant

SIDE = 0.2  # m
ANGLES = (1.0, 2.5, 5.0, 10.0, 20.0, 30.0)  # degrees
KES_ANGLES = (0.5, 2.5)  # degrees, between which KES-FB1 takes its slope


@dataclass(frozen=True)
class PictureFrame:
    """A square with its yarns along four hinged bars."""

    angle: tuple[float, ...]  #: shear angle, degrees: 90 minus the angle between the bars
    force: tuple[float, ...]  #: along the diagonal, N
    shear_force: tuple[float, ...]  #: along the bars, over their length, N/m
    shear_rigidity: float  #: slope of the shear force from 0.5 to 2.5 degrees, N/m for each radian
    expected: tuple[float, ...] | None  #: force by the constitutive law, N


def corner_force(shear: float, angle: float, side: float = SIDE) -> float:
    """Returns the force along the diagonal, N, at a shear angle in radians.

    With bars of constant length, E11 = E22 = 0 and E12 = sin(angle)/2: the energy is side^2 G sin^2(angle)/2, and the
    diagonal 2 side cos(pi/4 - angle/2); the force is the quotient of their derivatives.
    """
    return side * shear * math.sin(angle) * math.cos(angle) / math.sin(math.pi / 4 - angle / 2)


def picture_frame(material: Material | str, angles: Sequence[float] = ANGLES, cells: int = 10) -> PictureFrame:
    """Simulates the picture frame test; the bars are 200 mm long.

    Args:
        material: A `cama.Material`, or what `Material.of` accepts.
        angles: Shear angles, degrees, rising from above 0 to below 90.
        cells: Number of cells along a bar.

    Raises:
        ArrayError: The angles do not rise, or are outside their range.
        SolverError: The cloth did not come to rest.
    """
    fabric = Material.of(material)
    wanted = reals("picture_frame: angles", list(angles), (None,))
    if not ((np.diff(wanted, prepend=0) > 0).all() and (wanted < 90).all()):
        raise ArrayError(f"picture_frame: angles {wanted.tolist()} do not rise from above 0 to below 90 degrees")
    vertices, faces = strip_mesh(SIDE, SIDE, cells)
    vertices[:, 1] += SIDE / 2
    bars = np.flatnonzero((vertices < 1e-9).any(axis=1) | (vertices > SIDE - 1e-9).any(axis=1))
    scene = specimen(fabric, vertices, faces, bars, gravity=0.0)
    simulation = equilibrium(scene, forces=True)
    simulation.pin(bars)

    u, v = vertices[bars, :1], vertices[bars, 1:]

    def force_at(angle: float) -> float:
        c, s = math.cos(angle / 2), math.sin(angle / 2)
        simulation.set_targets(bars, u * [c, s, 0] + v * [s, c, 0])
        settle(simulation, 1e-8 * SIDE, what="cloth in the frame")
        moved = (u * [-s, c, 0] + v * [c, -s, 0]) / 2  # the derivative of the targets by the angle
        work = -float((simulation.forces[bars] * moved).sum())
        return work / (SIDE * math.sin(math.pi / 4 - angle / 2))  # over the derivative of the diagonal

    steps = np.unique(np.concatenate([wanted, KES_ANGLES]))
    found = {float(a): force_at(math.radians(a)) for a in steps}
    along = {a: f * math.sin(math.pi / 4 - math.radians(a) / 2) / SIDE for a, f in found.items()}
    low, high = KES_ANGLES
    chosen = wanted.tolist()
    return PictureFrame(
        tuple(chosen),
        tuple(found[a] for a in chosen),
        tuple(along[a] for a in chosen),
        (along[high] - along[low]) / math.radians(high - low),
        tuple(corner_force(fabric.stretching[0][3] / 2, math.radians(a)) for a in chosen)
        if is_constant(fabric)
        else None,
    )
