# SPDX-License-Identifier: Apache-2.0
"""Parts of a scene as the user holds them: cloth and obstacles."""

import numpy as np

from . import _core
from .material import Material


class Part:
    """A cloth or an obstacle of a scene, by its index."""

    _kind = ""

    def __init__(self, scene, index):
        self._scene, self.index = scene, index

    def _core(self):
        return getattr(self._scene._core, self._kind)(self.index)

    def __repr__(self):
        return f"<cama.{type(self).__name__} {self.index} {self.name!r}: {len(self.faces)} triangles>"

    @property
    def name(self):
        """Name in error texts and results."""
        return self._core().name

    @property
    def vertices(self):
        """[n, 3] float64, m: a copy of the starting positions."""
        return self._core().mesh.vertices

    @property
    def faces(self):
        """[m, 3] int32: a copy."""
        return self._core().mesh.faces

    @property
    def source(self):
        """What it was made from."""
        return self._core().source


class Cloth(Part):
    """A piece of cloth of a scene; what `Scene.add_cloth` returns."""

    _kind = "cloth"

    @property
    def material(self):
        """A copy of its Material; assign to change it."""
        return Material(self._core().material)

    @material.setter
    def material(self, value):
        self._core().material = Material.of(value)

    @property
    def material_vertices(self):
        """[k, 2] float64, m: rest positions in material space; empty where the starting position is the rest state."""
        return self._core().mesh.material_vertices

    @property
    def material_faces(self):
        """[m, 3] int32 indices into `material_vertices`."""
        return self._core().mesh.material_faces

    def _edges(self):
        """Two edges of every triangle, as columns: [m, 3, 2] where it starts, [m, 2 or 3, 2] at rest."""
        start = self.vertices[self.faces]
        rest = self.material_vertices[self.material_faces] if len(self.material_faces) else start
        return tuple(
            np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2) for corners in (start, rest)
        )

    @property
    def rest_area(self):
        """m^2."""
        _, rest = self._edges()
        return 0.5 * float(np.sqrt(np.linalg.det(np.swapaxes(rest, 1, 2) @ rest)).sum())

    @property
    def mass(self):
        """kg."""
        return self.rest_area * self._core().material.density

    @property
    def start_strain(self):
        """Least and largest principal stretch over all triangles where the cloth starts, minus one: (0, 0) at rest."""
        start, rest = self._edges()
        squared = np.linalg.eigvals(
            np.linalg.solve(np.swapaxes(rest, 1, 2) @ rest, np.swapaxes(start, 1, 2) @ start)
        ).real  # of C in edges
        stretch = np.sqrt(np.maximum(squared, 0.0))
        return float(stretch.min()) - 1, float(stretch.max()) - 1


class Obstacle(Part):
    """A body that cloth collides with; what `Scene.add_obstacle` returns."""

    _kind = "obstacle"

    @property
    def friction(self):
        """Coulomb coefficient against cloth while it slides."""
        return self._core().friction

    @property
    def static_friction(self):
        """The same while it sticks; -1: equal to `friction`."""
        return self._core().static_friction

    @property
    def surface(self):
        """ "mesh", or of an exact obstacle "sphere", "capsule", "box", "plane", whose `vertices` are its defining points."""
        return self._core().surface

    @property
    def radius(self):
        """Of an exact sphere or capsule, m; else 0."""
        return self._core().radius

    @property
    def motion(self):
        """A copy of its motion (compiled type; `evaluate(time, vertices)` gives positions)."""
        return _core.Motion(self._core().motion)
