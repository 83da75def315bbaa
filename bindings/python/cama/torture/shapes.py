# SPDX-License-Identifier: Apache-2.0
"""Meshes and curves of the extreme cases, in plain NumPy. Lengths in m; faces [m, 3] count from 0."""

import numpy as np


def rotation(axis, angle):
    """[3, 3]: by `angle` rad about `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def cells(columns, rows, wrap=False):
    """Faces over a (columns + 1) x (rows + 1) lattice of vertices, row after row; diagonals alternate.

    wrap: column `columns` is column 0.
    """
    across = columns if wrap else columns + 1
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="xy")
    i, j = i.ravel(), j.ravel()
    a, b = j * across + i, j * across + (i + 1) % across
    c, d = b + across, a + across
    even = ((i + j) % 2 == 0)[:, None]
    first = np.where(even, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(even, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.concatenate([first, second])


def lattice(width, height, columns, rows):
    """Rectangle in the plane z = 0 around the origin: vertices [n, 3], faces."""
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1), indexing="xy"
    )
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1), cells(columns, rows)


def sheet(width, height, triangles):
    """The same with about this many nearly isosceles triangles."""
    columns = max(1, round(np.sqrt(triangles / 2 * width / height)))
    return lattice(width, height, columns, max(1, round(triangles / 2 / columns)))


def join(parts):
    """One mesh of several (vertices, faces)."""
    first = np.cumsum([0] + [len(v) for v, _ in parts])
    return np.concatenate([v for v, _ in parts]), np.concatenate([f + n for (_, f), n in zip(parts, first)])


def box(size, divisions=(1, 1, 1)):
    """Closed box around the origin, each face a lattice; vertices of edges are shared."""
    parts = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        flat, faces = lattice(size[u], size[v], divisions[u], divisions[v])
        for side in (1, -1):
            vertices = np.zeros_like(flat)
            vertices[:, u], vertices[:, v], vertices[:, axis] = flat[:, 0], flat[:, 1], side * size[axis] / 2
            parts.append((vertices, faces if side > 0 else faces[:, ::-1]))
    vertices, faces = join(parts)
    _, kept, number = np.unique(np.round(vertices, 9), axis=0, return_index=True, return_inverse=True)
    return vertices[kept], number.reshape(-1)[faces]


def revolution(profile, segments):
    """Closed polygon of (radius > 0, z) points, counter-clockwise, turned about the z axis."""
    angle = 2 * np.pi * np.arange(segments) / segments
    r, z = np.asarray(profile, float).T
    rings = np.stack(
        [r[:, None] * np.cos(angle), r[:, None] * np.sin(angle), np.repeat(z[:, None], segments, 1)], 2
    ).reshape(-1, 3)
    faces = cells(segments, len(r), wrap=True) % len(rings)
    return rings, faces


def cone(radius, height, segments=6):
    """Closed cone, base at z = 0, tip at z = height."""
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(segments)], 1)
    i, j = np.arange(segments), (np.arange(segments) + 1) % segments
    side = np.stack([i, j, np.full(segments, segments)], 1)
    base = np.stack([j, i, np.full(segments, segments + 1)], 1)
    return np.concatenate([ring, [[0, 0, height], [0, 0, 0]]]), np.concatenate([side, base])


def wedge(width, height, length, segments):
    """Closed prism along y with its edge at z = 0 and its back, `width` wide, at z = -height."""
    y = np.linspace(-length / 2, length / 2, segments + 1)
    corners = np.array([[0, 0], [-width / 2, -height], [width / 2, -height]])
    vertices = np.concatenate([np.stack([np.full_like(y, x), y, np.full_like(y, z)], 1) for x, z in corners])
    n, k = segments + 1, np.arange(segments)
    faces = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        p, q = a * n + k, b * n + k
        faces += [np.stack([p, p + 1, q], 1), np.stack([q, p + 1, q + 1], 1)]
    return vertices, np.concatenate(faces + [np.array([[0, n, 2 * n], [segments, 2 * n + segments, n + segments]])])


def plate_with_hole(outer, hole, thickness, segments, rings=4):
    """Round plate in the plane z = 0 with a round hole whose rim is chamfered by a quarter of the thickness."""
    c, h = thickness / 4, thickness / 2
    across = np.linspace(hole + c, outer, rings + 1)
    top = [(r, h) for r in across[::-1]]
    bottom = [(r, -h) for r in across]
    return revolution(bottom + top + [(hole, h - c), (hole, -h + c)], segments)


def frames(points, first_normal):
    """Unit tangents [n, 3] and normals [n, 3] along a curve that turn about it as little as possible (double reflection, Wang 2008)."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.zeros_like(points)
    start = np.asarray(first_normal, float) - np.dot(first_normal, tangent[0]) * tangent[0]
    normal[0] = start / np.linalg.norm(start)
    for i in range(len(points) - 1):
        v1 = points[i + 1] - points[i]
        reflected = normal[i] - 2 / v1.dot(v1) * v1.dot(normal[i]) * v1
        turned = tangent[i] - 2 / v1.dot(v1) * v1.dot(tangent[i]) * v1
        v2 = tangent[i + 1] - turned
        normal[i + 1] = reflected - (2 / v2.dot(v2) * v2.dot(reflected) * v2 if v2.dot(v2) > 0 else 0)
    return tangent, normal


