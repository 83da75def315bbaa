# SPDX-License-Identifier: Apache-2.0
"""Garments with sleeves and legs around the generated body as it stands at the start: `Coat`, `Trousers`.

A garment is the surface at a distance from the body, cut at its openings. Each of its triangles is laid flat by itself
for the rest state, so that the garment fits as it is worn, without a pattern.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from . import collision
from .arrays import number
from .body import HEIGHT, body_field
from .errors import MeshError, SceneError
from .hints import require
from .isosurface import decimated, outward, polygonise, projected
from .posing import JOINTS
from .types import Integers, Reals

__all__ = ["Coat", "Trousers", "Garment", "GARMENTS"]

ARM = 0.515  # m, from the shoulder to the wrist
LEAST = 900  # triangles; with fewer a sleeve would not be round
ROUNDS, FEW_ROUNDS = 5, 2  # of evening out the triangles and the rims after the cut; few where they are decimated
OUTSIDE = 1e9
TRIAL = 0.025  # m, grid of the garment whose triangles are counted first
CORNERS = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])


def _blend(first: Reals, second: Reals, width: float) -> Reals:
    """Returns the smooth minimum of two distances (Quilez's polynomial, quadratic)."""
    part = np.maximum(width - np.abs(first - second), 0) / width
    return np.minimum(first, second) - 0.25 * width * part**2


def _along_arm(x: Reals, side: float) -> Reals:
    """Returns how far points [n, 3] are along an arm: 0 at the shoulder, 1 at the wrist."""
    end = "_left" if side > 0 else "_right"
    way = JOINTS["hand" + end] - JOINTS["arm" + end]
    return (x - JOINTS["arm" + end]) @ way / (way @ way)


@dataclass(frozen=True)
class _Garment:
    """What the garments share; lengths are for a body of 1.7 m and grow with `height`."""

    height: float = HEIGHT  #: of the body, m
    finest: ClassVar[int]
    names: ClassVar[tuple[str, ...]]
    box: ClassVar[tuple[Reals, Reals]]

    def check(self) -> None:
        """Raises SceneError, ArrayError if a length is no positive number."""
        for field in fields(self):
            value = number(f"{field.name}", getattr(self, field.name))
            if not value > 0 and field.name not in ("flare", "cuff", "slit"):
                raise SceneError(f"{field.name}: must be greater than 0, got {value:g}")
            if value < 0:
                raise SceneError(f"{field.name}: must not be negative, got {value:g}")

    def distance(self, x: Reals) -> Reals:
        """Returns the distances [n] of points [n, 3] from the closed surface that is cut, m."""
        raise NotImplementedError

    def gradient(self, x: Reals) -> Reals:
        """Returns the gradients [n, 3] of the distance, from differences along the corners of a tetrahedron."""
        return sum(corner * self.distance(x + 1e-4 * corner)[:, None] for corner in CORNERS) / 4e-4

    def openings(self, x: Reals) -> Reals:
        """Returns what is cut [openings, n]: each is positive where the cloth stays, m."""
        raise NotImplementedError


@dataclass(frozen=True)
class Coat(_Garment):
    """A top with sleeves: a shirt, a jacket, a coat or a robe. Its openings are collar, hem, left cuff, right cuff."""

    hem: float = 0.8  #: height of the hem, m
    clearance: float = 0.02  #: from the body, m
    sleeve: float = 0.92  #: length of the sleeves, 1 reaches the wrist
    cuff: float = 0.02  #: how much wider the sleeves are at their ends, m
    hip: float = 0.95  #: height below which it does not follow the body and flares, m
    flare: float = 0.15  #: how much the radius grows below the hip, per m
    collar: float = 0.11  #: radius of the collar, m
    slit: float = 0.0  #: height below which the front is open, m; 0: closed

    def _parts(self, x: Reals) -> Reals:
        """Returns the distances [4, n] of trunk, left sleeve, right sleeve and skirt."""
        body = body_field()
        trunk = body.trunk(x) - self.clearance
        sleeves = []
        for side in (1.0, -1.0):
            along = np.clip(_along_arm(x, side), 0, 1)
            sleeves.append(body.arm(x, side) - self.clearance - self.cuff * along**1.5)
        below = np.maximum(self.hip - x[:, 2], 0)
        wider = self.clearance + self.flare * below
        scaled = np.hypot(x[:, 0] / (0.165 + wider), (x[:, 1] - 0.006) / (0.118 + wider))
        skirt = np.maximum((scaled - 1) * (0.118 + wider), x[:, 2] - self.hip)
        return np.stack([trunk, *sleeves, skirt])

    def distance(self, x: Reals) -> Reals:
        trunk, left, right, skirt = self._parts(x)
        return _blend(_blend(_blend(trunk, left, 0.03), right, 0.03), skirt, 0.06)

    def openings(self, x: Reals) -> Reals:
        trunk, left, right, skirt = self._parts(x)
        neck = np.linalg.norm(x - [0, 0.0, 1.5], axis=1) - self.collar
        rest = np.minimum(trunk, skirt)
        cuffs = []
        for own, other, side in ((left, right, 1.0), (right, left, -1.0)):
            along = _along_arm(x, side)
            beyond = (own < rest) & (own < other) & (along > 0.3)
            cuffs.append(np.where(beyond, ARM * (self.sleeve - along), OUTSIDE))
        front = np.full(len(x), OUTSIDE)
        if self.slit:
            below = self.slit - x[:, 2]
            at_front = (x[:, 1] < -0.02) & (below > -0.05)
            front = np.where(at_front, np.abs(x[:, 0]) - 0.2 * below, OUTSIDE)
        return np.stack([neck, x[:, 2] - self.hem, *cuffs, front])

    finest = 2_000  # triangles; a coarser grid would lose the sleeves: such meshes are decimated ones
    names = ("collar", "hem", "left cuff", "right cuff", "front")
    box = (np.array([-0.85, -0.9, -0.2]), np.array([0.85, 0.9, 1.75]))


@dataclass(frozen=True)
class Trousers(_Garment):
    """Trousers. Their openings are waist, left cuff and right cuff."""

    waist: float = 1.05  #: height of the waist, m
    hem: float = 0.12  #: height of the ends of the legs, m
    clearance: float = 0.01  #: from the body, m
    cuff: float = 0.03  #: how much wider the legs are at their ends, m

    def distance(self, x: Reals) -> Reals:
        body = body_field()
        down = np.clip((0.9 - x[:, 2]) / 0.8, 0, 1)
        distance = body.trunk(x) - self.clearance
        for side in (1.0, -1.0):
            distance = _blend(distance, body.leg(x, side) - self.clearance - self.cuff * down, 0.04)
        between = np.minimum(0.008 - np.abs(x[:, 0]), 0.765 - x[:, 2])
        return -_blend(-distance, -between, 0.008)

    def openings(self, x: Reals) -> Reals:
        ends = x[:, 2] - self.hem
        return np.stack(
            [self.waist - x[:, 2], np.where(x[:, 0] > 0, ends, OUTSIDE), np.where(x[:, 0] > 0, OUTSIDE, ends)]
        )

    finest = 16_000  # triangles; a coarser grid would lose the gap between the legs: such meshes are decimated ones
    names = ("waist", "left cuff", "right cuff")
    box = (np.array([-0.35, -0.35, -0.15]), np.array([0.35, 0.35, 1.75]))


GARMENTS: dict[str, type[_Garment]] = {"coat": Coat, "trousers": Trousers}


@dataclass(frozen=True)
class Garment:
    """A cut garment."""

    vertices: Reals  #: [n, 3] m
    faces: Integers  #: [m, 3], with outward normals
    material_vertices: Reals  #: [3 m, 2] m, of each triangle for itself: u to the right, v up
    material_faces: Integers  #: [m, 3]
    rims: dict[str, Integers]  #: vertices of each opening

    @property
    def area(self) -> float:
        """Area, m^2."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _boundary(faces: Integers) -> Integers:
    """Returns the edges [k, 2] that belong to one triangle."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[count == 1]]


def _largest(faces: Integers, count: int) -> Integers:
    """Returns the triangles of the largest connected part."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    part = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count)))[1]
    of_face = part[faces[:, 0]]
    return faces[of_face == np.bincount(of_face).argmax()]


def _without_ears(faces: Integers) -> Integers:
    """Returns the triangles without those that hang on one edge, and without those at pinched vertices."""
    while True:
        rim = _boundary(faces)
        on_rim = {(min(a, b), max(a, b)) for a, b in rim.tolist()}
        edges = [[(min(f[i], f[(i + 1) % 3]), max(f[i], f[(i + 1) % 3])) for i in range(3)] for f in faces.tolist()]
        ears = np.array([sum(edge in on_rim for edge in own) > 1 for own in edges])
        at, times = np.unique(rim, return_counts=True)
        pinched = np.isin(faces, at[times > 2]).any(axis=1)
        bad = ears | pinched
        if not bad.any():
            return faces
        faces = faces[~bad]


class _Neighbours:
    """Means over the neighbours of vertices of an open mesh; a vertex on a rim has those on the rim alone."""

    def __init__(self, faces: Integers, count: int) -> None:
        from scipy.sparse import coo_matrix, diags

        rim = _boundary(faces)
        self.on_rim = np.zeros(count, bool)
        self.on_rim[rim] = True
        pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        pairs = np.concatenate([pairs[~self.on_rim[pairs[:, 0]]], rim, rim[:, ::-1]])
        joined = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
        joined.data[:] = 1
        self.matrix = diags(1 / np.asarray(joined.sum(axis=1)).ravel()) @ joined

    def mean(self, x: Reals) -> Reals:
        return np.asarray(self.matrix @ x)


def _onto_rims(shape: _Garment, vertices: Reals, rim: Integers, opening: Integers) -> None:
    """Moves vertices on rims, in place, to where their opening cuts the surface."""
    step = 1e-4
    rows = np.arange(len(rim))
    for _ in range(2):
        x = vertices[rim]
        value = shape.openings(x)[opening, rows]
        slopes = []
        for axis in np.eye(3):
            up, down = (shape.openings(x + s * step * axis)[opening, rows] for s in (1, -1))
            slopes.append(np.where(np.maximum(np.abs(up), np.abs(down)) < 1, up - down, 0) / (2 * step))
        slope = np.stack(slopes, axis=1)
        normal = shape.gradient(x)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        slope -= np.einsum("ij,ij->i", slope, normal)[:, None] * normal
        square = np.maximum((slope**2).sum(axis=1), 0.2)
        move = np.where(np.abs(value) < 1, value / square, 0)[:, None] * slope
        vertices[rim] = projected(shape, x - move)


def _cut(shape: _Garment, vertices: Reals, faces: Integers) -> tuple[Reals, Integers]:
    centre = vertices[faces].mean(axis=1)
    faces = faces[shape.openings(centre).min(axis=0) > 0]
    if len(faces) < 20:
        raise MeshError("hem: the openings leave nothing of the garment")
    faces = _without_ears(_largest(faces, len(vertices)))
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3).astype(np.int32)


@functools.lru_cache(maxsize=32)
def _standard(shape: _Garment, triangles: int) -> Garment:
    """Makes a garment for a body of 1.7 m, with more triangles than asked for where fewer would cross each other."""
    wanted = max(triangles, LEAST)
    for _ in range(8):
        made = _made(shape, wanted)
        if not len(collision.intersections(made.vertices, made.faces)):
            return made
        wanted = round(1.2 * wanted)
    raise MeshError(
        f"clearance: the garment crosses itself with {triangles:,} to {wanted:,} triangles; change its lengths"
    )


def _made(shape: _Garment, wanted: int) -> Garment:
    closed, kept, count = _area(shape)
    cell = TRIAL * math.sqrt(count / max(wanted, shape.finest))
    whole, all_faces = polygonise(shape, *shape.box, cell)
    all_faces = outward(whole, all_faces)
    vertices, faces = _cut(shape, whole, all_faces)
    target = wanted * closed / kept
    for _ in range(8):  # curved places keep more than their share
        if wanted >= shape.finest or abs(len(faces) - wanted) < 0.07 * wanted:
            break
        vertices, faces = _cut(shape, *decimated(whole, all_faces, round(target)))
        target *= wanted / len(faces)
    near = _Neighbours(faces, len(vertices))
    rim = np.flatnonzero(near.on_rim)
    opening = np.abs(shape.openings(vertices[rim])).argmin(axis=0)
    for _ in range(ROUNDS if wanted >= shape.finest else FEW_ROUNDS):
        _onto_rims(shape, vertices, rim, opening)
        for _ in range(2):
            vertices = 0.4 * vertices + 0.6 * near.mean(vertices)
        vertices = projected(shape, vertices)
    _onto_rims(shape, vertices, rim, opening)
    rims = {name: rim[opening == k].astype(np.int32) for k, name in enumerate(shape.names) if (opening == k).any()}
    return Garment(vertices, faces, *_flat(vertices, faces), rims)


@functools.lru_cache(maxsize=32)
def _area(shape: _Garment) -> tuple[float, float, int]:
    """Returns the areas of the closed surface and of the garment, m^2, and the triangles of the latter by `TRIAL`."""

    def area(x: Reals, f: Integers) -> float:
        a, b, c = (x[f[:, k]] for k in range(3))
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    vertices, faces = polygonise(shape, *shape.box, TRIAL)
    cut = _cut(shape, vertices, faces)
    return area(vertices, faces), area(*cut), len(cut[1])


def _flat(vertices: Reals, faces: Integers) -> tuple[Reals, Integers]:
    """Returns every triangle laid flat by itself, its v along what is upward in it."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    upward = np.array([0.0, 0.0, 1.0]) - normal[:, 2:] * normal
    level = np.linalg.norm(upward, axis=1) < 1e-3
    upward[level] = np.cross(normal[level], [1.0, 0, 0])
    upward /= np.linalg.norm(upward, axis=1, keepdims=True)
    across = np.cross(upward, normal)
    flat = np.stack(
        [np.stack([np.einsum("ij,ij->i", x - a, axis) for axis in (across, upward)], axis=1) for x in (a, b, c)], axis=1
    )
    return flat.reshape(-1, 2), np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)


