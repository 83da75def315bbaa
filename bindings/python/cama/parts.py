# SPDX-License-Identifier: Apache-2.0
"""Handles of the parts of a scene: cloth and obstacles."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from . import _core
from .arrays import vector
from .material import Material
from .types import Description, Integers, PathLike, Reals, Vector, VectorLike


class _Owner(Protocol):
    """A scene, as its parts see it."""

    _core: _core.Scene

    def _allow_change(self, what: str) -> None: ...


class Part:
    """A cloth or an obstacle of a scene, identified by its index."""

    __slots__ = ("_scene", "index")  # an assignment to any other name is an AttributeError

    def __init__(self, scene: _Owner, index: int) -> None:
        self._scene, self.index = scene, index

    def _compiled(self) -> _core.Cloth | _core.Obstacle:
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<cama.{type(self).__name__} {self.index} {self.name!r}: {len(self.faces)} triangles>"

    @property
    def name(self) -> str:
        """Name in error texts and results."""
        return self._compiled().name

    @property
    def vertices(self) -> Reals:
        """A copy of the starting positions [n, 3], m."""
        return self._compiled().mesh.vertices

    @property
    def faces(self) -> Integers:
        """A copy of the triangles [m, 3]."""
        return self._compiled().mesh.faces

    @property
    def source(self) -> str:
        """Where the mesh comes from."""
        return self._compiled().source


def flat_corners(vertices: Reals, faces: Integers) -> Reals:
    """Returns the corners [m, 3, 2] of triangles, m, each laid flat by itself: its first edge along u."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    first, second = b - a, c - a
    length = np.linalg.norm(first, axis=1)
    along = first / np.where(length > 0, length, 1)[:, None]
    flat = np.zeros((len(faces), 3, 2))
    flat[:, 1, 0] = length
    flat[:, 2, 0] = (along * second).sum(axis=1)
    flat[:, 2, 1] = np.linalg.norm(np.cross(along, second), axis=1)
    return flat


class Cloth(Part):
    """A piece of cloth of a scene, as `Scene.add_cloth` returns it."""

    __slots__ = ()

    def _compiled(self) -> _core.Cloth:
        return self._scene._core.cloth(self.index)

    @property
    def material(self) -> Material:
        """A copy of the material; assign to change it."""
        return Material(self._compiled().material)

    @material.setter
    def material(self, value: _core.Material | Description | PathLike) -> None:
        self._scene._allow_change(f"material of {self.name!r}")
        self._compiled().material = Material.of(value)

    @property
    def velocity(self) -> Vector:
        """Velocity at the start [3], m/s; assign to change it."""
        return self._compiled().velocity

    @velocity.setter
    def velocity(self, value: VectorLike) -> None:
        self._scene._allow_change(f"velocity of {self.name!r}")
        self._compiled().velocity = vector(f"{self.name}: velocity", value)

    @property
    def material_vertices(self) -> Reals:
        """Rest positions in material space [k, 2], m; empty if the starting position is the rest state."""
        return self._compiled().mesh.material_vertices

    @property
    def material_faces(self) -> Integers:
        """Triangles [m, 3] of `material_vertices`."""
        return self._compiled().mesh.material_faces

    @property
    def rest_corners(self) -> Reals:
        """Corners [m, 3, 2] of the triangles at rest, m: in material space, shrunk, or each laid flat by itself."""
        if len(self.shrinkage):
            return self._compiled().rest_corners.reshape(-1, 3, 2)
        if len(self.material_faces):
            return self.material_vertices[self.material_faces]
        return flat_corners(self.vertices, self.faces)

    @property
    def shrinkage(self) -> Reals:
        """Shares by which the rest shape is shrunk along warp and weft: [1, 2] of all triangles, [m, 2], or [0, 2]."""
        return self._compiled().shrinkage.reshape(-1, 2)

    @property
    def rest_shape(self) -> str:
        """What the rest shape is, in words: "start", "uv, 0.5 m a unit" or "material coordinates".

        "uv" is the texture coordinates of a file; grids and other generated shapes have material coordinates.
        """
        compiled = self._compiled()
        if compiled.material_scale > 0:
            return f"uv, {compiled.material_scale:g} m a unit"
        return "material coordinates" if len(compiled.mesh.material_faces) else "start"

    def _edges(self) -> tuple[Reals, ...]:
        """Returns two edges of every triangle as columns: [m, 3, 2] at the start, [m, 2 or 3, 2] at rest."""
        start = self.vertices[self.faces]
        flat = len(self.material_faces) or len(self.shrinkage)
        rest = self.rest_corners if flat else start
        return tuple(
            np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2) for corners in (start, rest)
        )

    def _rest_areas(self) -> Reals:
        """Returns the areas [m] of the triangles at rest, m^2."""
        _, rest = self._edges()
        triangular = np.linalg.qr(rest)[1]  # [m, 2, 2]
        return 0.5 * np.abs(triangular[:, 0, 0] * triangular[:, 1, 1])

    @property
    def rest_area(self) -> float:
        """Area at rest, m^2."""
        return float(self._rest_areas().sum())

    @property
    def mass(self) -> float:
        """Mass, kg; shrinkage does not change it."""
        area = self.rest_area
        if len(self.shrinkage):
            area = float((self._rest_areas() / (1 - self.shrinkage).prod(axis=1)).sum())
        return area * self._compiled().material.density

    @property
    def start_strain(self) -> tuple[float, float]:
        """Smallest and largest principal stretch at the start, minus one; (0, 0) at rest."""
        start, rest = self._edges()
        # The deformation gradient is start R^-1, rest = Q R; products of rest by itself would lose half of the digits.
        triangular = np.linalg.qr(rest)[1]  # [m, 2, 2]
        (a, b), d = triangular[:, 0].T, triangular[:, 1, 1]
        a, d = np.where(a == 0, np.inf, a), np.where(d == 0, np.inf, d)
        first = start[:, :, 0] / a[:, None]
        second = (start[:, :, 1] - first * b[:, None]) / d[:, None]
        stretch = np.linalg.svd(np.stack([first, second], 2), compute_uv=False)
        return float(stretch.min()) - 1, float(stretch.max()) - 1


class Obstacle(Part):
    """An obstacle of a scene, as `Scene.add_obstacle` returns it."""

    __slots__ = ()

    def _compiled(self) -> _core.Obstacle:
        return self._scene._core.obstacle(self.index)

    @property
    def friction(self) -> float:
        """Coulomb coefficient against cloth."""
        return self._compiled().friction

    @property
    def static_friction(self) -> float:
        """The coefficient while cloth sticks; -1: equal to `friction`."""
        return self._compiled().static_friction

    @property
    def shape(self) -> str:
        """ "mesh", or the kind of an exact obstacle: "sphere", "capsule", "box" or "plane".

        The `vertices` of an exact obstacle are its defining points.
        """
        return self._compiled().shape

    @property
    def radius(self) -> float:
        """Radius of an exact sphere or capsule, m; else 0."""
        return self._compiled().radius

    @property
    def rigid(self) -> _core.Rigid | None:
        """A copy of what makes it a rigid body; None: it is none."""
        rigid = self._compiled().rigid
        return None if rigid is None else _core.Rigid(rigid)

    @property
    def motion(self) -> _core.Motion:
        """A copy of the motion; its `evaluate(time, vertices)` returns positions."""
        return _core.Motion(self._compiled().motion)
