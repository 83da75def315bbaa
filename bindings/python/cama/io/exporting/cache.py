# SPDX-License-Identifier: Apache-2.0
"""PC2 and MDD, the formats of mesh caches: the positions of one mesh in every frame, without the mesh.

The mesh is an OBJ file of the first frame beside it, with the same vertices in the same order.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path

from ..._core import __version__
from .sequence import object_text, rows, write_materials
from .series import Series


def _write_start(series: Series, folder: Path) -> None:
    """Writes an OBJ file for each piece, and their materials."""
    write_materials(folder / f"{series.name}.mtl", series)
    for piece, positions in zip(series.pieces, series.frame(0)):
        with open(folder / f"{piece.identifier}.obj", "w", encoding="utf-8") as file:
            file.write(f"# cama {__version__}, {series.scene}, first frame, {series.up} up\n")
            file.write(f"mtllib {series.name}.mtl\n")
            file.write(f"o {piece.identifier}\n")
            file.write(rows("v %.9g %.9g %.9g\n", positions))
            file.write(object_text(piece, 0, 0))


def _write(
    series: Series,
    folder: Path,
    tick: Callable[[], None],
    extension: str,
    number: str,
    header: Callable[[int], bytes],
) -> None:
    """Writes a file for each piece: a header for its number of vertices, then all positions as numbers of a type."""
    _write_start(series, folder)
    with contextlib.ExitStack() as opened:
        files = [
            opened.enter_context(open(folder / f"{piece.identifier}.{extension}", "wb")) for piece in series.pieces
        ]
        for piece, file in zip(series.pieces, files):
            file.write(header(piece.vertex_count))
        for _, frame in series.frames():
            for file, positions in zip(files, frame):
                file.write(positions.astype(number).tobytes())
            tick()


def write_pc2(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes PIECE.pc2 and PIECE.obj for each piece to a folder; sample n is frame n."""

    def header(vertices: int) -> bytes:
        return struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices, 0.0, 1.0, len(series))

    _write(series, folder, tick, "pc2", "<f4", header)


def write_mdd(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes PIECE.mdd and PIECE.obj for each piece to a folder, with the times of the frames in s."""

    def header(vertices: int) -> bytes:
        return struct.pack(">ii", len(series), vertices) + series.times.astype(">f4").tobytes()

    _write(series, folder, tick, "mdd", ">f4", header)