def resample(points, count):
    """`count` points at equal arc length along a polyline, and that length."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, length[-1], count)
    return np.stack([np.interp(at, length, points[:, k]) for k in range(3)], 1), length[-1]


def ribbon(points, width, columns, first_normal):
    """Strip along a curve: vertices [n, 3], faces, material vertices [n, 2] (across, along)."""
    _, normal = frames(points, first_normal)
    across = np.linspace(-width / 2, width / 2, columns + 1)
    vertices = points[:, None] + across[None, :, None] * normal[:, None]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    u, v = np.broadcast_arrays(across[None], along[:, None])
    return vertices.reshape(-1, 3), cells(columns, len(points) - 1), np.stack([u.ravel(), v.ravel()], 1)


def overhand(samples=2000, reach=2.15):
    """Open trefoil, the polynomial knot (t^3 - 3t, t^4 - 4t^2, t^5 - 10t) (Shastri 1992), axes scaled to be about as wide as high."""
    t = np.linspace(-reach, reach, samples)
    return np.stack([t**3 - 3 * t, (t**4 - 4 * t**2) / 1.6, (t**5 - 10 * t) / 6], 1)


def gauss(first, second):
    """Gauss integrals [n, m] between the segments of two polylines, over 4 pi (Klenin and Langowski 2000); sums to the linking number."""
    a, b, c, d = first[:-1, None], first[1:, None], second[None, :-1], second[None, 1:]
    ac, ad, bc, bd = c - a, d - a, c - b, d - b
    n = [np.cross(ac, ad), np.cross(ad, bd), np.cross(bd, bc), np.cross(bc, ac)]
    with np.errstate(divide="ignore", invalid="ignore"):
        n = [np.nan_to_num(k / np.linalg.norm(k, axis=-1, keepdims=True)) for k in n]
    angle = sum(np.arcsin(np.clip((n[k] * n[(k + 1) % 4]).sum(-1), -1, 1)) for k in range(4))
    sign = np.sign((np.cross(d - c, b - a) * ac).sum(-1))
    return angle * sign / (4 * np.pi)


def writhe(points):
    """Of an open polyline: 0 for a straight one, about 3.4 for a tight overhand knot (an ideal trefoil; Katritch 1996)."""
    values = gauss(points, points)
    n = len(values)
    apart = np.abs(np.arange(n)[:, None] - np.arange(n)[None]) > 1
    return float((values * apart).sum())


def linking(first, second):
    """Gauss linking number of two closed polylines (first point not repeated)."""
    return float(gauss(np.concatenate([first, first[:1]]), np.concatenate([second, second[:1]])).sum())


def heights(vertices, faces, points):
    """For each of points [k, 2]: sorted heights z at which the vertical line through it meets the surface."""
    corners = vertices[faces]
    a, b, c = corners[:, 0, :2], corners[:, 1, :2], corners[:, 2, :2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    result = []
    for p in np.atleast_2d(points):
        with np.errstate(divide="ignore", invalid="ignore"):
            v = ((p[0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (p[1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / area
            w = ((b[:, 0] - a[:, 0]) * (p[1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[0] - a[:, 0])) / area
            inside = (v >= 0) & (w >= 0) & (v + w <= 1)
        z = corners[inside][:, :, 2]
        result.append(np.sort((1 - v[inside] - w[inside]) * z[:, 0] + v[inside] * z[:, 1] + w[inside] * z[:, 2]))
    return result
