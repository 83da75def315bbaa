# SPDX-License-Identifier: Apache-2.0
"""Cloth: its size, material, thickness, rest shape and pressure."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .. import _core
from ..parts import Cloth
from ..types import Reals
from .finding import Finding, number
from .measures import areas_of, edges_of, lengths_of, median, ratios_of, sample
from .objects import SPEED, THICK, size

DENSITY = (0.005, 5.0)  # kg/m^2; fabrics have 0.02 to 2
STRETCHING = (1.0, 1e6)  # N/m; fabrics have 100 to 40,000
BENDING = 0.05  # N m, of a hinge; fabrics have 5e-6 to 1e-3
DAMPING = 0.1  # s; fabrics have about 0.001
MASS_DAMPING = 20.0  # 1/s; cloth in air has 0.1 to 3
THICK_EDGES = 5.0  # median edges of the cloth
REST = 2.0  # factor between rest shape and start, median over triangles or edges


def of_cloth(cloth: Cloth, vertices: Reals, across: float, thickness: float) -> Iterator[Finding]:
    """Looks at one piece of cloth.

    Args:
        cloth: The cloth.
        vertices: Its `vertices` [n, 3], m.
        across: Their extent, m.
        thickness: Contact thickness of the scene, m; 0: without contact.
    """
    name = f"cloth '{cloth.name}'"
    yield from size(name, across)
    yield from _material(name, cloth._compiled().material)
    start = edges_of(vertices[sample(cloth.faces)])
    lengths = lengths_of(start)
    yield from _thickness(name, cloth, lengths, across, thickness)
    yield from _rest(name, cloth, start, lengths)
    speed = math.hypot(*cloth._compiled().velocity)
    if speed > SPEED:
        yield Finding("velocity", name, "velocity", f"{number(speed)} m/s at the start", "give metres per second")
    yield from _pressure(name, cloth)


def _material(name: str, material: _core.Material) -> Iterator[Finding]:
    if not DENSITY[0] <= material.density <= DENSITY[1]:
        yield Finding(
            "density",
            name,
            "material.density",
            f"{number(material.density)} kg/m^2",
            "fabrics have 0.02 to 2 kg/m^2: divide g/m^2 by 1000, and multiply kg/m^3 by the fabric's thickness in m",
        )
    rows = material.stretching
    stiffest, softest = max(max(row[0], row[2]) for row in rows), max(rows[0][0], rows[0][2])
    if stiffest > STRETCHING[1]:
        yield Finding(
            "stiffness",
            name,
            "material.stretching",
            f"{number(stiffest)} N/m",
            "fabrics have 100 to 40,000 N/m: multiply Young's modulus in Pa by the fabric's thickness in m",
        )
    elif softest < STRETCHING[0]:
        yield Finding(
            "softness",
            name,
            "material.stretching",
            f"{number(softest)} N/m",
            "fabrics have 100 to 40,000 N/m: give Young's modulus times thickness in N/m, not in N/mm or MPa",
        )
    hinge = max(max(row) for row in material.bending)
    if hinge > BENDING:
        yield Finding(
            "bending",
            name,
            "material.bending",
            f"{number(hinge)} N m (of a hinge, five times the plate's)",
            "fabrics have 5e-6 to 1e-3 N m: give 1 gf cm^2/cm as 9.8e-5 N m, and 1 micro N m as 1e-6",
        )
    if material.damping > DAMPING:
        yield Finding(
            "damping",
            name,
            "material.damping",
            f"{number(material.damping)} s",
            "fabrics have about 0.001 s; give seconds",
        )
    if material.mass_damping > MASS_DAMPING:
        yield Finding(
            "mass damping",
            name,
            "material.mass_damping",
            f"{number(material.mass_damping)} 1/s",
            "cloth in air has 0.1 to 3 1/s, and falls at 9.81 m/s^2 over that; give 1/s",
        )


def _thickness(name: str, cloth: Cloth, lengths: Reals, across: float, thickness: float) -> Iterator[Finding]:
    own = cloth._compiled().material.thickness
    used, element = (own, "thickness") if own > 0 else (thickness, "contact.thickness, the scene's")
    if not thickness:
        return
    if used > THICK * across:
        seen = f"{number(used)} m, and the cloth is {number(across)} m across"
    elif used > THICK_EDGES * lengths.min() and used > THICK_EDGES * median(lengths):
        seen = f"{number(used)} m, and the cloth's edges are {number(median(lengths))} m long"
    else:
        return
    yield Finding(
        "thickness", name, element, seen, "cloth stays this far from obstacles; fabrics have 0.0002 to 0.005 m"
    )


def _rest(name: str, cloth: Cloth, start: Reals, start_lengths: Reals) -> Iterator[Finding]:
    material_faces = cloth.material_faces
    if not len(material_faces):
        return
    rest = edges_of(cloth.material_vertices[sample(material_faces)])
    lengths, areas = ratios_of(lengths_of(rest), start_lengths), ratios_of(areas_of(rest), areas_of(start))
    if not (lengths.size and areas.size):
        return
    if all(ratio.min() >= 1 / REST and ratio.max() <= REST for ratio in (lengths, areas)):
        return  # so are the medians, which take longer
    (length, length_off), (area, area_off) = _off(lengths), _off(areas)
    if max(length_off, area_off) <= REST:
        return
    unit = cloth._compiled().material_scale
    if unit > 0:  # of texture coordinates
        element, given = 'rest "uv"', "texture coordinates"
        remedy = f"set `material_scale` to {number(unit / length)}"
    else:
        element = given = "material_vertices"
        remedy = f"multiply them by {number(1 / length)}"
    yield Finding(
        "rest shape",
        name,
        element,
        f"the rest shape, which {given} give, has edges {number(length)} times as long and triangles {number(area)} "
        "times as large as the start (medians)",
        f"if they only place a picture, leave {element} out, and the start is the rest shape; if their unit is wrong, "
        f"{remedy}",
    )


def _off(ratio: Reals) -> tuple[float, float]:
    """Returns the medians of ratios and of their distance from 1 as a factor."""
    return median(ratio), median(np.maximum(ratio, 1 / ratio))


def _pressure(name: str, cloth: Cloth) -> Iterator[Finding]:
    pressure = cloth._compiled().pressure
    if pressure == 0:
        return
    faces, corners = cloth.faces, cloth.vertices[cloth.faces]
    edges, uses = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    seen = f"{number(pressure)} Pa"
    if (uses == 1).any():
        yield Finding(
            "open cloth",
            name,
            "pressure",
            f"{seen}, and the cloth is open at {int((uses == 1).sum()):,} of {len(edges):,} edges",
            "pressure is for closed cloth, an open one is blown away along its normals; close it, or weld vertices "
            "that coincide (`weld`)",
        )
    elif np.einsum("ij,ij", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        yield Finding(
            "inverted cloth",
            name,
            "pressure",
            f"{seen}, and the normals of the faces point inwards",
            "pressure pushes along the normals; reverse the faces, or change the sign",
        )
