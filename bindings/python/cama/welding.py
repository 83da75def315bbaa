# SPDX-License-Identifier: Apache-2.0
"""Vertices of a mesh that coincide: how many there are, and one vertex in place of each group."""

from __future__ import annotations

from typing import Any, Union

import numpy as np

from . import _core
from .arrays import number
from .errors import ArrayError
from .types import Integers, Reals

Weld = Union[bool, float]

NEAR = 1e-6  # of a mesh's extent: vertices closer than this coincide
LARGEST = 0.1  # of a mesh's extent, distance to weld at
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


def _pairs(vertices: Reals, distance: float) -> tuple[Integers, Integers]:
    """Returns all pairs a, b of vertices that are no more than `distance` apart, [k] each."""
    height = _heights(vertices)
    order = np.argsort(height, kind="stable")
    height, ordered = height[order], vertices[order]
    reach = distance * (1 + 1e-9) + 4e-16 * float(np.abs(vertices).max(initial=0.0))  # heights are rounded
    first, second = [], []
    lower = np.arange(len(height))
    for ahead in range(1, len(height)):
        lower = lower[lower + ahead < len(height)]
        lower = lower[height[lower + ahead] - height[lower] <= reach]
        if not len(lower):
            break
        apart = ordered[lower + ahead] - ordered[lower]
        near = lower[(apart * apart).sum(axis=1) <= distance * distance]
        first.append(order[near])
        second.append(order[near + ahead])
    if not first:
        return np.zeros(0, np.int32), np.zeros(0, np.int32)
    return np.concatenate(first).astype(np.int32), np.concatenate(second).astype(np.int32)


def groups(vertices: Reals, distance: float) -> tuple[Integers, Integers]:
    """Joins vertices that are no more than `distance` apart, and what is joined to the same vertex.

    Args:
        vertices: Positions [n, 3], m.
        distance: m.

    Returns:
        index [n], the new vertex of each old one, and first [new vertices], the first old vertex of each new one. New
        vertices are in the order of their first old ones.
    """
    a, b = _pairs(vertices, distance)
    label = np.arange(len(vertices), dtype=np.int32)  # becomes the lowest vertex of the group
    while True:
        before = label.copy()
        lowest = np.minimum(label[a], label[b])
        np.minimum.at(label, label[a], lowest)
        np.minimum.at(label, label[b], lowest)
        label = label[label]
        if (label == before).all():
            break
    first, index = np.unique(label, return_inverse=True)
    return index.reshape(-1).astype(np.int32), first.astype(np.int32)


def distance_of(name: str, weld: Any, vertices: Reals) -> float | None:
    """Returns the distance, m, that the argument `weld` of `add_cloth` means; None: no welding. Raises ArrayError."""
    if weld is None or (isinstance(weld, (bool, np.bool_)) and not weld):
        return None
    if isinstance(weld, (bool, np.bool_)):
        return NEAR * extent(vertices)
    distance, across = number(f"{name}: weld", weld), extent(vertices)
    if distance < 0 or distance > LARGEST * across:
        raise ArrayError(
            f"{name}: weld: {distance:g} is not a distance from 0 to {LARGEST * across:.4g} m, a tenth of the mesh's "
            "extent; give True, or a distance in m"
        )
    return distance


def _collapsed(faces: Integers) -> Any:
    """Returns which triangles [m, 3] have the same vertex twice."""
    return (faces == faces[:, [1, 2, 0]]).any(axis=1)


def welded(mesh: _core.Mesh, distance: float) -> tuple[_core.Mesh, Integers]:
    """Returns a welded mesh, and the new vertex [n] of each old one, -1 where it has none.

    Triangles that collapse are left out, and so are vertices that no other triangle uses.
    """
    vertices, faces, material_faces = mesh.vertices, mesh.faces, mesh.material_faces
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices) or not np.isfinite(vertices).all():
        return mesh, np.arange(len(vertices), dtype=np.int32)  # Mesh.validate says what is wrong
    index, first = groups(vertices, distance)
    joined = index[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    whole |= (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )  # were so before
    used_before, used = np.zeros(len(first), bool), np.zeros(len(first), bool)
    used_before[joined] = True
    used[joined[whole]] = True
    kept = used | ~used_before
    number_of = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    return _core.Mesh(
        vertices[first[kept]],
        np.ascontiguousarray(number_of[joined[whole]]),
        mesh.material_vertices,
        np.ascontiguousarray(material_faces[whole] if len(material_faces) else material_faces),
    ), number_of[index]
