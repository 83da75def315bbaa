# SPDX-License-Identifier: Apache-2.0
"""Surfaces to draw the parts of a recording by."""

import numpy as np

from ..recording import Part
from ..tessellation import drawn

SMOOTH_BELOW = 30_000  # triangles of a part, below which it is subdivided
SHARP = 40.0  # degrees between faces of an obstacle, from which on an edge is drawn sharp


def polydata(vertices, faces):
    """Returns a pyvista.PolyData of triangles."""
    import pyvista

    return pyvista.PolyData(vertices, np.column_stack([np.full(len(faces), 3), faces]).ravel())


def normals(surface):
    """Returns the vertex normals [n, 3] of a PolyData of triangles."""
    from pyvista import convert_array
    from vtkmodules.vtkFiltersCore import vtkTriangleMeshPointNormals

    source = vtkTriangleMeshPointNormals()
    source.SetInputData(surface)
    source.Update()
    return convert_array(source.GetOutput().GetPointData().GetNormals())


def refine(surface, times, scheme):
    """Returns a PolyData with the vertices of another and those of `times` subdivisions; None: it has no such.

    scheme: "Linear", or "Butterfly", whose new vertices lie on a smooth surface through the others.
    """
    from pyvista import wrap
    from vtkmodules import vtkFiltersModeling

    source = getattr(vtkFiltersModeling, f"vtk{scheme}SubdivisionFilter")()
    source.SetInputData(surface)
    source.SetNumberOfSubdivisions(times)
    source.AddObserver("ErrorEvent", lambda *_: None)
    source.Update()
    fine = wrap(source.GetOutput())
    return fine if fine.n_cells == 4**times * surface.n_cells else None


def joined(parts):
    """Returns one Part for several: fewer surfaces are drawn faster. Texture coordinates are not kept."""
    if len(parts) == 1:
        return parts[0]
    counts = [part.vertices.stop - part.vertices.start for part in parts]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return Part(
        parts[0].name,
        np.concatenate([np.arange(part.vertices.start, part.vertices.stop) for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets)]),
    )


class Cloth:
    """The surface of a cloth.

    Where triangles are few, normals are those of a smooth surface through the vertices. The surface itself stays flat
    between them unless that is asked for: smooth surfaces of layers that touch would intersect.

    Args:
        part: The cloth of a recording.
        positions: Of all vertices of a frame, [n, 3] m.
        shaded: Take normals from a smooth surface.
        smooth: Draw that surface.
        textured: Take texture coordinates along; each vertex then stands once for each of its coordinates.
    """

    def __init__(self, part, positions, shaded=True, smooth=False, textured=False):
        self._part, self._times, self._smooth = part, 0, smooth
        self._coarse = polydata(positions[part.vertices], part.faces)
        self._corners = None
        if textured and getattr(part, "uv", None) is not None:
            self._texture(part)
        elif shaded and len(part.faces) < SMOOTH_BELOW:
            wanted = 2 if 4 * len(part.faces) < SMOOTH_BELOW else 1
            self._times = wanted if refine(self._coarse, wanted, "Butterfly") is not None else 0
        self.surface = self._shape()

    def _texture(self, part):
        pairs = np.stack([part.faces.ravel(), part.uv_faces.ravel()], axis=1)
        corners, index = np.unique(pairs, axis=0, return_inverse=True)
        self._corners, self._seamed = corners[:, 0], polydata(self._coarse.points[corners[:, 0]], index.reshape(-1, 3))
        self._seamed.active_texture_coordinates = np.asarray(part.uv, float)[corners[:, 1]]

    def _shape(self):
        if self._corners is not None:
            self._seamed.points = self._coarse.points[self._corners]
            self._seamed.point_data.active_normals = normals(self._coarse)[self._corners]
            return self._seamed
        if not self._times:
            self._coarse.point_data.active_normals = normals(self._coarse)
            return self._coarse
        fine = refine(self._coarse, self._times, "Butterfly")
        shape = fine if self._smooth else refine(self._coarse, self._times, "Linear")
        shape.point_data.active_normals = normals(fine)
        return shape

    def move(self, positions, values):
        """Puts the surface where the vertices of a frame are; values: {name: [n], one for each vertex of the part}."""
        self._coarse.points = positions[self._part.vertices]
        for name, each in values.items():
            self._coarse.point_data[name] = each
        shape = self._shape()
        if shape is not self.surface:
            self.surface.copy_from(shape, deep=False)


