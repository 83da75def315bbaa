# SPDX-License-Identifier: Apache-2.0
"""OBJ and binary PLY: one file for each frame, with all objects in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..._core import __version__
from ...types import Integers, Reals
from .series import Piece, Series


def rows(line: str, values: Reals | Integers) -> str:
    """Returns a line for each row of values; `line` has a % for each column."""
    return (line * len(values)) % tuple(values.ravel().tolist())


def faces_text(piece: Piece, first_vertex: int, first_texture: int) -> str:
    """Returns the lines `f` of an object of an OBJ file, in which indices start at 1."""
    faces = piece.faces + first_vertex + 1
    if piece.uv_faces is None:
        return rows("f %d %d %d\n", faces)
    return rows("f %d/%d %d/%d %d/%d\n", np.stack([faces, piece.uv_faces + first_texture + 1], 2).reshape(-1, 6))


def object_text(piece: Piece, first_vertex: int, first_texture: int) -> str:
    """Returns all lines of an object but its vertices, which stay the same in all frames."""
    lines = "" if piece.uv is None else rows("vt %.9g %.9g\n", piece.uv)
    lines += f"usemtl {_material(piece)}\n"
    return lines + faces_text(piece, first_vertex, first_texture)


def write_materials(file: Path, series: Series) -> None:
    """Writes a file of materials (MTL) with the name and the colour of each."""
    colors = {_material(piece): piece.color for piece in series.pieces}
    text = "".join(
        f"newmtl {name}\nKd {red:.4f} {green:.4f} {blue:.4f}\n" for name, (red, green, blue) in colors.items()
    )
    file.write_text(text, encoding="utf-8")


def _material(piece: Piece) -> str:
    """Returns the name of a material for each piece: one without would get that of the piece before."""
    return _word(piece.material) or ("cloth" if piece.is_cloth else "obstacle")


def _word(name: str) -> str:
    """Returns a name without white space, where most readers end it."""
    return "_".join(name.split())


def write_obj(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes NAME_0000.obj, ... and NAME.mtl to a folder."""
    fixed, vertices, textures = [], 0, 0
    for piece in series.pieces:
        fixed.append(object_text(piece, vertices, textures))
        vertices += piece.vertex_count
        textures += 0 if piece.uv is None else len(piece.uv)
    write_materials(folder / f"{series.name}.mtl", series)
    for index, frame in series.frames():
        with open(folder / f"{series.name}_{index:04d}.obj", "w", encoding="utf-8") as file:
            file.write(f"# cama {__version__}, {series.scene}, {series.times[index]:.9g} s, {series.up} up\n")
            file.write(f"mtllib {series.name}.mtl\n")
            for piece, text, positions in zip(series.pieces, fixed, frame):
                file.write(f"o {_word(piece.name)}\n")
                file.write(rows("v %.9g %.9g %.9g\n", positions))
                file.write(text)
        tick()


def _ply_faces(series: Series, textured: bool) -> tuple[Any, str]:
    """Returns the records of all faces, with texture coordinates of their corners if asked for, and their header."""
    kind: list[Any] = [("count", "u1"), ("corners", "<i4", 3)]
    header = "property list uchar int vertex_indices\n"
    if textured:
        kind += [("values", "u1"), ("texture", "<f4", 6)]
        header += "property list uchar float texcoord\n"
    kind += [("object", "<i4")]
    header += "property int object\n"
    parts, vertices = [], 0
    for number, piece in enumerate(series.pieces):
        records = np.zeros(len(piece.faces), kind)
        records["count"], records["corners"], records["object"] = 3, piece.faces + vertices, number
        if textured:
            records["values"] = 6
        if textured and piece.uv is not None:
            records["texture"] = piece.uv[piece.uv_faces].reshape(-1, 6)
        parts.append(records)
        vertices += piece.vertex_count
    return np.concatenate(parts), header


def _comments(series: Series) -> str:
    """Returns a comment for each object: its number, its vertices, its name and its material."""
    lines, first = [], 0
    for number, piece in enumerate(series.pieces):
        made = f", {' '.join(piece.material.split())}" if piece.material else ""
        last = first + piece.vertex_count - 1
        lines.append(f"comment object {number}: {' '.join(piece.name.split())}{made}, vertices {first} to {last}\n")
        first += piece.vertex_count
    return "".join(lines)


def write_ply(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes NAME_0000.ply, ... to a folder: single precision, little-endian."""
    texture = series.texture_of_vertices() if series.textured else None
    faces, properties = _ply_faces(series, series.textured and texture is None)
    coordinates = "" if texture is None else "property float s\nproperty float t\n"
    records, comments = faces.tobytes(), _comments(series)
    for index, frame in series.frames():
        vertices = np.concatenate(frame) if texture is None else np.hstack([np.concatenate(frame), texture])
        header = (
            f"ply\nformat binary_little_endian 1.0\ncomment cama {__version__}, {series.times[index]:.9g} s, "
            f"{series.up} up\n{comments}element vertex {len(vertices)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"{coordinates}"
            f"element face {len(faces)}\n{properties}end_header\n"
        )
        with open(folder / f"{series.name}_{index:04d}.ply", "wb") as file:
            file.write(header.encode("utf-8") + vertices.astype("<f4").tobytes() + records)
        tick()