def make(kind: str, given: dict[str, Any], triangles: int) -> Garment:
    """Returns a garment with about as many triangles as asked for, at least `LEAST`.

    Args:
        kind: A name in `GARMENTS`.
        given: Its fields.
        triangles: Number of triangles.

    Raises:
        SceneError, ArrayError, MeshError: A field does not fit.
        BackendError: VTK or SciPy is not installed.
    """
    shape = shaped(kind, given)
    made = _standard(type(shape)(**{**_fields(shape), "height": HEIGHT}), int(triangles))
    scale = shape.height / HEIGHT
    return Garment(scale * made.vertices, made.faces, scale * made.material_vertices, made.material_faces, made.rims)


def area(kind: str, given: dict[str, Any]) -> float:
    """Returns the area of a garment, m^2."""
    shape = shaped(kind, given)
    return (shape.height / HEIGHT) ** 2 * _area(type(shape)(**{**_fields(shape), "height": HEIGHT}))[1]


def shaped(kind: str, given: dict[str, Any]) -> _Garment:
    """Returns the shape of a garment; raises SceneError, ArrayError."""
    require("a garment with sleeves or legs", "scipy")
    shape = GARMENTS[kind](**given)
    shape.check()
    return shape


def _fields(shape: _Garment) -> dict[str, float]:
    return {field.name: getattr(shape, field.name) for field in fields(shape)}
