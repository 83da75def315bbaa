# SPDX-License-Identifier: Apache-2.0
"""Measures of one state or of two surfaces: distances, strain, gaps, missed contacts, drape. Needs scipy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import collision
from ..arrays import integers, number, reals
from ..errors import ArrayError, MeshError
from ..hints import require
from ..scene import Scene
from ..types import ArrayLike, Integers, Reals


@dataclass
class SurfaceDistance:
    """How far two surfaces are apart, m."""

    hausdorff: float  #: largest distance from a sample of either surface to the other
    mean: float  #: area-weighted mean over both surfaces
    rms: float  #: root of the area-weighted mean square over both
    forward: float  #: largest from the first to the second
    backward: float  #: largest from the second to the first
    spacing: float  #: mean distance of neighbouring samples: what `hausdorff` may be too small by


def _surface(name: str, vertices: ArrayLike, faces: ArrayLike) -> tuple[Reals, Integers]:
    vertices = reals(f"{name}: vertices", vertices, (None, 3))
    faces = integers(f"{name}: faces", faces, (None, 3))
    if not len(faces):
        raise MeshError(f"{name}: no faces")
    outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if outside.any():
        row = int(outside.argmax())
        raise MeshError(f"{name}: face {row} is {faces[row].tolist()}, outside 0 to {len(vertices) - 1}")
    return vertices, faces


def areas(vertices: Reals, faces: Integers) -> Reals:
    """Area of every triangle [m], m^2, from vertices [n, 3] m and faces [m, 3]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def edges(faces: Integers) -> Integers:
    """Edges [k, 2] of faces [m, 3], each once, lower vertex first."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def edge_length(vertices: Reals, faces: ArrayLike) -> float:
    """Mean length of the edges, m."""
    pairs = edges(np.asarray(faces))
    return float(np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1).mean())


def samples(vertices: Reals, faces: Integers, count: int) -> tuple[Reals, Reals]:
    """Points [k, 3] on a surface and the area [k] each stands for, m^2: about `count`, spread evenly and the same every
    time.

    Triangles get points in proportion to their area, at least one, placed by the sequence R2 (Roberts 2018); vertices
    follow, with area 0.
    """
    own = areas(vertices, faces)
    total = own.sum()
    if not total > 0:
        raise MeshError("samples: the surface has no area")
    number_of = np.maximum(1, np.round(count * own / total).astype(int))
    row = np.repeat(np.arange(len(faces)), number_of)
    index = np.arange(len(row)) - np.repeat(np.cumsum(number_of) - number_of, number_of)
    u, v = (0.5 + (index + 1) * 0.7548776662466927) % 1, (0.5 + (index + 1) * 0.5698402909980532) % 1
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    a, b, c = (vertices[faces[row, k]] for k in range(3))
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    used = np.unique(faces)
    return np.concatenate([points, vertices[used]]), np.concatenate([(own / number_of)[row], np.zeros(len(used))])


def _tree(points: Reals) -> Any:
    require("the distance of surfaces", "scipy")
    from scipy.spatial import cKDTree

    return cKDTree(points)


def distance_to_surface(points: ArrayLike, vertices: ArrayLike, faces: ArrayLike) -> Reals:
    """Distance [k] m of points [k, 3] to a surface, exact: triangles near by centroid (k-d tree of scipy), more until
    none nearer can be left.
    """
    points = reals("distance_to_surface: points", points, (None, 3))
    vertices, faces = _surface("distance_to_surface", vertices, faces)
    corners = vertices[faces]
    centroids = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centroids[:, None], axis=2).max()
    tree, best, left, near = _tree(centroids), np.full(len(points), np.inf), np.arange(len(points)), min(8, len(faces))
    while len(left):
        spans, chosen = tree.query(points[left], k=near)
        spans, chosen = spans.reshape(len(left), near), chosen.reshape(len(left), near)
        rows = np.concatenate([np.repeat(points[left], near, axis=0)[:, None], corners[chosen.ravel()]], axis=1)
        best[left] = collision.vertex_face_distance(rows).reshape(len(left), near).min(axis=1)
        if near == len(faces):
            break
        left = left[spans[:, -1] - reach < best[left]]
        near = min(2 * near, len(faces))
    return best


def surface_distance(
    vertices: ArrayLike, faces: ArrayLike, other_vertices: ArrayLike, other_faces: ArrayLike, count: int = 5000
) -> SurfaceDistance:
    """Symmetric Hausdorff and mean distance of two surfaces of any meshes, sampled at about `count` points each; a
    SurfaceDistance.

    vertices [n, 3] m, faces [m, 3]; so the other's. Distances of the samples are exact (Aspert, Santa-Cruz and Ebrahimi
    2002). Raises ArrayError, MeshError.
    """
    first, second = (
        _surface("surface_distance: first", vertices, faces),
        _surface("surface_distance: second", other_vertices, other_faces),
    )
    count = int(number("surface_distance: count", count))
    if count < 1:
        raise ArrayError(f"surface_distance: count is {count}, below 1")
    (points, weight), (other_points, other_weight) = samples(*first, count), samples(*second, count)
    there, back = distance_to_surface(points, *second), distance_to_surface(other_points, *first)
    both, weights = np.concatenate([there, back]), np.concatenate([weight, other_weight])
    spacing = np.sqrt(max(weight.sum() / len(weight), other_weight.sum() / len(other_weight)))
    return SurfaceDistance(
        float(both.max()),
        float(both @ weights / weights.sum()),
        float(np.sqrt(both**2 @ weights / weights.sum())),
        float(there.max()),
        float(back.max()),
        float(spacing),
    )


@dataclass
class Strain:
    """How triangles are stretched against their rest shapes."""

    principal: Reals  #: [triangles, 2] principal stretches minus one, the larger first
    area_ratio: Reals  #: [triangles] area over rest area
    largest: float  #: largest principal strain
    p999: float  #: its 99.9 % quantile over the triangles' larger strains
    smallest_area: float  #: smallest area ratio
    mean_area: float  #: mean area ratio, weighted by rest area


def strain(vertices: ArrayLike, faces: ArrayLike, rest: ArrayLike) -> Strain:
    """Principal strains of triangles: singular values of the deformation gradient minus one; a Strain.

    vertices [n, 3] m, faces [m, 3], rest [m, 3, 2] or [m, 3, 3] m: corners of every triangle at rest (see
    `rest_shapes`). Raises ArrayError.
    """
    vertices, faces = _surface("strain", vertices, faces)
    rest = np.asarray(rest, dtype=np.float64)
    if rest.ndim != 3 or rest.shape[:2] != (len(faces), 3) or rest.shape[2] not in (2, 3):
        raise ArrayError(
            f"strain: rest: shape {list(rest.shape)}, expected [{len(faces)}, 3, 2] or [{len(faces)}, 3, 3]"
        )
    rest = reals("strain: rest", rest, rest.shape)
    rest = _flat(rest) if rest.shape[2] == 3 else rest
    before, after = (np.stack([c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]], axis=2) for c in (rest, vertices[faces]))
    size = np.abs(np.linalg.det(before)) / 2
    if not (size > 0).all():
        raise MeshError(f"strain: rest: triangle {int((size <= 0).argmax())} has no area")
    stretch = np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)
    principal, ratio = stretch - 1, stretch[:, 0] * stretch[:, 1]
    return Strain(
        principal,
        ratio,
        float(principal[:, 0].max()),
        float(np.quantile(principal[:, 0], 0.999)),
        float(ratio.min()),
        float(ratio @ size / size.sum()),
    )


def _flat(corners: Reals) -> Reals:
    """Triangles [m, 3, 3] laid into the plane, [m, 3, 2]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(a, axis=1)
    along = np.einsum("ij,ij->i", a, b) / length
    across = np.linalg.norm(np.cross(a, b), axis=1) / length
    zero = np.zeros(len(a))
    return np.stack([np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([along, across], 1)], axis=1)


