# SPDX-License-Identifier: Apache-2.0
"""Skins that follow the bones of a body: weights, and dual quaternions."""

from __future__ import annotations

import numpy as np

from .isosurface import Ring
from .posing import PARENTS
from .types import Integers, Reals

__all__ = ["skinned", "smoothed"]

SMOOTH = 0.04  # m, width of a joint's skin


def smoothed(weights: Reals, vertices: Reals, faces: Integers) -> Reals:
    """Returns weights [n, bones] of the vertices [n, 3], m, that are smoothed over the surface by `SMOOTH`."""
    ring = Ring(faces, len(vertices))
    edge = np.median(np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1))
    for _ in range(int(np.clip(round(4 * (SMOOTH / edge) ** 2), 6, 400))):
        weights = 0.5 * (weights + ring.mean(weights))
    return weights


def _rotated(rotations: Reals) -> Reals:
    """Returns the unit quaternions [..., 4] (w, x, y, z) of rotation matrices [..., 3, 3]."""
    m = rotations
    w = np.sqrt(np.maximum(0, 1 + m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2])) / 2
    x = np.sqrt(np.maximum(0, 1 + m[..., 0, 0] - m[..., 1, 1] - m[..., 2, 2])) / 2
    y = np.sqrt(np.maximum(0, 1 - m[..., 0, 0] + m[..., 1, 1] - m[..., 2, 2])) / 2
    z = np.sqrt(np.maximum(0, 1 - m[..., 0, 0] - m[..., 1, 1] + m[..., 2, 2])) / 2
    q = np.stack(
        [
            w,
            np.copysign(x, m[..., 2, 1] - m[..., 1, 2]),
            np.copysign(y, m[..., 0, 2] - m[..., 2, 0]),
            np.copysign(z, m[..., 1, 0] - m[..., 0, 1]),
        ],
        axis=-1,
    )
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def _product(a: Reals, b: Reals) -> Reals:
    """Returns the products [..., 4] of quaternions."""
    scalar = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(axis=-1, keepdims=True)
    return np.concatenate(
        [scalar, a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])], -1
    )


def skinned(vertices: Reals, weights: Reals, rotations: Reals, translations: Reals) -> Reals:
    """Returns vertices [n, 3] that follow bones, by dual quaternions (Kavan, Collins, Zara and O'Sullivan 2008).

    Args:
        vertices: Vertices in the bind pose [n, 3], m.
        weights: Weights of the bones [n, bones].
        rotations: Rotation matrices of the bones [bones, 3, 3], from the bind pose.
        translations: Translations [bones, 3], m: a bone moves x to R x + t.
    """
    real = _rotated(rotations)
    for bone, parent in enumerate(PARENTS):  # of the two quaternions of a rotation the one on the parent's side
        if parent >= 0 and real[bone] @ real[parent] < 0:
            real[bone] = -real[bone]
    dual = 0.5 * _product(np.concatenate([np.zeros((len(real), 1)), translations], axis=1), real)
    blended, moved = weights @ real, weights @ dual
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    blended, moved = blended / length, moved / length
    w, v = blended[:, :1], blended[:, 1:]
    turned = vertices + 2 * np.cross(v, np.cross(v, vertices) + w * vertices)
    return turned + 2 * (w * moved[:, 1:] - moved[:, :1] * v + np.cross(v, moved[:, 1:]))
