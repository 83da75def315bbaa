# SPDX-License-Identifier: Apache-2.0
"""VTK: a PolyData file (VTP) for each frame and a collection (PVD) that gives their times, as ParaView reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .series import Series


def write(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes NAME_0000.vtp, ... and NAME.pvd to a folder; positions are in double precision."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    mesh = _mesh(series)
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(mesh)
    names = []
    for index, frame in series.frames():
        mesh.GetPoints().SetData(numpy_to_vtk(np.concatenate(frame), deep=True))
        mesh.GetPoints().Modified()
        fields = {"TimeValue": series.times[index], **series.counts(index)}
        for name, value in fields.items():
            array = numpy_to_vtk(np.array([value]), deep=True)
            array.SetName(name)
            mesh.GetFieldData().AddArray(array)
        names.append(f"{series.name}_{index:04d}.vtp")
        writer.SetFileName(str(folder / names[-1]))
        if writer.Write() != 1:
            raise OSError(f"VTK could not write {names[-1]}")
        tick()
    lines = "".join(
        f'    <DataSet timestep="{float(time):.9g}" part="0" file="{name}"/>\n'
        for time, name in zip(series.times, names)
    )
    (folder / f"{series.name}.pvd").write_text(
        f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n{lines}'
        "  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )


def _mesh(series: Series) -> Any:
    """Returns a vtkPolyData of all pieces with what stays the same in all frames; its points are set later."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    mesh, cells = vtkPolyData(), vtkCellArray()
    firsts = np.cumsum([0] + [piece.vertex_count for piece in series.pieces])
    faces = np.concatenate([piece.faces + first for piece, first in zip(series.pieces, firsts)])
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, np.int64).ravel(), deep=True))
    mesh.SetPoints(vtkPoints())
    mesh.SetPolys(cells)
    counts = [len(piece.faces) for piece in series.pieces]
    _add(mesh.GetCellData(), "object", np.repeat(np.arange(len(counts), dtype=np.int32), counts))
    for name, texts in (
        ("objects", [piece.name for piece in series.pieces]),
        ("materials", [piece.material for piece in series.pieces]),
    ):
        array = vtkStringArray()
        array.SetName(name)
        for text in texts:
            array.InsertNextValue(text)
        mesh.GetFieldData().AddArray(array)
    _add_texture(mesh, series)
    return mesh


def _add(where: Any, name: str, values: Any) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    where.AddArray(array)
    return array


def _add_texture(mesh: Any, series: Series) -> None:
    """Adds texture coordinates: of points where every vertex has one, else of the three corners of each cell."""
    if not series.textured:
        return
    own = series.texture_of_vertices()
    if own is not None:
        mesh.GetPointData().SetTCoords(_add(mesh.GetPointData(), "texture_coordinates", own))
        return
    corners = [
        np.zeros((len(piece.faces), 6)) if piece.uv is None else piece.uv[piece.uv_faces].reshape(-1, 6)
        for piece in series.pieces
    ]
    _add(mesh.GetCellData(), "texture_coordinates", np.concatenate(corners))