def rest_shapes(scene: Scene) -> Reals:
    """Corners at rest of all cloth triangles of a Scene, [triangles, 3, 2] m: material space where a cloth has one,
    else its start; shrunk where it is.
    """
    parts = []
    for cloth in scene.cloths:
        flat = len(cloth.material_faces) or len(cloth.shrinkage)
        parts.append(cloth.rest_corners if flat else _flat(cloth.vertices[cloth.faces]))
    return np.concatenate(parts) if parts else np.zeros((0, 3, 2))


def _near(tree: Any, points: Reals, reach: float) -> tuple[Any, Any]:
    """Row pairs (of points, of the tree's) that are within `reach` of each other."""
    found = tree.query_ball_point(points, reach)
    count = np.fromiter((len(f) for f in found), int, len(found))
    return np.repeat(np.arange(len(points)), count), np.concatenate(
        [np.asarray(f, int) for f in found]
    ) if count.sum() else np.zeros(0, int)


def _gap_of(measure, first, second, corners_a, corners_b, first_obstacle_vertex):
    a, b = first, second
    shared = (a[:, :, None] == b[:, None, :]).any(axis=(1, 2))
    outside = (a >= first_obstacle_vertex).all(axis=1) & (b >= first_obstacle_vertex).all(axis=1)
    keep = ~(shared | outside)
    return measure(np.concatenate([corners_a[keep], corners_b[keep]], axis=1)).min() if keep.any() else np.inf


