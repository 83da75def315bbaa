# SPDX-License-Identifier: Apache-2.0
"""Reads the meshes of a USD file, with their animation, as arrays."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import FileError, MeshError
from ..hints import require
from ..types import Integers, PathLike, Reals

if TYPE_CHECKING:
    from pxr import Usd

EXTENSIONS = {".usd", ".usda", ".usdc", ".usdz"}
LARGEST = 4 << 30  # bytes of an animation
Y_UP_TO_Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)


def usd_error(problem: Exception) -> str:
    """Returns what the first error of USD says, without the place in its sources."""
    lines = str(problem).strip().splitlines() or [type(problem).__name__]
    said = re.search(r" : '(.*)'$", lines[0])
    return said[1] if said else lines[0].strip()


def is_usd(file: object) -> bool:
    """Whether a file has one of USD's extensions."""
    return isinstance(file, (str, os.PathLike)) and Path(file).suffix.lower() in EXTENSIONS


@dataclass
class UsdMesh:
    """All meshes of a USD file as one, in m, with z up."""

    vertices: Reals  #: [n, 3], at the first time
    faces: Integers  #: [m, 3]
    texture: Reals | None  #: texture coordinates [k, 2]; None: not read, or not on all meshes
    texture_faces: Integers | None  #: [m, 3], into `texture`
    times: Reals  #: [t] s from the first time sample; [0] of a file without animation
    positions: Reals  #: [t, n, 3]

    def rest_texture(self, what: str) -> tuple[Reals, Integers]:
        """Returns texture coordinates and their triangles for a rest shape. Raises MeshError if there are none."""
        if self.texture is None or self.texture_faces is None:
            raise MeshError(
                f'{what}: has no texture coordinates, or not on all of its meshes, which rest "uv" takes as the rest '
                "shape; unwrap it in the program that made it, or leave rest out, and the start is the rest shape"
            )
        return self.texture, self.texture_faces


def read_usd(file: PathLike, animated: bool = False, textured: bool = False) -> UsdMesh:
    """Reads the visible meshes of a USD file; polygons become fans of triangles around their first corner.

    Unit and up axis of the stage, and the transforms of prims, are applied. Subdivision surfaces are their control
    meshes.

    Args:
        file: The file.
        animated: Whether to read all time samples, with skeletons; False: the first, in the bind pose.
        textured: Whether to read texture coordinates: the primvar st, or the first that has two numbers.

    Raises:
        FileError: The file cannot be opened, or holds no mesh.
        MeshError: A mesh is broken, or moves in a way that is not read; the text names its prim.
        BackendError: usd-core is not installed.
    """
    require(f"reading {file}", "pxr")
    from pxr import Tf, Usd

    if not Path(file).is_file():
        raise FileError(f"{file}: no such file")
    try:
        stage = Usd.Stage.Open(str(file))
    except Tf.ErrorException as problem:
        raise FileError(f"{file}: cannot be read: {usd_error(problem)}") from None
    if animated:
        _pose(stage, str(file))
    meshes = list(_meshes(stage))
    if not meshes:
        raise FileError(f"{file}: no visible mesh in the file")
    pieces = [_Prim(str(file), mesh) for mesh in meshes]
    codes = sorted({code for piece in pieces for code in piece.codes})
    codes = (codes if animated else codes[:1]) or [None]
    if 24 * len(codes) * sum(piece.count for piece in pieces) > LARGEST:
        raise MeshError(f"{file}: its {len(codes)} time samples take more than 4 GiB; keep fewer of them")
    positions = np.array([np.concatenate([piece.positions(code) for piece in pieces]) for code in codes])
    positions *= _metres(stage)
    if _y_is_up(stage):
        positions = positions @ Y_UP_TO_Z_UP.T
    firsts = np.cumsum([0] + [piece.count for piece in pieces])
    faces = np.concatenate([piece.faces + first for piece, first in zip(pieces, firsts)]).astype(np.int32)
    texture, texture_faces = _texture(pieces) if textured else (None, None)
    times = np.array([0.0 if code is None else code - codes[0] for code in codes]) / stage.GetTimeCodesPerSecond()
    return UsdMesh(positions[0], faces, texture, texture_faces, times, positions)


