# SPDX-License-Identifier: Apache-2.0
"""The parts of a scene, and what holds and joins them: pins, attachments, stitches, elastics, creases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _core
from .arrays import indices, number, reals
from .errors import ArrayError, SceneError
from .motion import Motion
from .parts import Cloth, Obstacle, Part
from .scene_values import SceneValues
from .types import ArrayLike, Integers


class SceneParts(SceneValues):
    """The cloths and obstacles of a scene, which are known by handle, index or name."""

    __slots__ = ()

    @property
    def cloths(self) -> list[Cloth]:
        """Handles of all pieces of cloth."""
        return [Cloth(self, i) for i in range(self._core.cloth_count)]

    @property
    def obstacles(self) -> list[Obstacle]:
        """Handles of all obstacles."""
        return [Obstacle(self, i) for i in range(self._core.obstacle_count)]

    @property
    def pins(self) -> list[dict[str, Any]]:
        """A list of dicts with cloth (index), vertices [k], obstacle (index or None) and release (s)."""
        return [dict(zip(("cloth", "vertices", "obstacle", "release"), row)) for row in self._core.pins()]

    @property
    def stitch_count(self) -> int:
        """Number of stitches."""
        return self._core.stitch_count

    @property
    def vertex_count(self) -> int:
        """Number of cloth vertices."""
        return self._core.cloth_vertex_count

    @property
    def triangle_count(self) -> int:
        """Number of cloth triangles."""
        return self._core.cloth_triangle_count

    def pin(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike,
        motion: _core.Motion | dict[str, Any] | None = None,
        release: float = math.inf,
    ) -> None:
        """Holds cloth vertices in place or moves them.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k], one vertex number, or a mask [vertices of the cloth] of booleans.
            motion: A rigid `cama.Motion`, or a dict of its arguments, that moves their starting positions; None: fixed.
            release: Time at which the vertices become free, s.

        Raises:
            ArrayError, SceneError
        """
        motion = Motion.of(motion)
        index, vertices = self._vertices("pin", cloth, vertices)
        self._core.add_pin(index, vertices, motion, None, float(release))

    def attach(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike,
        obstacle: Obstacle | int | str,
        release: float = math.inf,
    ) -> None:
        """Makes cloth vertices follow the nearest points of an obstacle's surface.

        Args:
            cloth, vertices, release: As for `pin`.
            obstacle: A handle, index or name.

        Raises:
            ArrayError, SceneError
        """
        index, vertices = self._vertices("attach", cloth, vertices)
        self._core.add_pin(index, vertices, Motion(), self._index("attach", obstacle, self.obstacles), float(release))

    def stitch(
        self,
        cloth_a: Cloth | int | str,
        vertex_a: ArrayLike,
        cloth_b: Cloth | int | str,
        vertex_b: ArrayLike,
        vertex_c: ArrayLike | None = None,
        ratio: ArrayLike = 0.0,
        stiffness: float = 1e3,
    ) -> None:
        """Adds springs of zero rest length that pull x_a to (1 - ratio) x_b + ratio x_c.

        Args:
            cloth_a: Cloth of the vertices a: a handle, index or name.
            vertex_a: One vertex number, or [k].
            cloth_b: Cloth of the vertices b and c.
            vertex_b: One vertex number, or [k].
            vertex_c: One vertex number, or [k]; None: `vertex_b`.
            ratio: One number in [0, 1], or [k].
            stiffness: Stiffness of a spring, N/m.

        Raises:
            ArrayError, SceneError
        """
        a, first = self._vertices("stitch", cloth_a, np.atleast_1d(vertex_a))
        b, second = self._vertices("stitch", cloth_b, np.atleast_1d(vertex_b))
        third = second if vertex_c is None else self._vertices("stitch", cloth_b, np.atleast_1d(vertex_c))[1]
        if not len(first) == len(second) == len(third):
            raise ArrayError(f"stitch: {len(first)} vertices a, {len(second)} b, {len(third)} c")
        ratio = np.broadcast_to(reals("stitch: ratio", np.atleast_1d(ratio), (None,)), (len(first),))
        for i, j, k, r in zip(first, second, third, ratio):
            self._core.add_stitch(a, int(i), b, int(j), int(k), float(r), number("stitch: stiffness", stiffness))

    def elastic(self, cloth: Cloth | int | str, vertices: ArrayLike, *, length: float, stiffness: float) -> None:
        """Sews an elastic to a line of cloth: springs that only pull, one along each edge of the line.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k] in order, with an edge from each to the next; a closed line repeats the first
                at the end.
            length: Length of the elastic at rest over that of the line in the rest shape of the cloth, such as 0.8.
            stiffness: Force over strain of the elastic, EA, N.

        Raises:
            ArrayError, SceneError
        """
        index, line = self._vertices("elastic", cloth, vertices)
        self._core.add_elastic(index, line, number("elastic: length", length), number("elastic: stiffness", stiffness))

    def crease(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike | None = None,
        *,
        line: ArrayLike | None = None,
        angle: float,
    ) -> None:
        """Folds a cloth along a line of edges in its rest shape, as pressed pleats are.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k] in order, with an edge between two faces from each to the next.
            line: Two points [2, 3], m, in place of `vertices`: the vertices of the start on the straight line between
                them.
            angle: Angle between the normals of the faces on both sides, degrees, from -180 to 180; 0: flat. Above 0
                the crease is a ridge on the side that the normals point to.

        Raises:
            ArrayError, SceneError
        """
        if (vertices is None) == (line is None):
            raise SceneError("crease: exactly one of vertices and line is needed")
        if line is None:
            index, along = self._vertices("crease", cloth, np.asarray(vertices))
        else:
            index = self._index("crease", cloth, self.cloths)
            start, end = reals("crease: line", line, (2, 3)).tolist()
            along = self._core.vertices_along(index, start, end)
        self._core.add_crease(index, along, number("crease: angle", angle))

    def _index(self, what: str, part: Part | int | str, parts: Sequence[Part]) -> int:
        if isinstance(part, Part):
            if part._scene is not self:
                raise SceneError(f"{what}: {part!r} belongs to another scene")
            return part.index
        for candidate in parts:
            if part in (candidate.index, candidate.name):
                return candidate.index
        raise SceneError(f"{what}: there is no {part!r}; there are {[p.name for p in parts]}")

    def _vertices(self, what: str, cloth: Part | int | str, vertices: ArrayLike) -> tuple[int, Integers]:
        index = self._index(what, cloth, self.cloths)
        name, count = self.cloths[index].name, len(self.cloths[index].vertices)
        vertices = indices(f"{what}: {name}: vertices", vertices, count)
        for row in np.flatnonzero((vertices < 0) | (vertices >= count))[:1]:
            raise SceneError(f"{what}: {name}: vertex {vertices[row]} (row {row}) is outside 0 to {count - 1}")
        return index, vertices

    def _allow_change(self, what: str) -> None:
        """Raises SceneError if the scene is read-only."""
