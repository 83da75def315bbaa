# SPDX-License-Identifier: Apache-2.0
"""glTF files: their JSON, and the numbers of their accessors, checked against the bytes that are there."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..errors import FileError
from ..types import Reals

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
KNOWN = ("KHR_materials_", "KHR_texture_transform", "KHR_lights_punctual", "KHR_mesh_quantization", "EXT_texture_webp")


def content_of(file: Path) -> tuple[dict[str, Any], bytes]:
    """Returns the JSON of a file, a dict, and its binary chunk. Raises FileError."""
    try:
        content = file.read_bytes()
    except OSError as problem:
        raise FileError(f"{file}: {problem.strerror}") from None
    chunk = b""
    if content[:4] == b"glTF":  # a header of 12 bytes, then chunks behind their length and their type
        length = int.from_bytes(content[12:16], "little")
        chunk = content[20 + length + 8 :][: int.from_bytes(content[20 + length :][:4], "little")]
        content = content[20 : 20 + length]
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        raise FileError(f"{file}: is not glTF, or damaged: its JSON cannot be read") from None
    if not isinstance(data, dict):
        raise FileError(f"{file}: is not glTF, or damaged: its JSON is no object")
    return data, chunk


class GltfFile:
    """A glTF file whose numbers can be read.

    Raises:
        FileError
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.data, self._chunk = content_of(file)
        for name in self.data.get("extensionsRequired", []):
            if not str(name).startswith(KNOWN):
                raise FileError(f"{file}: needs the extension {name}, which is not read; export it without compression")
        self._buffers: dict[int, bytes] = {}

    def row(self, kind: str, index: Any) -> dict[str, Any]:
        """Returns an entry of one of the file's lists, such as "nodes". Raises FileError if it is not there."""
        rows = self.data.get(kind, [])
        if isinstance(index, bool) or not isinstance(index, int) or not isinstance(rows, list):
            raise self.damaged(f"{kind}: {index!r} is no index")
        if not 0 <= index < len(rows) or not isinstance(rows[index], dict):
            raise self.damaged(f"{kind}: there is no {index}")
        found: dict[str, Any] = rows[index]
        return found

    def damaged(self, what: str) -> FileError:
        """Returns the error for a file that is not as the format says."""
        return FileError(f"{self.file}: is damaged: {what}; export it again")

    def numbers(self, index: Any, width: int, most: int | None = None) -> Reals:
        """Returns the numbers [count, width] of an accessor, integers that stand for fractions as these.

        most: Count that is expected of an accessor which may have no bytes of its own.
        """
        row = self.row("accessors", index)
        count, kind = row.get("count"), TYPES.get(row.get("componentType", 0))
        if kind is None or WIDTHS.get(str(row.get("type"))) != width or not isinstance(count, int) or count < 1:
            raise self.damaged(f"accessor {index} has no {width} numbers a row")
        if most is not None and count != most:
            raise self.damaged(f"accessor {index} has {count} rows, not {most}")
        if "bufferView" in row:
            values = self._values(row["bufferView"], row.get("byteOffset", 0), kind, count, width).astype(float)
        elif most is None:
            raise self.damaged(f"accessor {index} has no bytes")
        else:
            values = np.zeros((count, width))
        sparse = row.get("sparse")
        if sparse is not None:
            self._put_sparse(index, sparse, values, kind)
        if row.get("normalized") and kind != "<f4":
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        if not np.isfinite(values).all():
            raise self.damaged(f"accessor {index} has a number that is not finite")
        return values

    def _put_sparse(self, index: Any, sparse: Any, values: Reals, kind: str) -> None:
        try:
            count, where, what = sparse["count"], sparse["indices"], sparse["values"]
            places = self._values(
                where["bufferView"], where.get("byteOffset", 0), TYPES[where["componentType"]], count, 1
            ).ravel()
            given = self._values(what["bufferView"], what.get("byteOffset", 0), kind, count, values.shape[1])
        except (KeyError, TypeError, AttributeError):
            raise self.damaged(f"accessor {index}: sparse") from None
        if places.dtype == np.float32 or not ((places >= 0) & (places < len(values))).all():
            raise self.damaged(f"accessor {index}: sparse: an index is outside")
        values[places.astype(int)] = given

    def _values(self, view_index: Any, offset: Any, kind: str, count: Any, width: int) -> Any:
        view = self.row("bufferViews", view_index)
        if "EXT_meshopt_compression" in view.get("extensions", {}):
            raise FileError(f"{self.file}: is compressed by meshopt, which is not read; export it without compression")
        content = self._buffer(view.get("buffer"))
        size = np.dtype(kind).itemsize
        stride, start, length = view.get("byteStride", size * width), view.get("byteOffset", 0), view.get("byteLength")
        whole = (count, offset, stride, start, length)
        if any(isinstance(value, bool) or not isinstance(value, int) or value < 0 for value in whole):
            raise self.damaged(f"buffer view {view_index}")
        last = start + offset + stride * (count - 1) + size * width
        if count < 1 or stride < size * width or last > min(len(content), start + length):
            raise self.damaged(f"buffer view {view_index} has too few bytes")
        return np.ndarray((count, width), kind, content, start + offset, (stride, size))

    def _buffer(self, index: Any) -> bytes:
        row = self.row("buffers", index)
        if index not in self._buffers:
            self._buffers[index] = self._read(row.get("uri"))
        return self._buffers[index]

    def _read(self, uri: Any) -> bytes:
        if uri is None:
            return self._chunk
        try:
            if str(uri).startswith("data:"):
                return base64.b64decode(str(uri).partition(",")[2], validate=True)
            return (self.file.parent / unquote(str(uri))).read_bytes()
        except OSError as problem:
            raise FileError(f"{self.file}: its buffer {uri}: {problem.strerror}") from None
        except (ValueError, struct.error):
            raise self.damaged("a buffer is no base64") from None