def _meshes(stage: Usd.Stage) -> Iterator[Any]:
    """Iterates over the visible meshes of a stage, those of instances too; not over what is a guide or a proxy."""
    from pxr import Usd, UsdGeom

    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        mesh = UsdGeom.Mesh(prim)
        if not mesh or mesh.ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            continue
        if mesh.ComputeVisibility(Usd.TimeCode.EarliestTime()) != UsdGeom.Tokens.invisible:
            yield mesh


def _pose(stage: Usd.Stage, file: str) -> None:
    """Gives meshes that skeletons move time samples of their points, at those of the skeletons; files stay as they are.

    Raises:
        MeshError: A skeleton's mesh is part of an instance, which cannot have samples of its own.
    """
    from pxr import Usd, UsdSkel

    skinned = [
        prim
        for prim in stage.Traverse(Usd.TraverseInstanceProxies())
        if prim.HasAPI(UsdSkel.BindingAPI) and UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
    ]
    for prim in skinned:
        if prim.IsInstanceProxy():
            raise MeshError(
                f"{file}: {prim.GetPath()}: is moved by a skeleton and part of an instance, which is not read; make "
                'the instance a prim of its own, or give clip="bind" to leave the motion out'
            )
    stage.SetEditTarget(stage.GetSessionLayer())
    if skinned and not UsdSkel.BakeSkinning(stage.Traverse()):
        raise MeshError(f"{file}: the motion of its skeletons cannot be computed; bake it to points")


def _metres(stage: Usd.Stage) -> float:
    from pxr import UsdGeom

    return float(UsdGeom.GetStageMetersPerUnit(stage))


def _y_is_up(stage: Usd.Stage) -> bool:
    from pxr import UsdGeom

    return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y)


