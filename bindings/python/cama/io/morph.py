# SPDX-License-Identifier: Apache-2.0
"""glTF files whose animation blends morph targets: their meshes, with the positions in time.

Files with a skeleton are read by the compiled reader, which leaves morph targets at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError
from ..types import Integers, Reals
from .gltf_file import GltfFile, content_of

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive
LARGEST = 200_000_000  # numbers of an animation
MOST = 1e7  # samples
DEEPEST = 200  # nodes below each other
REMARK = "; its morph targets stay at rest, since it has a skeleton"


@dataclass
class Moving:
    """Triangles whose vertices move."""

    faces: Integers  #: [triangles, 3]
    times: Reals  #: [samples] s
    positions: Reals  #: [samples, vertices, 3], in the file's unit


def is_animated(file: Any, clip: str = "") -> bool:
    """Whether a file is glTF without a skeleton, and a clip of it blends morph targets."""
    data = _json(file)
    if data.get("skins") or clip == "bind":
        return False
    try:
        return any(channel["target"]["path"] == "weights" for channel in _clip_of(data, clip)["channels"])
    except (LookupError, TypeError, AttributeError):
        return False


def stay_at_rest(file: Any, clip: str = "") -> bool:
    """Whether a clip of a file blends morph targets that are not read, since the file has a skeleton."""
    data = _json(file)
    try:
        blends = any(channel["target"]["path"] == "weights" for channel in _clip_of(data, clip)["channels"])
    except (LookupError, TypeError, AttributeError):
        return False
    return blends and bool(data.get("skins"))


def _json(file: Any) -> dict[str, Any]:
    if Path(file).suffix.lower() not in (".glb", ".gltf"):
        return {}
    try:
        return content_of(Path(file))[0]
    except FileError:
        return {}


def _clip_of(data: dict[str, Any], clip: str) -> dict[str, Any]:
    """Returns the animation of a name or number, "": the first. Raises LookupError."""
    clips = data["animations"]
    named = [each for each in clips if clip and each.get("name") == clip]
    found: dict[str, Any] = named[0] if named else clips[int(clip) if clip.isdigit() else 0 if not clip else len(clips)]
    return found


def read(file: Path, clip: str, samples_per_second: float, y_up: bool, lead_in: float, loops: int) -> Moving:
    """Reads the meshes of a file, as they move.

    Args:
        file: A file of which `is_animated` is true.
        clip: Name or number of the animation, "": the first.
        samples_per_second: Samples beside the keys, where positions do not go straight from key to key, 1/s.
        y_up: Whether to turn y, which is up in glTF, to z.
        lead_in: Time in which the meshes move from rest to the start of the clip, s.
        loops: How many times the clip is played.

    Raises:
        FileError
    """
    try:
        return _Reader(GltfFile(file), clip).sampled(samples_per_second, y_up, lead_in, loops)
    except (TypeError, KeyError, AttributeError, ValueError, OverflowError) as problem:
        raise FileError(f"{file}: is damaged ({type(problem).__name__}: {problem}); export it again") from None


@dataclass
class _Channel:
    """How one value of a node changes."""

    times: Reals  # [keys] s
    values: Reals  # [keys, width]; of a cubic spline [keys, 3, width]: tangent before, value, tangent after
    how: str

    def at(self, time: float) -> Reals:
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        values = self.values if self.how != "CUBICSPLINE" else self.values[:, 1]
        if k < 0 or k >= len(self.times) - 1:
            return np.asarray(values[min(max(k, 0), len(values) - 1)])
        span = self.times[k + 1] - self.times[k]
        part = (time - self.times[k]) / span
        if self.how == "STEP":
            return np.asarray(values[k])
        if self.how == "CUBICSPLINE":
            square, cube = part**2, part**3
            return np.asarray(
                (2 * cube - 3 * square + 1) * values[k]
                + span * (cube - 2 * square + part) * self.values[k, 2]
                + (3 * square - 2 * cube) * values[k + 1]
                + span * (cube - square) * self.values[k + 1, 0]
            )
        if len(values[k]) == 4 and self.how == "ROTATION":
            return _slerp(values[k], values[k + 1], part)
        return np.asarray((1 - part) * values[k] + part * values[k + 1])


def _slerp(a: Reals, b: Reals, part: float) -> Reals:
    cosine = float(a @ b)
    b, cosine = (-b, -cosine) if cosine < 0 else (b, cosine)
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:
        return np.asarray((1 - part) * a + part * b)
    return np.asarray((math.sin((1 - part) * angle) * a + math.sin(part * angle) * b) / math.sin(angle))


@dataclass
class _Mesh:
    """A mesh of a node: all its primitives together."""

    node: int
    start: Reals  # [vertices, 3]
    targets: list[list[Any]]  # for each primitive: accessors of its targets, None where a target moves nothing
    sizes: list[int]  # vertices of each primitive
    rest: Reals  # [targets] weights


class _Reader:
    def __init__(self, file: GltfFile, clip: str) -> None:
        self._file = file
        data = file.data
        self._nodes = data.get("nodes", [])
        chosen = data.get("scenes", []) and file.row("scenes", data.get("scene", 0))
        below = {child for node in self._nodes for child in node.get("children", [])}
        self._roots = chosen["nodes"] if chosen else [k for k in range(len(self._nodes)) if k not in below]
        self._meshes: list[_Mesh] = []
        self._faces: list[Integers] = []
        self._channels: dict[tuple[int, str], _Channel] = {}
        self._paths: dict[int, list[int]] = {}  # nodes from the root to one with a mesh
        for root in self._roots:
            self._collect(root, [])
        if not self._faces:
            raise FileError(f"{file.file}: has no triangles")
        self._channels = self._channels_of(_clip_of(data, clip))
        self._loaded: dict[int, Reals] = {}

    def _collect(self, index: Any, path: list[int]) -> None:
        node = self._file.row("nodes", index)
        if index in path or len(path) > DEEPEST:
            raise self._file.damaged(f"node {index} is below itself")
        path = [*path, index]
        if "mesh" in node:
            self._paths[index] = path
            self._add_mesh(index, self._file.row("meshes", node["mesh"]), node)
        for child in node.get("children", []):
            self._collect(child, path)

    def _add_mesh(self, index: int, mesh: dict[str, Any], node: dict[str, Any]) -> None:
        points, targets = [], []
        first = sum(len(m.start) for m in self._meshes)
        mirrored = np.linalg.det(self._matrix(index, None)) < 0
        for primitive in mesh["primitives"]:
            if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
                raise FileError(f"{self._file.file}: is compressed by Draco; export it without compression")
            if primitive.get("mode", TRIANGLES) not in (TRIANGLES, STRIP, FAN):
                continue  # points and lines
            start = self._file.numbers(primitive["attributes"]["POSITION"], 3)
            faces = self._triangles(primitive, len(start))
            if mirrored:
                faces = faces[:, ::-1]
            self._faces.append(first + sum(map(len, points)) + faces)
            points.append(start)
            targets.append([target.get("POSITION") for target in primitive.get("targets", [])])
        if not points:
            return
        count = max(map(len, targets))
        weights = np.asarray(node.get("weights", mesh.get("weights", [])) or np.zeros(count), float)
        if weights.shape != (count,):
            raise self._file.damaged(f"mesh {node['mesh']}: {len(weights)} weights for {count} targets")
        self._meshes.append(_Mesh(index, np.concatenate(points), targets, list(map(len, points)), weights))

    def _triangles(self, primitive: dict[str, Any], count: int) -> Integers:
        if "indices" in primitive:
            corners = self._file.numbers(primitive["indices"], 1).ravel().astype(np.int64)
        else:
            corners = np.arange(count)
        if not ((corners >= 0) & (corners < count)).all():
            raise self._file.damaged("a triangle has a vertex that is not there")
        mode = primitive.get("mode", TRIANGLES)
        if mode == TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        k = np.arange(len(corners) - 2)
        if mode == FAN:
            return np.stack([corners[k + 1], corners[k + 2], np.full(len(k), corners[0])], 1)
        return np.stack([corners[k], corners[k + 1 + k % 2], corners[k + 2 - k % 2]], 1)

    def _channels_of(self, clip: dict[str, Any]) -> dict[tuple[int, str], _Channel]:
        found = {}
        for channel in clip["channels"]:
            target, sampler = channel["target"], clip["samplers"][channel["sampler"]]
            path, how = target["path"], sampler.get("interpolation", "LINEAR")
            if "node" not in target or path not in ("weights", "translation", "rotation", "scale"):
                continue
            times = self._file.numbers(sampler["input"], 1).ravel()
            if times[0] < 0 or (np.diff(times) <= 0).any():
                raise self._file.damaged("the times of an animation do not increase from 0")
            kinds = 3 if how == "CUBICSPLINE" else 1
            if path == "weights":
                values = self._file.numbers(sampler["output"], 1)
            else:
                values = self._file.numbers(sampler["output"], 4 if path == "rotation" else 3)
            values = values.reshape(len(times), kinds, -1) if kinds == 3 else values.reshape(len(times), -1)
            how = "ROTATION" if path == "rotation" and how == "LINEAR" else how
            found[target["node"], path] = _Channel(times, values, how)
        if not found:
            raise self._file.damaged("the animation moves nothing")
        return found

    def sampled(self, rate: float, y_up: bool, lead_in: float, loops: int) -> Moving:
        """Returns the meshes with their positions."""
        if not rate > 0:
            raise FileError(f"{self._file.file}: samples_per_second must be greater than 0")
        loops, vertices = max(1, loops), sum(len(mesh.start) for mesh in self._meshes)
        if self._span() * rate > MOST or lead_in * rate > MOST:
            raise FileError(f"{self._file.file}: has too many samples; give a shorter clip or lower samples_per_second")
        clip = self._times(rate)
        count = loops * len(clip) + math.ceil(max(lead_in, 0.0) * rate)
        if 3 * vertices * count > LARGEST:
            raise FileError(
                f"{self._file.file}: {vertices:,} vertices at {count:,} times are more than are read; give a shorter "
                "clip, fewer loops or lower samples_per_second"
            )
        once = np.stack([self._positions(time) for time in clip])
        times, positions = [clip - clip[0]], [once]
        for _ in range(1, loops):  # each begins where the one before has ended
            times.append(times[-1][-1] + (clip - clip[0])[1:])
            positions.append(once[1:])
        if lead_in > 0:  # slow at its beginning and its end, as that of characters
            part = np.linspace(0, 1, max(1, math.ceil(lead_in * rate)) + 1)[:-1]
            eased = (part**3 * (10 + part * (6 * part - 15)))[:, None, None]
            times = [lead_in * part, *(lead_in + moment for moment in times)]
            positions.insert(0, (1 - eased) * self._positions(None) + eased * once[0])
        whole = np.concatenate(positions)
        if y_up:
            whole = np.stack([whole[..., 0], -whole[..., 2], whole[..., 1]], -1)
        kept, index = self._welded(whole)
        a, b, c = faces = index[np.concatenate(self._faces)].T
        faces = faces.T[(a != b) & (b != c) & (c != a)]
        return Moving(faces.astype(np.int32), np.concatenate(times), np.ascontiguousarray(whole[:, kept]))

    def _welded(self, positions: Reals) -> tuple[Integers, Integers]:
        """Finds vertices that differ in texture or normal alone, which are one vertex of the surface.

        Returns:
            The vertices [k] that stay, in the order of the file, and for every vertex the number of the one it is now.
        """
        rest = self._positions(None)
        _, first, group = np.unique(rest, axis=0, return_index=True, return_inverse=True)
        same_as = first[group.reshape(-1)]
        for frame in positions:
            apart = (frame != frame[same_as]).any(axis=1)
            same_as = np.where(apart, np.arange(len(same_as)), same_as)
        kept, index = np.unique(same_as, return_inverse=True)
        return kept, index.reshape(-1)

    def _span(self) -> float:
        """Returns the length of the clip, s."""
        times = [channel.times for channel in self._channels.values()]
        return float(max(row[-1] for row in times) - min(row[0] for row in times))

    def _times(self, rate: float) -> Reals:
        """Returns the times of the keys, and others between them where positions do not go straight."""
        rows = list(self._channels.values())
        keys = np.unique(np.concatenate([channel.times for channel in rows]))
        paths = {path for _, path in self._channels}
        if all(channel.how == "LINEAR" for channel in rows) and paths <= {"weights", "translation"}:
            return keys
        even = keys[0] + np.arange(1, math.ceil(self._span() * rate)) / rate
        merged = np.unique(np.concatenate([keys, even]))
        return np.asarray(merged[np.concatenate([[True], np.diff(merged) > 1e-6 / rate])])

    def _positions(self, time: float | None) -> Reals:
        """Returns positions [vertices, 3] at a time; None: at rest."""
        parts = []
        for mesh in self._meshes:
            channel = self._channels.get((mesh.node, "weights"))
            weights = mesh.rest if channel is None or time is None else channel.at(time)
            if len(weights) != len(mesh.rest):
                raise self._file.damaged(f"{len(weights)} weights for {len(mesh.rest)} targets")
            points, first = mesh.start.copy(), 0
            for size, targets in zip(mesh.sizes, mesh.targets):
                for weight, target in zip(weights, targets):
                    if weight and target is not None:
                        points[first : first + size] += weight * self._target(target, size)
                first += size
            matrix = self._matrix(mesh.node, time)
            parts.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        return np.concatenate(parts)

    def _target(self, index: int, size: int) -> Reals:
        """Returns the displacements [vertices, 3] of a target; the last few are kept."""
        if index not in self._loaded:
            if len(self._loaded) > 4:
                self._loaded.pop(next(iter(self._loaded)))
            self._loaded[index] = self._file.numbers(index, 3, size)
        return self._loaded[index]

    def _matrix(self, index: int, time: float | None) -> Reals:
        """Returns the matrix [4, 4] from a node with a mesh to the world."""
        matrix = np.eye(4)
        for node in self._paths[index]:
            matrix = matrix @ self._placed(node, time)
        return matrix

    def _placed(self, index: int, time: float | None) -> Reals:
        """Returns the matrix [4, 4] of a node."""
        node = self._file.row("nodes", index)
        if "matrix" in node:
            return np.asarray(node["matrix"], float).reshape(4, 4).T
        own = {}
        for path, otherwise in (("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1))):
            channel = self._channels.get((index, path))
            given = node.get(path, otherwise) if channel is None or time is None else channel.at(time)
            own[path] = np.asarray(given, float)
        length = float(np.linalg.norm(own["rotation"]))
        if not length > 0:
            raise self._file.damaged(f"node {index}: a rotation of length 0")
        x, y, z, w = own["rotation"] / length
        made = np.eye(4)
        made[:3, :3] = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ) * own["scale"].reshape(3)
        made[:3, 3] = own["translation"].reshape(3)
        return made
