# SPDX-License-Identifier: Apache-2.0
"""USD: a Mesh prim for each object with time samples of its points, materials bound by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._core import __version__
from ...types import Reals
from ..usd_reader import usd_error
from .series import Piece, Series, identifier_of

if TYPE_CHECKING:
    from pxr import Usd

SAVE_AFTER = 256 << 20  # bytes of points; what is saved leaves the memory


def write(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes NAME.usdc to a folder; frame n of the export is time code n."""
    from pxr import Tf

    try:
        _write(series, folder / f"{series.name}.usdc", tick)
    except Tf.ErrorException as problem:
        raise OSError(usd_error(problem)) from None


def _write(series: Series, file: Path, tick: Callable[[], None]) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, series.unit)
    stage.SetTimeCodesPerSecond(series.fps)
    stage.SetFramesPerSecond(series.fps)
    codes = time_codes(series)
    stage.SetStartTimeCode(codes[0])
    stage.SetEndTimeCode(codes[-1])
    stage.GetRootLayer().customLayerData = {"creator": f"cama {__version__}", "scene": series.scene}
    root = UsdGeom.Xform.Define(stage, f"/{series.name}")
    stage.SetDefaultPrim(root.GetPrim())
    materials = _materials(stage, series)
    meshes = [_mesh(stage, root.GetPath().AppendChild(piece.identifier), piece, materials) for piece in series.pieces]
    moves, unsaved = series.moves(), 0
    for index, frame in series.frames():
        for mesh, moving, positions in zip(meshes, moves, frame):
            if moving or index == 0:
                unsaved += _set_points(mesh, positions, codes[index] if moving else None)
        if unsaved > SAVE_AFTER:
            stage.GetRootLayer().Save()
            unsaved = 0
        tick()
    stage.GetRootLayer().Save()


def time_codes(series: Series) -> list[float]:
    """Returns the time codes of the frames, whole numbers where frames are equally spaced."""
    codes = series.times * series.fps
    near = np.round(codes)
    return [float(c) for c in np.where(np.abs(codes - near) < 1e-4, near, codes)]


def _materials(stage: Usd.Stage, series: Series) -> dict[str, Any]:
    """Defines a preview material for each material of cloth; returns them by name."""
    from pxr import Gf, Sdf, UsdShade

    result: dict[str, Any] = {}
    taken = {piece.identifier.lower() for piece in series.pieces}
    scope = "materials"
    while scope in taken:
        scope += "_"
    names: set[str] = set()
    for name, color in series.materials.items():
        path = Sdf.Path(f"/{series.name}/{scope}").AppendChild(identifier_of(name, names))
        material = UsdShade.Material.Define(stage, path)
        material.GetPrim().SetDisplayName(name)
        shader = UsdShade.Shader.Define(stage, path.AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        result[name] = material
    return result


def _mesh(stage: Usd.Stage, path: Any, piece: Piece, materials: dict[str, Any]) -> Any:
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.GetPrim().SetDisplayName(piece.name)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(piece.is_cloth)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(piece.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(piece.faces.astype(np.int32).ravel()))
    mesh.CreateDisplayColorAttr([Gf.Vec3f(*piece.color)])
    if piece.uv is not None and piece.uv_faces is not None:
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        st.Set(Vt.Vec2fArray.FromNumpy(piece.uv.astype(np.float32)))
        st.SetIndices(Vt.IntArray.FromNumpy(piece.uv_faces.astype(np.int32).ravel()))
    if piece.material in materials:
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(materials[piece.material])
    return mesh


def _set_points(mesh: Any, positions: Reals, code: float | None) -> int:
    """Sets points and extent at a time code, None: at all times; returns the number of bytes."""
    from pxr import Usd, Vt

    when = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(positions, np.float32))
    mesh.CreatePointsAttr().Set(points, when)
    mesh.CreateExtentAttr().Set(mesh.ComputeExtent(points), when)
    return 12 * len(positions)
