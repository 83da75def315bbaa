# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes of surfaces that are given by a signed distance; VTK polygonises them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .hints import require
from .types import Integers, Reals


class Field(Protocol):
    """A signed distance, negative inside, at least near its surface."""

    def distance(self, x: Reals) -> Reals:
        """Returns the distances [n] of points [n, 3], m."""

    def gradient(self, x: Reals) -> Reals:
        """Returns their gradients [n, 3]."""


def central_differences(field: Field, x: Reals, step: float = 1e-4) -> Reals:
    """Returns the gradients [n, 3] of a field at points [n, 3]."""
    shifts = np.concatenate([x + step * axis for axis in (*np.eye(3), *-np.eye(3))])
    up, down = field.distance(shifts).reshape(2, 3, len(x))
    return ((up - down) / (2 * step)).T


class Ring:
    """The vertices beside every vertex of a mesh."""

    def __init__(self, faces: Integers, count: int) -> None:
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])  # closed: each in both ways
        order = np.argsort(edges[:, 0], kind="stable")
        self.near, degree = edges[order, 1], np.bincount(edges[:, 0], minlength=count)
        self.start, self.degree = np.concatenate([[0], np.cumsum(degree)[:-1]]), degree[:, None]

    def mean(self, values: Reals) -> Reals:
        """Returns the mean [n, k] over the vertices beside each vertex."""
        return np.add.reduceat(values[self.near], self.start) / self.degree


def _samples(field: Field, low: Reals, high: Reals, cell: float) -> tuple[Reals, list[Reals]]:
    """Returns distances on a grid of cubes, those far from the surface by their sign alone, and the grid's axes."""
    size = np.ceil((high - low) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(size[k]) + 0.37 * cell for k in range(3)]
    values = np.full(size, 1.0)
    coarse = 6  # cells of a block; blocks far from the surface are not evaluated
    x, y, z = (axis[coarse // 2 :: coarse] for axis in axes)
    centres = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    distance = field.distance(centres.reshape(-1, 3)).reshape(centres.shape[:3])
    near, inside = np.abs(distance) < 1.6 * coarse * cell, distance < 0
    fine = near.repeat(coarse, 0).repeat(coarse, 1).repeat(coarse, 2)
    full, deep = np.zeros(size, bool), np.zeros(size, bool)
    part = tuple(slice(0, min(a, b)) for a, b in zip(size, fine.shape))
    full[part] = fine[part]
    deep[part] = inside.repeat(coarse, 0).repeat(coarse, 1).repeat(coarse, 2)[part]
    values[deep] = -1.0
    index = np.argwhere(full)
    values[full] = field.distance(np.stack([axes[k][index[:, k]] for k in range(3)], axis=1))
    return values, axes


def polygonise(field: Field, low: Reals, high: Reals, cell: float) -> tuple[Reals, Integers]:
    """Returns vertices [n, 3] and outward triangles [m, 3] of the surface of a field, with even triangles.

    Args:
        field: The signed distance.
        low, high: Corners of a box around the surface [3], m.
        cell: Edge of a cube of the grid, m; there are about 2.2 triangles to an area of cell^2.

    Raises:
        BackendError: VTK is not installed.
    """
    require("a generated body", "vtkmodules")
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    values, axes = _samples(field, low, high, cell)
    image = vtkImageData()
    image.SetDimensions(*(len(axis) for axis in axes))
    image.SetOrigin(*(float(axis[0]) for axis in axes))
    image.SetSpacing(cell, cell, cell)
    image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(order="F"), deep=True))
    contour = vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.SetValue(0, 0.0)
    contour.ComputeNormalsOff()
    contour.Update()
    made = contour.GetOutput()
    vertices, faces = vtk_to_numpy(made.GetPoints().GetData()).astype(float), _faces(made)
    return relaxed(field, vertices, faces), faces


def decimated(vertices: Reals, faces: Integers, triangles: int) -> tuple[Reals, Integers]:
    """Returns a mesh with about as many triangles as asked for, by quadric errors (Garland and Heckbert 1997)."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    points, cells, mesh = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(numpy_to_vtk(vertices, deep=True))
    cells.SetData(3, numpy_to_vtkIdTypeArray(faces.astype(np.int64).ravel(), deep=True))
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    fewer = vtkQuadricDecimation()
    fewer.SetInputData(mesh)
    fewer.SetTargetReduction(1 - triangles / len(faces))
    fewer.Update()
    made = fewer.GetOutput()
    return vtk_to_numpy(made.GetPoints().GetData()).astype(float), _faces(made)


def outward(vertices: Reals, faces: Integers) -> Integers:
    """Returns the triangles of a closed mesh with outward normals."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    if np.einsum("ij,ij->i", np.cross(a, b), c).sum() < 0:
        faces = faces[:, ::-1]
    return np.ascontiguousarray(faces, np.int32)


def _faces(made: object) -> Integers:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    corners = vtk_to_numpy(made.GetPolys().GetConnectivityArray())  # type: ignore[attr-defined]
    return corners.reshape(-1, 3).astype(np.int32)


def relaxed(field: Field, vertices: Reals, faces: Integers, rounds: int = 5) -> Reals:
    """Returns vertices that even out the triangles of a closed mesh, put back on the surface."""
    ring = Ring(faces, len(vertices))
    for _ in range(rounds):
        vertices = projected(field, 0.5 * (vertices + ring.mean(vertices)))
    return vertices


def projected(field: Field, vertices: Reals) -> Reals:
    """Returns vertices [n, 3] that one step of Newton's method moved to the surface."""
    gradient = field.gradient(vertices)
    square = np.maximum((gradient**2).sum(axis=1), 0.25)
    return vertices - (field.distance(vertices) / square)[:, None] * gradient
