# SPDX-License-Identifier: Apache-2.0
"""What the page shows: the parts of a recording or a simulation, a moment of it, and values to colour cloth by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..hints import require
from ..io.recording import Part
from ..parts import flat_corners
from . import quantities

PLAIN = "plain"
NEAR = 1.5  # thicknesses within which a recording is taken to have contact: cloth comes to rest near one
# {quantity: (words, unit, factor from SI to the unit)}
QUANTITIES = {
    PLAIN: ("cloth", "", 1.0),
    "strain": ("strain", "%", 100.0),
    "curvature": ("curvature", "1/m", 1.0),
    "contacts": ("contacts of a vertex", "", 1.0),
    "gaps": ("gap", "mm", 1e3),
    "speed": ("speed", "m/s", 1.0),
}


@dataclass
class Moment:
    """One moment of a recording or a simulation."""

    time: float  #: s
    positions: np.ndarray  #: [vertices, 3] m
    velocities: Callable[[], np.ndarray]  #: returns [vertices, 3] m/s
    contact_counts: Callable[[], np.ndarray] | None = None  #: returns [cloth vertices]; None: not known
    contacts: int | None = None  #: in the matrix; None: not known
    intersections: int | None = None  #: edges through faces; None: not counted


class Surface:
    """Cloths and obstacles.

    Args:
        cloths, obstacles: Lists of Part.
        start: Positions [vertices, 3] at the start, m.
        rest: Corners of the cloth triangles at rest [cloth triangles, 3, 2], m; None: cloth rests as it starts.
        thickness: Thickness of contact, m.
    """

    def __init__(self, cloths, obstacles, start, rest=None, thickness=0.0):
        self.cloths, self.obstacles, self.start, self.thickness = cloths, obstacles, start, float(thickness)
        self.parts = [*cloths, *obstacles]
        self.cloth_count = max((part.vertices.stop for part in cloths), default=0)
        faces = [part.faces + part.vertices.start for part in cloths]
        self.faces = np.concatenate(faces) if faces else np.zeros((0, 3), np.int64)  #: of cloth
        self.cloth_of_face = np.repeat(np.arange(len(cloths)), [len(part.faces) for part in cloths])
        self.rest_is_known = rest is not None and len(rest) == len(self.faces)
        corners = rest if self.rest_is_known else flat_corners(start, self.faces)
        self._inverse = quantities.inverse_rest(np.asarray(corners, np.float64))
        self._between = self._gaps = None

    @classmethod
    def of_recording(cls, recording):
        """The surface of an open Recording."""
        return cls(
            recording.cloths,
            recording.obstacles,
            recording.frame(0),
            recording.rest_corners,
            recording.attributes.get("thickness", 0.0),
        )

    @classmethod
    def of_simulation(cls, simulation):
        """The surface of a Simulation."""
        scene, faces = simulation.scene, simulation.faces.astype(np.int64)

        def part(piece, first, last, **exact):
            inside = (faces[:, 0] >= first) & (faces[:, 0] < last)
            return Part(piece.name, slice(first, last), faces[inside] - first, **exact)

        return cls(
            [part(c, *r) for c, r in zip(scene.cloths, simulation.cloth_ranges)],
            [part(o, *r, shape=o.shape, radius=o.radius) for o, r in zip(scene.obstacles, simulation.obstacle_ranges)],
            simulation.positions,
            np.concatenate([np.zeros((0, 3, 2)), *(cloth.rest_corners for cloth in scene.cloths)]),
            scene.thickness,
        )

    def seen(self, positions):
        """Returns what a camera should see of positions [n, 3]: some of the cloth, and the obstacles near it."""
        cloth = positions[: self.cloth_count or None]
        low, high = cloth.min(axis=0), cloth.max(axis=0)
        wide = float(np.linalg.norm(high - low)) / 2
        near = [positions[part.vertices] for part in self.obstacles if part.shape in ("mesh", "box")]
        near = np.concatenate([np.zeros((0, 3)), *near])
        near = near[((near > low - wide) & (near < high + wide)).all(axis=1)]
        return np.concatenate([points[:: max(1, len(points) // 5000)] for points in (cloth, near)])

    @property
    def reach(self):
        """How far gaps are looked for, m."""
        return 10 * self.thickness if self.thickness > 0 else 0.02

    def values(self, quantity, moment):
        """Returns a quantity on every cloth triangle [cloth triangles], in its unit; means of what vertices have."""
        x, n = moment.positions, self.cloth_count
        if quantity == "strain":
            of_faces = quantities.strain(x, self.faces, self._inverse)
        else:
            if quantity == "curvature":
                if self._between is None:
                    self._between = quantities.edges_between(self.faces)
                of_vertices = quantities.mean_curvature(x[:n], self.faces, self._between)
            elif quantity == "speed":
                of_vertices = quantities.speed(moment.velocities()[:n])
            elif quantity == "contacts" and moment.contact_counts is not None:
                of_vertices = moment.contact_counts()
            else:
                if self._gaps is None:
                    require("the distance to other surfaces", "scipy")
                    self._gaps = quantities.Gaps(self.start, self.cloths, self.obstacles)
                if quantity == "contacts":  # which a recording does not have
                    of_vertices = (self._gaps(x, NEAR * self.thickness) < NEAR * self.thickness).astype(float)
                else:
                    of_vertices = self._gaps(x, self.reach)
            of_faces = of_vertices[self.faces].mean(axis=1)
        return of_faces * QUANTITIES[quantity][2]
