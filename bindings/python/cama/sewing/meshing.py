# SPDX-License-Identifier: Apache-2.0
"""Triangles of a pattern's panels, with one-to-one vertices along seams."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import MeshError
from ..hints import counted, require
from ..types import Integers, Reals
from .pattern import Panel, SewingPattern

SMOOTHING = 8  # rounds in which interior vertices go to the middle of their neighbours
CLEARANCE = 0.7  # of interior points from the boundary, in edge lengths
MARGIN = 0.02  # m, between panels in material space, where they lie side by side
ROUNDS = 12  # of dividing boundary edges that a Delaunay triangulation leaves out


@dataclass
class PatternMesh:
    """The panels of a pattern as triangles. Panels do not share vertices; `merged` joins those along seams."""

    pattern: SewingPattern  #: what it was made from
    edge_length: float  #: edge length aimed at, m
    points: Reals = field(repr=False)  #: [vertices, 2] m, in the planes of the panels
    material: Reals = field(repr=False)  #: [vertices, 2] m, the panels side by side, seen from their right sides
    positions: Reals = field(repr=False)  #: [vertices, 3] m, placed around the body
    faces: Integers = field(repr=False)  #: [triangles, 3], counterclockwise on the right side
    panel_of_face: Integers = field(repr=False)  #: [triangles]
    panel_of_vertex: Integers = field(repr=False)  #: [vertices]
    seam_pairs: list[Integers] = field(repr=False)  #: for each seam its pairs of vertices [k, 2]
    elastic_lines: list[Integers] = field(default_factory=list, repr=False)  #: for each elastic its vertices [k]

    @property
    def shrinkage(self) -> Reals:
        """Shrinkage of the triangles [m, 2]; [0, 2] where no panel has any."""
        shares = np.array([panel.shrinkage for panel in self.pattern.panels])
        return shares[self.panel_of_face] if shares.any() else np.zeros((0, 2))

    @property
    def pairs(self) -> Integers:
        """All different pairs of vertices [k, 2] that are sewn together."""
        rows = np.concatenate([np.zeros((0, 2), int), *self.seam_pairs])
        rows = np.sort(rows[rows[:, 0] != rows[:, 1]], axis=1)
        return np.unique(rows, axis=0)

    def elastics(self, vertex_of: Integers) -> list[dict[str, Any]]:
        """Returns `vertices`, `length` and `stiffness` of each elastic, as `Scene.elastic` takes them.

        vertex_of: [vertices], the garment's vertex that each vertex became.
        """
        found = []
        for line, elastic in zip(self.elastic_lines, self.pattern.elastics):
            vertices = vertex_of[line]
            vertices = vertices[np.r_[True, vertices[1:] != vertices[:-1]]]
            found.append({"vertices": vertices, "length": elastic.length, "stiffness": elastic.stiffness})
        return found

    def merged(self) -> Integers:
        """Returns the number [vertices] of the vertex of the sewn garment that each vertex becomes."""
        return merge_map(len(self.points), self.pairs)

    def min_angle(self) -> float:
        """Returns the smallest angle of all triangles, degrees."""
        corners = self.points[self.faces]
        sides = np.roll(corners, -1, axis=1) - corners
        lengths = np.linalg.norm(sides, axis=2)
        cosine = -(sides * np.roll(sides, 1, axis=1)).sum(2) / (lengths * np.roll(lengths, 1, axis=1))
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1)).min()))


def merge_map(count: int, pairs: Integers) -> Integers:
    """Returns the component [count] of each of `count` vertices under pairs [k, 2], in the order of first vertices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def mesh_pattern(pattern: SewingPattern, edge_length: float) -> PatternMesh:
    """Meshes the panels of a pattern with triangles of an edge length, m.

    Edges are divided evenly by length; the two edges of a seam have equally many parts, of which the longer ones are at
    most about as long as asked for. Interior vertices come from a grid of equilateral triangles and are smoothed; a
    Delaunay triangulation joins them, and boundary edges that it does not have are divided until it does.

    Raises:
        MeshError: A panel crosses itself, or is too narrow for its seams; the text names it.
        BackendError: SciPy is not installed.
    """
    require("sewing patterns", "scipy")
    if not edge_length > 0 or not math.isfinite(edge_length):
        raise MeshError(f"{pattern.name}: edge length {edge_length} m must be positive")
    if pattern.area / edge_length**2 > 5e6:
        raise MeshError(f"{pattern.name}: edges of {edge_length * 1e3:.3g} mm make more than ten million triangles")
    fractions = _Fractions(pattern, edge_length)
    for _ in range(ROUNDS):
        missing: list[tuple[int, int, int]] = []
        parts = [_mesh_panel(pattern, index, fractions, edge_length, missing) for index in range(len(pattern.panels))]
        if not missing:
            mesh = _assemble(pattern, edge_length, fractions, parts)
            narrow = _collapsing(mesh)
            if not len(narrow):
                return mesh
            missing = fractions.parts_at(mesh, narrow)
            if not missing:
                break
        for where in missing:
            fractions.divide(*where)
    panel = pattern.panels[missing[0][0]].name if missing else pattern.panels[mesh.panel_of_face[narrow[0]]].name
    raise MeshError(
        f"{pattern.name}: panel {panel!r} cannot be meshed with edges of {edge_length * 1e3:.3g} mm: its outline "
        "crosses or touches itself, or it is too narrow; look at its corners, or take a shorter edge length"
    )


