# SPDX-License-Identifier: Apache-2.0
"""Geometry queries on arrays: continuous collision, distances, intersections.

A row of a [n, 4, 3] array is four points: a vertex then the three of a face, or the two ends of one edge then of another.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Union, overload

import numpy as np

from . import _core
from .arrays import integers, number, reals
from .errors import ArrayError, MeshError
from .types import ArrayLike, Booleans, Integers, PathLike, Reals

__all__ = [
    "vertex_face_ccd",
    "edge_edge_ccd",
    "vertex_face_distance",
    "edge_edge_distance",
    "intersections",
    "ObjectIntersections",
    "UntangleReport",
]


@dataclass
class ObjectIntersections:
    """Edges of one object through faces of another, or of itself, at the start of a scene. Objects: cloths, then obstacles."""

    first: int  #: object number
    second: int  #: object number, not below `first`
    first_name: str  #: "cloth 'shirt'"
    second_name: str
    edge_object: Integers = field(repr=False)  #: [k] int32, object that the edge belongs to
    edge: Integers = field(repr=False)  #: [k, 2] int32, vertices in that object's numbering
    face_object: Integers = field(repr=False)  #: [k] int32
    face: Integers = field(repr=False)  #: [k] int32, in that object's numbering
    place: Reals = field(repr=False)  #: [k, 3] float64, where the edge meets the face, m

    @property
    def count(self) -> int:
        """Number of edge-face pairs."""
        return len(self.face)

    @property
    def mean(self) -> Reals:
        """[3] mean place, m."""
        return np.asarray(self.place.mean(axis=0))

    @property
    def bounds(self) -> Reals:
        """[2, 3] lower and upper corner of the places, m."""
        return np.stack([self.place.min(axis=0), self.place.max(axis=0)])


@dataclass
class UntangleReport:
    """What untangling did to a start."""

    clean: bool  #: nothing intersects, and every gap around what was moved is positive
    before: int  #: intersections
    after: int
    rounds: int
    moved: int  #: cloth vertices moved; all others keep every bit
    largest_move: float  #: m
    smallest_gap: float  #: around what was moved, m; at most the gap aimed at; 0 if not clean


def _start_intersections(core: _core.Scene) -> list[ObjectIntersections]:
    return [
        ObjectIntersections(
            first, second, first_name, second_name, rows[:, 0], rows[:, 1:3], rows[:, 3], rows[:, 4], place
        )
        for first, second, first_name, second_name, rows, place in _core.start_intersections(core)
    ]


def _save_intersections(path: PathLike, core: _core.Scene) -> None:
    _core.save_intersections(Path(path), core)


_CCD = {
    "vertex_face_ccd": (_core.vertex_face_ccd, _core.vertex_face_ccd_cubic),
    "edge_edge_ccd": (_core.edge_edge_ccd, _core.edge_edge_ccd_cubic),
}


def _ccd(name: str, start: ArrayLike, end: ArrayLike, minimum_distance: float, method: str) -> tuple[Booleans, Reals]:
    additive, cubic = _CCD[name]
    start = reals(f"{name}: start", start, (None, 4, 3))
    end = reals(f"{name}: end", end, (None, 4, 3))
    if len(start) != len(end):
        raise ArrayError(f"{name}: start has {len(start)} rows, end has {len(end)}")
    minimum_distance = number(f"{name}: minimum_distance", minimum_distance)
    if minimum_distance < 0:
        raise ArrayError(f"{name}: minimum_distance is negative: {minimum_distance}")
    if method == "additive":
        return additive(start, end, minimum_distance)
    if method == "cubic":
        if minimum_distance:
            raise ArrayError(f"{name}: minimum_distance: the cubic method knows only 0")
        return cubic(start, end)
    raise ArrayError(f"{name}: method: {method!r} is not one of additive, cubic")


def vertex_face_ccd(
    start: ArrayLike, end: ArrayLike, minimum_distance: float = 0.0, method: Literal["additive", "cubic"] = "additive"
) -> tuple[Booleans, Reals]:
    """Does a vertex meet a face while all four points move straight from `start` to `end`?

    start, end: [n, 4, 3] float64, m; row = vertex, face.  minimum_distance: m, meet means come this close.
    method: "additive" (time never late; at minimum_distance 0 decided in double-double where double cannot tell) or "cubic" (the paper's,
    with an error bound: what it cannot tell from contact is a hit; the root's time). Neither has false negatives. Source: docs/ccd.md.
    Returns hit [n] bool and time [n] float64 in [0, 1], 1 where there is no hit. Throws ArrayError.
    """
    return _ccd("vertex_face_ccd", start, end, minimum_distance, method)


def edge_edge_ccd(
    start: ArrayLike, end: ArrayLike, minimum_distance: float = 0.0, method: Literal["additive", "cubic"] = "additive"
) -> tuple[Booleans, Reals]:
    """Do two edges meet? As `vertex_face_ccd`; row = two ends of one edge, two of the other."""
    return _ccd("edge_edge_ccd", start, end, minimum_distance, method)


@overload
def vertex_face_distance(points: ArrayLike, return_weights: Literal[False] = False) -> Reals: ...
@overload
def vertex_face_distance(points: ArrayLike, return_weights: Literal[True]) -> tuple[Reals, Reals]: ...
def vertex_face_distance(points: ArrayLike, return_weights: bool = False) -> Union[Reals, tuple[Reals, Reals]]:
    """Distance [n] in m between vertex and face of [n, 4, 3] rows.

    With `return_weights` also [n, 4]: sum over k of weight_k x_k is the difference vector. Throws ArrayError.
    """
    result = _core.vertex_face_distance(reals("vertex_face_distance: points", points, (None, 4, 3)))
    return result if return_weights else result[0]


@overload
def edge_edge_distance(points: ArrayLike, return_weights: Literal[False] = False) -> Reals: ...
@overload
def edge_edge_distance(points: ArrayLike, return_weights: Literal[True]) -> tuple[Reals, Reals]: ...
def edge_edge_distance(points: ArrayLike, return_weights: bool = False) -> Union[Reals, tuple[Reals, Reals]]:
    """Distance [n] in m between two edges of [n, 4, 3] rows; as `vertex_face_distance`."""
    result = _core.edge_edge_distance(reals("edge_edge_distance: points", points, (None, 4, 3)))
    return result if return_weights else result[0]


def intersections(vertices: ArrayLike, faces: ArrayLike, first_obstacle_vertex: int = -1) -> Integers:
    """Edges that pass through faces, by exact predicates; edges that share a vertex with the face do not count.

    vertices: [n, 3] float64, m.  faces: [m, 3] integers.  first_obstacle_vertex: this vertex and all later ones belong to
    obstacles, whose pairs among themselves are left out; -1: none do.
    Returns [k, 3] int32: the edge's two vertices and the face's index. Throws ArrayError, MeshError.
    """
    vertices = reals("intersections: vertices", vertices, (None, 3))
    faces = integers("intersections: faces", faces, (None, 3))
    outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if outside.any():
        row = int(outside.argmax())
        raise MeshError(f"intersections: face {row} is {faces[row].tolist()}, outside 0 to {len(vertices) - 1}")
    return _core.intersections(vertices, faces, int(first_obstacle_vertex))