class _Prim:
    """One mesh of a stage: `faces` [m, 3], `count` of vertices, `codes` of its time samples."""

    def __init__(self, file: str, mesh: Any) -> None:
        from pxr import Usd, UsdGeom

        self._mesh, self._what = mesh, f"{file}: {mesh.GetPath()}"
        self._refuse_what_is_not_read()
        first = Usd.TimeCode.EarliestTime()
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get(first) or [], np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(first) or [], np.int64)
        self.count = len(mesh.GetPointsAttr().Get(first) or [])
        if not len(counts) or not self.count:
            raise MeshError(f"{self._what}: has no faces")
        if counts.min() < 3:
            face = int(np.argmin(counts))
            raise MeshError(f"{self._what}: face {face} has {counts[face]} corners, needs at least 3")
        if counts.sum() != len(corners):
            raise MeshError(
                f"{self._what}: its faces have {counts.sum()} corners, and there are {len(corners)} indices"
            )
        outside = np.flatnonzero((corners < 0) | (corners >= self.count))
        if len(outside):
            raise MeshError(
                f"{self._what}: uses vertex {corners[outside[0]]}, but has {self.count} vertices, from 0 on"
            )
        self._fan = _fans(counts, np.array(mesh.GetHoleIndicesAttr().Get(first) or [], np.int64))
        mirrored = np.linalg.det(np.array(mesh.ComputeLocalToWorldTransform(first))) < 0
        if (mesh.GetOrientationAttr().Get(first) == UsdGeom.Tokens.leftHanded) != mirrored:
            self._fan = self._fan[:, [0, 2, 1]]
        self._corner_count = len(corners)
        self._face_of = np.repeat(np.arange(len(counts)), counts)
        self._corners, self.faces = corners, corners[self._fan]
        self.codes = self._codes()
        if not len(self.faces):
            raise MeshError(f"{self._what}: all of its faces are holes")
        self._refuse_concave(counts)

    def _refuse_what_is_not_read(self) -> None:
        """Raises MeshError if the mesh changes in a way that its points do not say."""
        if self._mesh.GetFaceVertexIndicesAttr().GetNumTimeSamples() > 1:
            raise MeshError(f"{self._what}: its faces change in time; a mesh of a scene keeps its triangles")

    def _codes(self) -> list[float]:
        """Returns the time codes at which points or a transform above them have samples."""
        from pxr import UsdGeom

        codes = set(self._mesh.GetPointsAttr().GetTimeSamples())
        prim = self._mesh.GetPrim()
        while prim and not prim.IsPseudoRoot():
            if prim.IsA(UsdGeom.Xformable):
                codes.update(UsdGeom.Xformable(prim).GetTimeSamples())
            prim = prim.GetParent()
        return sorted(codes)

    def positions(self, code: float | None) -> Reals:
        """Returns positions [count, 3] at a time code, None: the first, in units and axes of the stage."""
        from pxr import Usd

        when = Usd.TimeCode.EarliestTime() if code is None else Usd.TimeCode(code)
        points = np.asarray(self._mesh.GetPointsAttr().Get(when), np.float64)
        if len(points) != self.count:
            raise MeshError(f"{self._what}: has {len(points)} points at time code {code:g}, {self.count} at the first")
        matrix = np.array(self._mesh.ComputeLocalToWorldTransform(when))  # of rows: x' = x M
        points = points @ matrix[:3, :3] + matrix[3, :3]
        if not np.isfinite(points).all():
            row = int(np.argwhere(~np.isfinite(points))[0][0])
            raise MeshError(f"{self._what}: vertex {row} is not finite: {points[row].tolist()}")
        return points

    def _refuse_concave(self, counts: Integers) -> None:
        """Raises MeshError for a polygon that its fan of triangles would fold over itself."""
        if counts.max() == 3:
            return
        points = self.positions(self.codes[0] if self.codes else None)[self.faces]
        normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        face = self._face_of[self._fan[:, 0]]
        whole = np.stack([np.bincount(face, normals[:, k], len(counts)) for k in range(3)], 1)[face]
        wrong = np.flatnonzero((normals * whole).sum(1) < -1e-9 * (whole * whole).sum(1))
        if len(wrong):
            raise MeshError(
                f"{self._what}: face {face[wrong[0]]} is a concave polygon, which a fan of triangles would fold over "
                "itself; split it into triangles"
            )

    def texture(self) -> tuple[Reals, Integers] | None:
        """Returns texture coordinates [k, 2] and their triangles [m, 3] of the primvar st, or the first of its kind."""
        from pxr import Usd, UsdGeom

        known = [p for p in UsdGeom.PrimvarsAPI(self._mesh).FindPrimvarsWithInheritance() if p.HasValue()]
        fitting = [p for p in known if str(p.GetTypeName()).startswith(("texCoord2", "float2[", "double2[", "half2["))]
        fitting.sort(key=lambda p: p.GetPrimvarName() not in ("st", "UVMap", "map1"))
        for primvar in fitting:
            values = np.asarray(primvar.Get(Usd.TimeCode.EarliestTime()), np.float64).reshape(-1, 2)
            own = primvar.GetIndices(Usd.TimeCode.EarliestTime()) if primvar.IsIndexed() else None
            indices = np.arange(len(values)) if own is None else np.asarray(own, np.int64)
            places = {"faceVarying": np.arange(self._corner_count), "vertex": self._corners, "varying": self._corners}
            place = places.get(str(primvar.GetInterpolation()))
            if place is None:
                continue
            if place.max() >= len(indices) or indices.min() < 0 or indices.max() >= len(values):
                raise MeshError(
                    f"{self._what}: {primvar.GetName()}: does not have a value for each corner of the faces"
                )
            if not np.isfinite(values).all():
                raise MeshError(f"{self._what}: {primvar.GetName()}: has values that are not finite")
            return values, indices[place][self._fan]
        return None


def _fans(counts: Integers, holes: Integers) -> Integers:
    """Returns triangles [m, 3] of corners, counted through all faces, of polygons with these numbers of corners."""
    first = np.cumsum(counts) - counts
    kept = np.ones(len(counts), bool)
    kept[holes] = False
    triangles = np.where(kept, counts - 2, 0)
    start = np.repeat(first, triangles)
    step = np.arange(len(start)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([start, start + step + 1, start + step + 2], 1)


def _texture(pieces: list[_Prim]) -> tuple[Reals | None, Integers | None]:
    """Returns the texture coordinates of all meshes together; (None, None) if one has none."""
    own = [piece.texture() for piece in pieces]
    if any(texture is None for texture in own):
        return None, None
    firsts = np.cumsum([0] + [len(values) for values, _ in own])
    values = np.concatenate([values for values, _ in own])
    return values, np.concatenate([faces + first for (_, faces), first in zip(own, firsts)]).astype(np.int32)