class _Fractions:
    """Fractions of the length at which every edge of a pattern has vertices, the same on both sides of a seam."""

    def __init__(self, pattern: SewingPattern, edge_length: float) -> None:
        self._partner: dict[tuple[int, int], tuple[tuple[int, int], bool]] = {}
        for seam in pattern.seams:
            self._partner[seam.first] = (seam.second, seam.reversed)
            self._partner[seam.second] = (seam.first, seam.reversed)
        self._of: dict[tuple[int, int], Reals] = {}
        for p, panel in enumerate(pattern.panels):
            for e, edge in enumerate(panel.edges):
                length = edge.length
                if (p, e) in self._partner:
                    length = max(length, pattern.edge(self._partner[p, e][0]).length)
                self._of[p, e] = np.linspace(0, 1, max(1, math.ceil(length / edge_length - 0.25)) + 1)
                if len(panel.edges) == 2:  # a digon needs a vertex between its corners
                    self._of[p, e] = np.linspace(0, 1, max(3, len(self._of[p, e])))

    def __getitem__(self, where: tuple[int, int]) -> Reals:
        return self._of[where]

    def divide(self, panel: int, edge: int, part: int) -> None:
        """Adds the middle of a part of an edge, and the one that it is sewn to."""
        values = self._of[panel, edge]
        if part + 1 >= len(values):
            return
        middle = 0.5 * (values[part] + values[part + 1])
        self._add((panel, edge), middle)
        if (panel, edge) in self._partner:
            other, opposite = self._partner[panel, edge]
            self._add(other, 1 - middle if opposite else middle)

    def _add(self, where: tuple[int, int], value: float) -> None:
        values = self._of[where]
        if np.abs(values - value).min() > 1e-6:
            self._of[where] = np.sort(np.append(values, value))

    def parts_at(self, mesh: PatternMesh, faces: Integers) -> list[tuple[int, int, int]]:
        """Returns the parts of edges beside triangles that collapse when seams close."""
        wanted = set(mesh.faces[faces].ravel().tolist())
        found, first = [], 0
        for p, panel in enumerate(mesh.pattern.panels):
            number = first
            for e in range(len(panel.edges)):
                for part in range(len(self._of[p, e]) - 1):
                    if number in wanted:
                        found.append((p, e, part))
                    number += 1
            first += int(np.count_nonzero(mesh.panel_of_vertex == p))
        return found


def _mesh_panel(
    pattern: SewingPattern, index: int, fractions: _Fractions, edge_length: float, missing: list[tuple[int, int, int]]
) -> tuple[Reals, Integers]:
    """Returns points [n, 2], those of the boundary first and in order, and counterclockwise triangles [m, 3].

    Boundary edges that the triangulation lacks are appended to `missing` as panel, edge and part.
    """
    from scipy.spatial import Delaunay, QhullError

    panel = pattern.panels[index]
    boundary = np.concatenate([edge.curve.at(fractions[index, e])[:-1] for e, edge in enumerate(panel.edges)])
    owner = [(index, e, part) for e in range(len(panel.edges)) for part in range(len(fractions[index, e]) - 1)]
    interior = _interior_points(boundary, edge_length)
    try:
        for round_ in range(SMOOTHING + 1):
            points = np.concatenate([boundary, interior])
            faces = Delaunay(points).simplices
            faces = faces[_inside(boundary, points[faces].mean(axis=1))]
            if round_ < SMOOTHING and len(interior):
                interior = _smoothed(points, faces, len(boundary))
    except QhullError:
        raise MeshError(f"{pattern.name}: panel {panel.name!r} has no inside") from None
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)[np.abs(area) > 1e-6 * edge_length**2]
    edges = {tuple(sorted(e)) for f in faces.tolist() for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))}
    count = len(boundary)
    missing += [owner[k] for k in range(count) if tuple(sorted((k, (k + 1) % count))) not in edges]
    return points, faces


def _interior_points(boundary: Reals, edge_length: float) -> Reals:
    """Returns points [n, 2] of a grid of equilateral triangles inside a closed line, away from it."""
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    height = edge_length * math.sqrt(3) / 2
    rows, columns = (math.ceil(size) + 2 for size in (high - low)[::-1] / (height, edge_length))
    y, x = np.mgrid[:rows, :columns].astype(float)
    middle = 0.5 * (low + high)
    grid = np.stack([(x + 0.5 * (y % 2) - columns / 2) * edge_length, (y - (rows - 1) / 2) * height], 2).reshape(-1, 2)
    grid += middle
    grid = grid[_inside(boundary, grid)]
    starts, ends = boundary, np.roll(boundary, -1, axis=0)
    lengths = np.linalg.norm(ends - starts, axis=1)
    return grid[_clear(grid, starts, ends, np.minimum(CLEARANCE * edge_length, np.maximum(lengths, 0.5 * edge_length)))]


