# SPDX-License-Identifier: Apache-2.0
"""What cloth can be coloured by: functions of arrays, without a window or a simulation.

Lengths are in m. `faces` are [m, 3] indices into the vertices [n, 3].
"""

import numpy as np


def _dot(a, b):
    """Inner products [k] of rows [k, 3], or of one with all."""
    return np.einsum("...i,...i->...", a, b)


def _cross(a, b):
    """Cross products [k, 3] of rows; several times as fast as numpy.cross."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def inverse_rest(corners):
    """Returns the inverse [m, 2, 2] of the two edges of triangles at rest, given as corners [m, 3, 2]; 1/m.

    Triangles without area at rest get zeros: their strain is -1.
    """
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2)
    (a, b), (c, d) = edges[:, 0].T, edges[:, 1].T
    determinant = a * d - b * c
    scale = np.where(determinant != 0, determinant, np.inf)
    return np.stack([np.stack([d, -b], 1), np.stack([-c, a], 1)], 1) / scale[:, None, None]


def strain(vertices, faces, inverse):
    """Returns the largest principal stretch minus one [m] of triangles, given `inverse_rest` [m, 2, 2].

    It is the square root of the larger eigenvalue of F'F, minus one, F the deformation gradient [3, 2].
    """
    start = vertices[faces[:, 0]]
    first, second = vertices[faces[:, 1]] - start, vertices[faces[:, 2]] - start
    u = first * inverse[:, 0, 0, None] + second * inverse[:, 1, 0, None]
    v = first * inverse[:, 0, 1, None] + second * inverse[:, 1, 1, None]
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    return np.sqrt((uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)) - 1


def edges_between(faces):
    """Returns the edges with two faces: edges [k, 2], faces beside them [k, 2]; edge 0 -> 1 goes with the first face.

    Edges of more faces appear for two of them.
    """
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    key = np.sort(ends, 1)
    order = np.lexsort(key.T)
    same = (key[order[1:]] == key[order[:-1]]).all(1)
    first, second = order[:-1][same], order[1:][same]
    return ends[first], np.stack([owner[first], owner[second]], 1)


def mean_curvature(vertices, faces, between=None):
    """Returns the magnitude of the mean curvature [n] at vertices, 1/m: 1/r of a sphere, 1/(2 r) of a cylinder.

    Of each edge it is its length times the angle between its faces / 2 (Steiner's formula), half of it at each end;
    the sum is divided by a third of the area around the vertex.

    Args:
        vertices: Positions [n, 3].
        faces: Triangles [m, 3], turned alike.
        between: `edges_between(faces)`, where it is at hand.
    """
    edges, beside = edges_between(faces) if between is None else between
    corners = vertices[faces]
    normals = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt(_dot(normals, normals)) / 2
    unit = normals / np.where(area > 0, 2 * area, 1)[:, None]
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    length = np.sqrt(_dot(along, along))
    one, other = unit[beside[:, 0]], unit[beside[:, 1]]
    sine = _dot(_cross(one, other), along) / np.where(length > 0, length, 1)
    total = length * np.arctan2(sine, _dot(one, other)) / 2
    sums = np.bincount(edges.ravel(), np.repeat(total / 2, 2), len(vertices))
    around = np.bincount(faces.ravel(), np.repeat(area / 3, 3), len(vertices))
    return np.abs(sums) / np.where(around > 0, around, np.inf)


def speed(velocities):
    """Returns the speed [n] of velocities [n, 3], m/s."""
    return np.sqrt(_dot(velocities, velocities))


def velocities_between(before, after, seconds):
    """Returns the mean velocities [n, 3], m/s, between two positions [n, 3] that are some seconds apart."""
    return (after - before) / seconds if seconds > 0 else np.zeros_like(before)


def contact_counts(contacts, count):
    """Returns at how many contacts each of the first `count` vertices is, of a structured array with `vertices` [4]
    and `weights` [4], as `Simulation.contacts` is. A weight of zero is no part of the contact."""
    taking_part = contacts["vertices"][contacts["weights"] != 0]
    return np.bincount(taking_part[taking_part < count], minlength=count)


def distance_to_segments(points, start, end):
    """Returns the distances [k] of points [k, 3] to segments from `start` to `end`, [k, 3] or [3]."""
    along = end - start
    squared = _dot(along, along)
    part = np.clip(_dot(points - start, along) / np.where(squared > 0, squared, 1), 0, 1)
    return np.linalg.norm(points - start - part[:, None] * along, axis=1)


def distance_to_triangles(points, a, b, c):
    """Returns the distances [k] of points [k, 3] to triangles with the corners a, b, c, [k, 3] or [3]."""
    nearest = distance_to_segments(points, a, b)
    for start, end in ((b, c), (c, a)):
        nearest = np.minimum(nearest, distance_to_segments(points, start, end))
    normal = _cross(b - a, c - a)
    squared = _dot(normal, normal)
    safe = np.where(squared > 0, squared, 1)
    first = _dot(_cross(b - points, c - points), normal) / safe
    second = _dot(_cross(c - points, a - points), normal) / safe
    above = (squared > 0) & (first >= 0) & (second >= 0) & (first + second <= 1)
    return np.where(above, np.minimum(nearest, np.abs(_dot(points - a, normal)) / np.sqrt(safe)), nearest)


class Gaps:
    """Distances of cloth vertices to the nearest other surface, up to a reach.

    Other is another part, or the same cloth where two places were more than twice as far apart at the start as they
    are now: so a fold is seen, and the neighbourhood of a vertex is not.

    Distances to exact spheres, capsules and planes, and to meshes of few triangles, are exact. Of other meshes the
    nearest vertices come from a k-d tree, and the distance is that to the triangles around them; where triangles are
    wider than the reach, some are missed.

    Args:
        start: Positions of all vertices [n, 3] at the start.
        cloths, obstacles: Parts with vertices (a slice), faces (counted from it), shape and radius.
    """

    NEIGHBOURS = 24  # nearest vertices of the same cloth that are looked at
    FEW = 64  # triangles that are all looked at

    def __init__(self, start, cloths, obstacles):
        self._start, self._cloths, self._obstacles = start, cloths, obstacles
        self._fans = {id(part): _fan(part) for part in (*cloths, *obstacles)}

    def __call__(self, vertices, reach):
        """Returns the distances [cloth vertices], m, of the positions [n, 3]; `reach` where they are larger."""
        from scipy.spatial import cKDTree

        best = np.full(max((part.vertices.stop for part in self._cloths), default=0), float(reach))
        for part in (*self._cloths, *self._obstacles):
            inside = np.zeros(len(best), bool)
            inside[part.vertices] = True
            asking, points = np.flatnonzero(~inside), vertices[part.vertices]
            if part.shape in ("sphere", "capsule"):
                best[asking] = np.minimum(
                    best[asking], np.abs(distance_to_segments(vertices[asking], points[0], points[-1]) - part.radius)
                )
                continue
            if part.shape == "plane":
                normal = _cross(points[1] - points[0], points[2] - points[0])
                height = (vertices[asking] - points[0]) @ (normal / np.linalg.norm(normal))
                best[asking] = np.minimum(best[asking], np.abs(height))
                continue
            if not len(part.faces):
                continue
            low, high = points.min(0) - reach, points.max(0) + reach
            asking = asking[((vertices[asking] >= low) & (vertices[asking] <= high)).all(1)]
            if len(part.faces) <= self.FEW:
                for corners in points[part.faces]:
                    best[asking] = np.minimum(best[asking], distance_to_triangles(vertices[asking], *corners))
                if part not in self._cloths:
                    continue
            tree, widest = cKDTree(points), reach + _edge(points, part.faces)
            if len(part.faces) > self.FEW and len(asking):
                distance, found = tree.query(vertices[asking], distance_upper_bound=widest)
                near = distance < np.inf
                self._lower(best, vertices, part, asking[near], found[near])
            if part in self._cloths:
                self._fold(best, vertices, part, tree, widest)
        return best

    def _fold(self, best, vertices, part, tree, widest):
        """Lowers `best` to the distances of a cloth to itself."""
        count = part.vertices.stop - part.vertices.start
        points, start, own = vertices[part.vertices], self._start[part.vertices], np.arange(count)
        distance, found = tree.query(points, k=min(self.NEIGHBOURS, count), distance_upper_bound=widest)
        distance, found = distance.reshape(count, -1), np.minimum(found.reshape(count, -1), count - 1)
        apart = np.linalg.norm(start[found] - start[:, None], axis=2)
        folded = (distance < np.inf) & (apart > 2 * distance) & (found != own[:, None])
        some = np.flatnonzero(folded.any(1))
        self._lower(best, vertices, part, part.vertices.start + some, found[some, folded[some].argmax(1)])

    def _lower(self, best, vertices, part, asking, near):
        """Lowers `best` at some vertices to the distances to the triangles around vertices of a part near them."""
        first, around = self._fans[id(part)]
        count, points = first[near + 1] - first[near], vertices[part.vertices]
        for k in range(int(count.max()) if len(count) else 0):
            some = count > k
            corners = points[part.faces[around[first[near[some]] + k]]]
            best[asking[some]] = np.minimum(
                best[asking[some]], distance_to_triangles(vertices[asking[some]], *corners.transpose(1, 0, 2))
            )


def _fan(part):
    """The faces around each vertex of a part: where they begin [n + 1], and the faces one vertex after the other."""
    corners = part.faces.ravel()
    order = np.argsort(corners, kind="stable")
    return np.searchsorted(corners[order], np.arange(part.vertices.stop - part.vertices.start + 1)), order // 3


def _edge(vertices, faces):
    """A usual length of an edge, m."""
    some = faces[:: max(1, len(faces) // 1000)]
    return float(np.median(np.linalg.norm(vertices[some[:, 1]] - vertices[some[:, 0]], axis=1)))
