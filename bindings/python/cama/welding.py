# SPDX-License-Identifier: Apache-2.0
"""Vertices of a mesh that coincide: how many there are, the distance at which they are welded, and welding."""

from __future__ import annotations

from typing import Any, Union

import numpy as np

from . import _core
from .arrays import number
from .errors import ArrayError, SceneError
from .types import Description, Integers, Reals

Weld = Union[bool, float]

NEAR = 1e-6  # of a mesh's extent: vertices closer than this coincide
DIRECTION = (0.5411961, 0.2903847, 0.7892071)  # along no edge of ordinary meshes: few vertices are level with others


def box(vertices: Reals) -> tuple[Reals, Reals]:
    """Returns the lower and upper corner [3] of vertices [n, 3], n > 0, m."""
    columns = [vertices[:, k] for k in range(3)]  # much faster than along axis 0
    return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])


def extent(vertices: Reals) -> float:
    """Returns the longest side of the bounding box of vertices [n, 3], m; 0 if there are none."""
    return float(np.subtract(*box(vertices)[::-1]).max()) if len(vertices) else 0.0


def _heights(vertices: Reals) -> Reals:
    """Returns coordinates [n] along DIRECTION, m; equal positions have equal ones, bit by bit."""
    x, y, z = DIRECTION
    return np.asarray(vertices[:, 0] * x + vertices[:, 1] * y + vertices[:, 2] * z)


def count_coincident(vertices: Reals) -> int:
    """Returns how many vertices [n, 3] lie where another one before them lies already.

    Vertices at equal positions are all found; of those that differ by rounding nearly all, for only neighbours in the
    order along one direction are compared.
    """
    if len(vertices) < 2:
        return 0
    ordered = vertices[np.argsort(_heights(vertices), kind="stable")]
    apart = ordered[1:] - ordered[:-1]
    return int(np.count_nonzero(np.einsum("ij,ij->i", apart, apart) <= (NEAR * extent(vertices)) ** 2))


def distance_of(name: str, weld: Any, mesh: _core.Mesh) -> float | None:
    """Returns the distance, m, that the argument `weld` of `add_cloth` means; None: no welding. Raises ArrayError."""
    if weld is None or (isinstance(weld, (bool, np.bool_)) and not weld):
        return None
    coincident, largest = _core.weld_distances(mesh)
    if isinstance(weld, (bool, np.bool_)):
        return coincident
    distance = number(f"{name}: weld", weld)
    if distance < 0 or distance > largest:
        raise ArrayError(
            f"{name}: weld: {distance:g} is not a distance from 0 to {largest:.4g} m, a tenth of the mesh's extent; "
            "give True, or a distance in m"
        )
    return distance


def weld_mesh(name: str, part: Any, weld: Weld, shape: Description | None) -> Integers | None:
    """Welds the mesh of a compiled Cloth or Obstacle; returns the new vertex [n] of each old one, None: the old."""
    distance = distance_of(name, weld, part.mesh)
    if distance is None:
        return None
    if shape is not None:
        raise SceneError(f"{name}: weld: a generated shape has no vertices that coincide; leave it out")
    if isinstance(part, _core.Obstacle) and not part.motion.is_rigid:
        raise SceneError(f"{name}: weld: its motion gives positions of every vertex; weld the mesh and them before")
    part.mesh, renumbered = _core.weld(part.mesh, distance)
    return renumbered