def _clear(points: Reals, starts: Reals, ends: Reals, distance: Reals) -> np.ndarray:
    """Whether points [n] are further from every segment [m] than its distance [m]."""
    along = ends - starts
    squared = np.maximum((along**2).sum(1), 1e-30)
    clear = np.ones(len(points), bool)
    for first in range(0, len(points), 4096):
        chunk = points[first : first + 4096, None]
        t = np.clip(((chunk - starts) * along).sum(2) / squared, 0, 1)
        nearest = starts + t[..., None] * along
        clear[first : first + 4096] = (((chunk - nearest) ** 2).sum(2) > distance**2).all(axis=1)
    return clear


def _inside(boundary: Reals, points: Reals) -> np.ndarray:
    """Whether points [n] are inside a closed line [m, 2], by the number of its edges to their right."""
    inside = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(boundary, np.roll(boundary, -1, axis=0)):
        spans = (y0 > points[:, 1]) != (y1 > points[:, 1])
        if spans.any():
            inside[spans] ^= points[spans, 0] < x0 + (points[spans, 1] - y0) * (x1 - x0) / (y1 - y0)
    return inside


def _smoothed(points: Reals, faces: Integers, fixed: int) -> Reals:
    """Returns the interior points, each at the mean of its neighbours."""
    sums, counts = np.zeros_like(points), np.zeros(len(points))
    for i, j in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)):
        np.add.at(sums, faces[:, i], points[faces[:, j]])
        np.add.at(counts, faces[:, i], 1)
    moved = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], points)
    return moved[fixed:]


def _assemble(
    pattern: SewingPattern, edge_length: float, fractions: _Fractions, parts: list[tuple[Reals, Integers]]
) -> PatternMesh:
    first = np.cumsum([0] + [len(points) for points, _ in parts])
    faces, material, positions, right = [], [], [], 0.0
    for index, (points, triangles) in enumerate(parts):
        panel = pattern.panels[index]
        clockwise = panel.area < 0
        faces.append((triangles[:, ::-1] if clockwise else triangles) + first[index])
        flat = points * [-1, 1] if clockwise else points
        material.append(flat - flat.min(axis=0) + [right, 0])
        right = material[-1][:, 0].max() + MARGIN
        positions.append(panel.place(points))
    of_edge = _edge_vertices(pattern, fractions, first)
    pairs = []
    for seam in pattern.seams:
        a, b = of_edge[seam.first], of_edge[seam.second]
        pairs.append(np.stack([a, b[::-1] if seam.reversed else b], axis=1))
    return PatternMesh(
        pattern,
        edge_length,
        np.concatenate([points for points, _ in parts]),
        np.concatenate(material),
        np.concatenate(positions),
        np.concatenate(faces),
        np.repeat(np.arange(len(parts)), [len(triangles) for _, triangles in parts]),
        np.repeat(np.arange(len(parts)), [len(points) for points, _ in parts]),
        pairs,
        [of_edge[elastic.edge] for elastic in pattern.elastics],
    )


def _edge_vertices(pattern: SewingPattern, fractions: _Fractions, first: Integers) -> dict[tuple[int, int], Integers]:
    """Returns the vertices of every edge of every panel, both ends among them."""
    result = {}
    for p, panel in enumerate(pattern.panels):
        counts = [len(fractions[p, e]) - 1 for e in range(len(panel.edges))]
        starts = np.cumsum([0] + counts)
        for e, count in enumerate(counts):
            result[p, e] = first[p] + (starts[e] + np.arange(count + 1)) % starts[-1]
    return result


def _collapsing(mesh: PatternMesh) -> Integers:
    """Returns the triangles with two corners that become one vertex, and those of edges that get three triangles."""
    joined = mesh.merged()[mesh.faces]
    flat = (joined == np.roll(joined, 1, axis=1)).any(axis=1)
    edges = np.sort(np.stack([joined, np.roll(joined, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, inverse, counts = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    crowded = (counts[inverse.ravel()] > 2).reshape(-1, 3).any(axis=1)
    return np.flatnonzero(flat | crowded).astype(np.int32)


def edge_length_of(pattern: SewingPattern, triangles: int) -> float:
    """Returns the edge length, m, at which a pattern has about so many triangles."""
    if triangles < 1:
        raise MeshError(f"{pattern.name}: {counted(triangles, 'triangle')} are too few")
    return math.sqrt(4 / math.sqrt(3) * pattern.area / triangles)


__all__ = ["Panel", "PatternMesh", "edge_length_of", "merge_map", "mesh_pattern"]
