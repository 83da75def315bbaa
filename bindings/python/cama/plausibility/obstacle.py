# SPDX-License-Identifier: Apache-2.0
"""Obstacles: their size, motion and faces, and cloth inside of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from .. import _core
from ..parts import Obstacle
from ..types import Reals
from ..welding import box, count_coincident
from .finding import Finding, number
from .measures import rims_and_turns, winding
from .objects import SPEED, THICK, coincident_vertices, size

if TYPE_CHECKING:
    from ..scene import Scene

FLAT = 0.05  # height over extent of a floor or a landscape, which may be larger
UNWELDED = 0.25  # of its vertices
MANY = 200_000  # vertices of an obstacle whose faces are not looked at
INSTANTS = 16  # at which a rigid motion is looked at
INSIDE = 0.99  # winding number around a vertex inside a closed obstacle is 1


def of_obstacle(
    scene: Scene,
    obstacle: Obstacle,
    cloths: list[tuple[str, Reals]],
    largest: float,
    thickness: float,
    time_step: float,
) -> Iterator[Finding]:
    """Looks at one obstacle.

    Args:
        scene: Its scene.
        obstacle: The obstacle.
        cloths: Name and vertices [n, 3], m, of each cloth.
        largest: Largest extent of a cloth, m.
        thickness: Contact thickness of the scene, m; 0: without contact.
        time_step: Time step, s.
    """
    name, compiled = f"obstacle '{obstacle.name}'", obstacle._compiled()
    vertices = compiled.mesh.vertices
    if obstacle.shape != "plane":
        sides = np.subtract(*box(vertices)[::-1]) + 2 * obstacle.radius
        yield from size(name, float(sides.max()), flat=bool(sides.min() < FLAT * sides.max()))
    if thickness and compiled.thickness > THICK * largest:
        yield Finding(
            "thickness",
            name,
            "thickness",
            f"{number(compiled.thickness)} m, and the largest cloth is {number(largest)} m across",
            "cloth stays this far from obstacles; 0.001 to 0.005 m is usual",
        )
    motion = compiled.motion
    if not motion.is_static:
        yield from _motion(scene, name, motion, vertices, time_step)
    if obstacle.shape != "mesh":
        return
    coincident = count_coincident(vertices)
    if coincident > UNWELDED * len(vertices):
        yield coincident_vertices(name, coincident, len(vertices), "obstacle")
    there = vertices if motion.is_static else motion.evaluate(0.0, vertices)
    if scene._core.contact.enabled:
        yield from _inside(name, there, obstacle, cloths)
        yield from _turned(name, there, obstacle, cloths)


def _motion(scene: Scene, name: str, motion: _core.Motion, vertices: Reals, time_step: float) -> Iterator[Finding]:
    """Looks at the speed of the outermost vertices, at instants of the recorded time and between them."""
    if motion.is_rigid:
        vertices = vertices[np.concatenate([vertices.argmin(axis=0), vertices.argmax(axis=0)])]
    instants = np.linspace(0.0, scene.frames * scene.seconds_per_frame, INSTANTS if motion.is_rigid else 3)
    there = [motion.evaluate(instant, vertices) for instant in instants]
    soon = [motion.evaluate(instant + time_step, vertices) for instant in instants]
    moves = [(a, b, time_step) for a, b in zip(there, soon)] + [
        (a, b, instants[1] - instants[0]) for a, b in zip(there, there[1:])
    ]
    with np.errstate(over="ignore"):  # infinity is too fast as well
        fastest = max(float(np.sqrt(((b - a) ** 2).sum(axis=1).max())) / time for a, b, time in moves if time > 0)
    if fastest > SPEED:
        yield Finding(
            "motion",
            name,
            "motion",
            f"{number(fastest)} m/s",
            "give metres and seconds, and rotations in radians per second",
        )


def _turned(name: str, surface: Reals, obstacle: Obstacle, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
    """Looks whether the faces of a closed obstacle point inward, and some against others."""
    if len(surface) > MANY:
        return
    rims, against = rims_and_turns(obstacle.faces, len(surface))
    remedy = "recalculate its normals outward in the program that made it, or turn the order of its faces' vertices"
    if against:
        seen = f"{against:,} edges join faces that are turned against each other"
        yield Finding("turned", name, "faces", seen, remedy)
        return
    if rims:
        return
    corners = surface[obstacle.faces] - surface[0]
    if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) >= 0:
        return
    low, high = box(surface)
    if not any(((vertices > low).all() and (vertices < high).all()) for _, vertices in cloths):  # no container
        yield Finding("turned", name, "faces", "it is closed, and its faces are turned inward", remedy)


def _inside(name: str, surface: Reals, obstacle: Obstacle, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
    low, high = box(surface)
    for cloth, vertices in cloths:
        if not ((vertices > low).all() and (vertices < high).all()):
            continue
        corners = surface[obstacle.faces]
        if all(winding(corners, vertices[k]) > INSIDE for k in (0, len(vertices) // 2, len(vertices) - 1)):
            yield Finding(
                "inside",
                cloth,
                "vertices",
                f"all of it starts inside the closed {name}, which it cannot leave",
                "move it outside; if the obstacle is a container, turn its faces inward",
            )