def smallest_gap(vertices: ArrayLike, faces: ArrayLike, within: float, first_obstacle_vertex: int = -1) -> float:
    """Smallest distance, m, over vertices with faces and edges with edges that share no vertex; inf if none is within
    `within` [m].

    vertices [n, 3] m, faces [m, 3].  first_obstacle_vertex: pairs of this vertex and later ones among themselves are
    left out; -1: none. 0 where surfaces touch or intersect only if a pair's own distance is 0: count intersections too.
    Raises ArrayError, MeshError.
    """
    vertices, faces = _surface("smallest_gap", vertices, faces)
    within = number("smallest_gap: within", within)
    first = len(vertices) if first_obstacle_vertex < 0 else int(first_obstacle_vertex)
    smallest = np.inf
    corners = vertices[faces]
    middle = corners.mean(axis=1)
    reach = within + np.linalg.norm(corners - middle[:, None], axis=2).max()
    used = np.unique(faces)
    rows, others = _near(_tree(middle), vertices[used], reach)
    if len(rows):
        smallest = _gap_of(
            collision.vertex_face_distance,
            used[rows][:, None],
            faces[others],
            vertices[used[rows]][:, None],
            corners[others],
            first,
        )
    pairs = edges(faces)
    ends = vertices[pairs]
    middle, half = ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() / 2
    tree = _tree(middle)
    close = tree.query_pairs(within + 2 * half, output_type="ndarray")
    if len(close):
        a, b = close[:, 0], close[:, 1]
        smallest = min(smallest, _gap_of(collision.edge_edge_distance, pairs[a], pairs[b], ends[a], ends[b], first))
    return float(smallest) if smallest <= within else float("inf")


def missed_contacts(
    before: ArrayLike, after: ArrayLike, faces: ArrayLike, first_obstacle_vertex: int = -1
) -> tuple[Integers, Integers]:
    """Pairs that pass through each other while all vertices move straight from `before` to `after` [n, 3] m: what
    collision handling missed.

    Brute force over all boxes of motion, then continuous detection at distance 0 (`collision`); for small meshes, the
    work grows with the square of `faces` [m, 3]. Pairs that share a vertex and obstacle against obstacle are left out.
    Returns (vertex-face pairs [k, 2], edge-edge pairs [k, 4] as vertex numbers). Raises ArrayError, MeshError.
    """
    before, faces = _surface("missed_contacts: before", before, faces)
    after = reals("missed_contacts: after", after, before.shape)
    first = len(before) if first_obstacle_vertex < 0 else int(first_obstacle_vertex)
    used, pairs = np.unique(faces)[:, None], edges(faces)
    vf = _passing(used, faces, before, after, first, collision.vertex_face_ccd, False)
    ee = _passing(pairs, pairs, before, after, first, collision.edge_edge_ccd, True)
    return np.stack([used[vf[0], 0], vf[1]], axis=1), np.concatenate([pairs[ee[0]], pairs[ee[1]]], axis=1)


