# SPDX-License-Identifier: Apache-2.0
"""Measures of triangles and closed surfaces, by which findings are made."""

from __future__ import annotations

import math

import numpy as np

from ..types import Integers, Reals

SAMPLES = 200  # triangles that medians are taken over


def sample(rows: Integers) -> Integers:
    """Returns at most about SAMPLES of the rows, evenly spaced."""
    return rows[:: max(1, len(rows) // SAMPLES)]


def edges_of(corners: Reals) -> Reals:
    """Returns the edges [m, 3, 2 or 3] of triangles with these corners."""
    return corners[:, [1, 2, 0]] - corners


def lengths_of(edges: Reals) -> Reals:
    """Returns the lengths [m, 3] of edges."""
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ij", edges, edges)))


def areas_of(edges: Reals) -> Reals:
    """Returns the areas [m] of triangles with these edges."""
    a, b = edges[:, 0], edges[:, 1]
    aa, ab, bb = (np.einsum("ij,ij->i", p, q) for p, q in ((a, a), (a, b), (b, b)))
    return np.asarray(0.5 * np.sqrt(np.maximum(aa * bb - ab * ab, 0.0)))


def ratios_of(values: Reals, to: Reals) -> Reals:
    """Returns values over others [n], without those of slivers, whose areas round to 0."""
    good = (values > 0) & (to > 0)
    return np.asarray(values[good] / to[good])


def median(values: Reals) -> float:
    """Returns the median of all values; of an even number the upper one."""
    return float(np.sort(values, axis=None)[values.size // 2])


def rims_and_turns(faces: Integers, count: int) -> tuple[int, int]:
    """Returns how many edges have one face, and how many have two that take them in the same direction."""
    first, second = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    numbers = np.diff(starts, append=len(keys))
    pairs = starts[numbers == 2]
    along = (first < second)[order]
    return int(np.count_nonzero(numbers == 1)), int(np.count_nonzero(along[pairs] == along[pairs + 1]))


def winding(corners: Reals, point: Reals) -> float:
    """Returns how often a surface of triangles winds around a point: 1 inside a closed one that is turned outward.

    The solid angles of the triangles are those of Van Oosterom and Strackee 1983.
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", p, p)) for p in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2 * math.pi))
