# SPDX-License-Identifier: Apache-2.0
"""Triangles that show exact obstacles, which have no mesh."""

import numpy as np


def tessellate(surface, radius, points, around=48, seen=((0, 0, 0), 1.0)):
    """Triangles to draw an exact obstacle by: vertices [n, 3], faces [m, 3]; their number depends on `surface` alone.

    points: its defining points, [1, 3] of a sphere, [2, 3] of a capsule, [3, 3] of a plane.
    seen: a point and a length, m; of a plane a square is drawn, twice as wide as that, around the foot of the point.
    """
    if surface == "plane":
        u, w = points[1] - points[0], points[2] - points[0]
        u = u / np.linalg.norm(u)
        w = w - (w @ u) * u
        w = w / np.linalg.norm(w)
        center, extent = seen
        off = np.asarray(center) - points[0]
        return points[0] + (off @ u) * u + (off @ w) * w + extent * np.array([-u - w, u - w, u + w, w - u]), np.array(
            [[0, 1, 2], [0, 2, 3]]
        )
    low, high = points[0], points[-1]
    axis = high - low
    length = np.linalg.norm(axis)
    axis = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    u /= np.linalg.norm(u)
    w = np.cross(axis, u)
    half = around // 4
    latitudes = np.concatenate([np.linspace(-np.pi / 2, 0, half + 1), np.linspace(0, np.pi / 2, half + 1)])
    ends = np.repeat([low, high], half + 1, axis=0)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * w
    vertices = (
        ends[:, None] + radius * (np.cos(latitudes)[:, None, None] * ring + np.sin(latitudes)[:, None, None] * axis)
    ).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(latitudes) - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    return vertices, np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])


def drawn(part, positions, seen=((0, 0, 0), 1.0)):
    """Vertices [n, 3] and faces [m, 3] that show a part of a frame; `seen` as for `tessellate`."""
    points = positions[part.vertices]
    if part.shape in ("mesh", "box"):
        return points, part.faces
    return tessellate(part.shape, part.radius, points, seen=seen)
