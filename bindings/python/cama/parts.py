# SPDX-License-Identifier: Apache-2.0
"""Parts of a scene as the user holds them: cloth and obstacles."""

from __future__ import annotations

from typing import Protocol, Union

import numpy as np

from . import _core
from .material import Material
from .types import Description, Integers, PathLike, Reals


class _Owner(Protocol):
    """A scene, as its parts see it."""

    _core: _core.Scene


class Part:
    """A cloth or an obstacle of a scene, by its index."""

    def __init__(self, scene: _Owner, index: int) -> None:
        self._scene, self.index = scene, index

    def _compiled(self) -> Union[_core.Cloth, _core.Obstacle]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<cama.{type(self).__name__} {self.index} {self.name!r}: {len(self.faces)} triangles>"

    @property
    def name(self) -> str:
        """Name in error texts and results."""
        return self._compiled().name

    @property
    def vertices(self) -> Reals:
        """[n, 3] float64, m: a copy of the starting positions."""
        return self._compiled().mesh.vertices

    @property
    def faces(self) -> Integers:
        """[m, 3] int32: a copy."""
        return self._compiled().mesh.faces

    @property
    def source(self) -> str:
        """What it was made from."""
        return self._compiled().source


class Cloth(Part):
    """A piece of cloth of a scene; what `Scene.add_cloth` returns."""

    def _compiled(self) -> _core.Cloth:
        return self._scene._core.cloth(self.index)

    @property
    def material(self) -> Material:
        """A copy of its Material; assign to change it."""
        return Material(self._compiled().material)

    @material.setter
    def material(self, value: Union[_core.Material, Description, PathLike]) -> None:
        self._compiled().material = Material.of(value)

    @property
    def material_vertices(self) -> Reals:
        """[k, 2] float64, m: rest positions in material space; empty where the starting position is the rest state."""
        return self._compiled().mesh.material_vertices

    @property
    def material_faces(self) -> Integers:
        """[m, 3] int32 indices into `material_vertices`."""
        return self._compiled().mesh.material_faces

    def _edges(self) -> tuple[Reals, ...]:
        """Two edges of every triangle, as columns: [m, 3, 2] where it starts, [m, 2 or 3, 2] at rest."""
        start = self.vertices[self.faces]
        rest = self.material_vertices[self.material_faces] if len(self.material_faces) else start
        return tuple(
            np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2) for corners in (start, rest)
        )

    @property
    def rest_area(self) -> float:
        """m^2."""
        _, rest = self._edges()
        return 0.5 * float(np.sqrt(np.linalg.det(np.swapaxes(rest, 1, 2) @ rest)).sum())

    @property
    def mass(self) -> float:
        """kg."""
        return self.rest_area * self._compiled().material.density

    @property
    def start_strain(self) -> tuple[float, float]:
        """Least and largest principal stretch over all triangles where the cloth starts, minus one: (0, 0) at rest."""
        start, rest = self._edges()
        squared = np.linalg.eigvals(
            np.linalg.solve(np.swapaxes(rest, 1, 2) @ rest, np.swapaxes(start, 1, 2) @ start)
        ).real  # of C in edges
        stretch = np.sqrt(np.maximum(squared, 0.0))
        return float(stretch.min()) - 1, float(stretch.max()) - 1


class Obstacle(Part):
    """A body that cloth collides with; what `Scene.add_obstacle` returns."""

    def _compiled(self) -> _core.Obstacle:
        return self._scene._core.obstacle(self.index)

    @property
    def friction(self) -> float:
        """Coulomb coefficient against cloth while it slides."""
        return self._compiled().friction

    @property
    def static_friction(self) -> float:
        """The same while it sticks; -1: equal to `friction`."""
        return self._compiled().static_friction

    @property
    def surface(self) -> str:
        """ "mesh", or of an exact obstacle "sphere", "capsule", "box", "plane", whose `vertices` are its defining points."""
        return self._compiled().surface

    @property
    def radius(self) -> float:
        """Of an exact sphere or capsule, m; else 0."""
        return self._compiled().radius

    @property
    def motion(self) -> _core.Motion:
        """A copy of its motion (compiled type; `evaluate(time, vertices)` gives positions)."""
        return _core.Motion(self._compiled().motion)