def _passing(first, second, before, after, first_obstacle, detect, ordered):
    both = np.stack([before, after])
    boxes = [(both[:, part].min(axis=(0, 2)), both[:, part].max(axis=(0, 2))) for part in (first, second)]
    hits = [np.zeros((2, 0), int)]
    chunk = max(1, 4_000_000 // max(1, len(second)))
    for start in range(0, len(first), chunk):
        part = slice(start, start + chunk)
        overlap = ((boxes[0][0][part, None] <= boxes[1][1][None]) & (boxes[0][1][part, None] >= boxes[1][0][None])).all(
            axis=2
        )
        a, b = np.nonzero(overlap)
        a += start
        shared = (first[a][:, :, None] == second[b][:, None, :]).any(axis=(1, 2))
        outside = (first[a] >= first_obstacle).all(axis=1) & (second[b] >= first_obstacle).all(axis=1)
        keep = ~(shared | outside) & ((a < b) if ordered else True)
        a, b = a[keep], b[keep]
        if len(a):
            corners = np.concatenate([first[a], second[b]], axis=1)
            hit, _ = detect(before[corners], after[corners])
            hits.append(np.stack([a[hit], b[hit]]))
    return np.concatenate(hits, axis=1)


def shadow_area(vertices: ArrayLike, faces: ArrayLike, pixels: int = 1000, axis: int = 2) -> float:
    """Area of a surface's projection along an axis, m^2, counted on a raster of about pixels x pixels."""
    vertices, faces = _surface("shadow_area", vertices, faces)
    flat = np.delete(vertices, axis, axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = (high - low).max() / pixels
    if not size > 0:
        return 0.0
    shape = np.maximum(1, np.ceil((high - low) / size).astype(int))
    image = np.zeros(shape, bool)
    for a, b, c in (flat[faces] - low) / size - 0.5:  # centres of pixels at whole numbers
        corner = np.maximum(0, np.ceil(np.minimum(np.minimum(a, b), c)).astype(int))
        end = np.minimum(shape, np.floor(np.maximum(np.maximum(a, b), c)).astype(int) + 1)
        if (end <= corner).any():
            continue
        x, y = np.meshgrid(np.arange(corner[0], end[0]), np.arange(corner[1], end[1]), indexing="ij")
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        inside = (np.minimum(np.minimum(*sides[:2]), sides[2]) >= 0) | (
            np.maximum(np.maximum(*sides[:2]), sides[2]) <= 0
        )
        image[corner[0] : end[0], corner[1] : end[1]] |= inside
    return float(image.sum() * size**2)


def drape_coefficient(
    vertices: ArrayLike, faces: ArrayLike, disc_radius: float, flat_area: float, pixels: int = 1000
) -> float:
    """Cusick's drape coefficient: (shadow - disc) / (flat cloth - disc), 1 for a board, 0 for cloth that hangs straight
    down.

    vertices [n, 3] m, z up; disc_radius: of the table, m; flat_area: of the cloth, m^2 (Cusick 1968, ISO 9073-9).
    Raises ArrayError.
    """
    disc = np.pi * number("drape_coefficient: disc_radius", disc_radius) ** 2
    flat_area = number("drape_coefficient: flat_area", flat_area)
    if not 0 < disc < flat_area:
        raise ArrayError(
            f"drape_coefficient: the disc has {disc:.4g} m^2 and the cloth {flat_area:.4g}; the cloth must be larger"
        )
    return (max(shadow_area(vertices, faces, pixels), disc) - disc) / (flat_area - disc)