def has_surface(part):
    """Whether an obstacle can be drawn: a mesh without triangles cannot."""
    return part.shape not in ("mesh", "box") or len(part.faces) > 0


class Obstacle:
    """The surface of an obstacle; sharp edges of a mesh stay sharp."""

    def __init__(self, part, positions, seen):
        self._part, self._seen = part, seen
        if part.shape in ("mesh", "box"):
            shape = polydata(positions[part.vertices], part.faces)
            shape["vertex"] = np.arange(shape.n_points)
            self.surface = shape.compute_normals(
                cell_normals=False,
                split_vertices=True,
                feature_angle=SHARP,
                consistent_normals=False,
                auto_orient_normals=False,
            )
            self._vertex = np.asarray(self.surface["vertex"])
            self.surface.clear_data()
        else:
            self.surface = self._exact(positions)

    def _exact(self, positions):
        surface = polydata(*drawn(self._part, positions, self._seen))
        surface.point_data.active_normals = normals(surface)
        return surface

    def move(self, positions):
        """Puts the surface where the vertices of a frame are."""
        if self._part.shape in ("mesh", "box"):
            self.surface.points = positions[self._part.vertices][self._vertex]
            self.surface.point_data.active_normals = normals(self.surface)
        else:
            self.surface.copy_from(self._exact(positions), deep=False)


def outline(part, positions):
    """Points [n, 3] that an obstacle lies between: its vertices, or the corners of boxes around its exact parts."""
    points = positions[part.vertices]
    if part.shape in ("mesh", "box"):
        return points
    corners = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
    return (points[:, None] + part.radius * corners).reshape(-1, 3)


def is_floor(part, first, last):
    """Whether an obstacle is level and does not move, given positions of the first and the last moment."""
    points, then = first[part.vertices], last[part.vertices]
    if part.shape not in ("plane", "mesh") or np.abs(points - then).max() > 1e-9:
        return False
    width = np.ptp(points, axis=0)
    return width[2] <= 1e-4 * np.linalg.norm(width)


def is_hollow(part, positions):
    """Whether an obstacle is a closed mesh whose faces point inwards, as a drum that cloth is in."""
    if part.shape != "mesh":
        return False
    faces = part.faces.astype(np.int64)
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    most = faces.max(initial=0) + 1
    there, back = (np.sort(edges[:, a] * most + edges[:, 1 - a]) for a in (0, 1))
    if not len(faces) or not np.array_equal(there, back):  # some edge has one face only
        return False
    points = positions[part.vertices]
    a, b, c = (points[faces[:, k]] - points.mean(axis=0) for k in range(3))
    return bool(np.sum(np.cross(a, b) * c) < 0)


def strain(rest, positions, faces):
    """Largest principal strain at each vertex, [n]: the mean of the triangles there, by area.

    rest, positions: [n, 3] m, before and after. A triangle whose longest fibre is 2 % longer has the strain 0.02.
    """
    a, b = (x[faces[:, 1:]] - x[faces[:, :1]] for x in (rest, positions))  # [triangles, 2, 3], edges
    before, after = a @ a.transpose(0, 2, 1), b @ b.transpose(0, 2, 1)  # metrics
    determinant = np.linalg.det(before)
    flat = determinant <= 0  # no rest shape
    before[flat] = np.eye(2)
    ratio = np.linalg.solve(before, after)
    half, product = np.trace(ratio, axis1=1, axis2=2) / 2, np.linalg.det(ratio)
    stretch = np.sqrt(half + np.sqrt(np.maximum(half**2 - product, 0)))
    area = np.repeat(np.sqrt(np.maximum(determinant, 0)), 3)
    weight = np.bincount(faces.ravel(), area, len(rest))
    total = np.bincount(faces.ravel(), area * np.repeat(stretch - 1, 3), len(rest))
    return total / np.where(weight > 0, weight, 1)
