# SPDX-License-Identifier: Apache-2.0
"""glTF: one binary file (GLB) whose frames are morph targets, which an animation blends one into the next.

Target n is the displacement of frame n from frame 0, in single precision. The file's meshes have z up as the recording
has; the node above them turns it, since y is up in glTF.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..._core import __version__
from ...errors import SceneError
from ...types import Reals
from .series import Series

FLOAT, UNSIGNED = 5126, 5125  # component types
ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963
LARGEST = 2**32 - 1  # bytes of a GLB
QUARTER_TURN = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # about x: z up becomes y up


class _Buffer:
    """The binary chunk and the accessors into it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.length = 0
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: Any, kind: str, bounds: bool = False, target: int | None = None) -> int:
        """Appends rows of float32 or uint32; returns the number of their accessor."""
        values = np.ascontiguousarray(values)
        self._file.write(values.tobytes())
        view = {"buffer": 0, "byteOffset": self.length, "byteLength": values.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": FLOAT if values.dtype == np.float32 else UNSIGNED,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor.update(min=rows.min(axis=0).tolist(), max=rows.max(axis=0).tolist())
        self.accessors.append(accessor)
        self.length += values.nbytes
        return len(self.accessors) - 1


def write(series: Series, folder: Path, tick: Callable[[], None]) -> None:
    """Writes NAME.glb to a folder."""
    splits, moves = [piece.split() for piece in series.pieces], series.moves()
    _check_size(series, [len(old) for old, _, _ in splits], moves)
    chunk = folder / f"{series.name}.bin"
    with open(chunk, "wb") as file:
        buffer = _Buffer(file)
        meshes, moving = _meshes(series, splits, moves, buffer, tick)
        document = _document(series, buffer, meshes, moving)
    with open(folder / f"{series.name}.glb", "wb") as out:
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        out.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + buffer.length))
        out.write(struct.pack("<I4s", len(text), b"JSON") + text)
        out.write(struct.pack("<I4s", buffer.length, b"BIN\0"))
        with open(chunk, "rb") as file:
            shutil.copyfileobj(file, out, 1 << 20)
    chunk.unlink()


def _check_size(series: Series, vertices: list[int], moves: list[bool]) -> None:
    moving = sum(count for count, moving in zip(vertices, moves) if moving)
    size = 12 * len(series) * moving + 4 * len(series) ** 2 + 40 * sum(vertices) + 400 * len(series) * len(vertices)
    if size > LARGEST:
        raise SceneError(
            f"export: {len(series)} frames of {moving} moving vertices take {size / 2**30:.1f} GiB, and a GLB file "
            "holds 4 GiB at most; take fewer frames with fps or every, or export to usd"
        )


def _meshes(
    series: Series, splits: list[Any], moves: list[bool], buffer: _Buffer, tick: Callable[[], None]
) -> tuple[list[dict[str, Any]], list[int]]:
    """Writes all arrays; returns the meshes, and the numbers of those that move."""
    names = list(series.materials)
    meshes: list[dict[str, Any]] = []
    base: list[Reals] = []
    for index, frame in series.frames():
        for number, (piece, (old, faces, uv), positions) in enumerate(zip(series.pieces, splits, frame)):
            if index == 0:
                base.append(positions[old])
                attributes = {"POSITION": buffer.add(base[-1].astype(np.float32), "VEC3", True, ARRAY_BUFFER)}
                if uv is not None:  # v points down in glTF
                    flipped = np.stack([uv[:, 0], 1 - uv[:, 1]], 1).astype(np.float32)
                    attributes["TEXCOORD_0"] = buffer.add(flipped, "VEC2", False, ARRAY_BUFFER)
                indices = buffer.add(faces.astype(np.uint32).ravel(), "SCALAR", False, ELEMENT_BUFFER)
                primitive: dict[str, Any] = {"attributes": attributes, "indices": indices}
                if piece.material:
                    primitive["material"] = names.index(piece.material)
                meshes.append({"name": piece.name, "primitives": [primitive]})
            elif moves[number]:
                offset = (positions[old] - base[number]).astype(np.float32)
                targets = meshes[number]["primitives"][0].setdefault("targets", [])
                targets.append({"POSITION": buffer.add(offset, "VEC3", True, ARRAY_BUFFER)})
        tick()
    moving = [number for number in range(len(meshes)) if moves[number]]
    for number in moving:
        meshes[number]["weights"] = [0.0] * (len(series) - 1)
    return meshes, moving


def _document(series: Series, buffer: _Buffer, meshes: list[dict[str, Any]], moving: list[int]) -> dict[str, Any]:
    """Appends the animation to the buffer; returns the file's JSON."""
    nodes: list[dict[str, Any]] = [
        {"name": series.name, "rotation": QUARTER_TURN, "children": list(range(1, len(meshes) + 1))}
    ]
    nodes += [{"name": mesh["name"], "mesh": number} for number, mesh in enumerate(meshes)]
    animations = []
    if moving:
        times = buffer.add(series.times.astype(np.float32), "SCALAR", True)
        weights = buffer.add(np.eye(len(series), dtype=np.float32)[:, 1:].ravel(), "SCALAR")
        target = [{"sampler": 0, "target": {"node": number + 1, "path": "weights"}} for number in moving]
        sampler = {"input": times, "output": weights, "interpolation": "LINEAR"}
        animations = [{"name": series.scene, "samplers": [sampler], "channels": target}]
    materials = [
        {
            "name": name,
            "doubleSided": True,
            "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9},
        }
        for name, color in series.materials.items()
    ]
    document = {
        "asset": {"version": "2.0", "generator": f"cama {__version__}"},
        "scene": 0,
        "scenes": [{"name": series.scene, "nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "animations": animations,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.length}],
    }
    return {key: value for key, value in document.items() if value != []}
