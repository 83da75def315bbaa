# SPDX-License-Identifier: Apache-2.0
"""What every format writes: the objects of a recording and their positions at the chosen moments."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import SceneError
from ...types import Integers, Reals
from ..recording import Part, Recording
from ..rendering.look import CLOTHS, OBSTACLE
from ..rendering.moments import moments_of, place_of, positions_at
from ..tessellation import drawn


@dataclass
class Piece:
    """A cloth or an obstacle as a mesh of triangles whose vertices move."""

    name: str  #: as in the recording
    identifier: str  #: the name in letters, digits and underscores, unlike all others in any case of letters
    is_cloth: bool
    faces: Integers  #: [triangles, 3]
    material: str  #: "" if none is recorded
    uv: Reals | None  #: texture coordinates [k, 2]
    uv_faces: Integers | None  #: [triangles, 3], into `uv`
    color: tuple[float, float, float]  #: linear RGB
    part: Part
    kept: Integers  #: [vertices] of those that `drawn` gives

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return len(self.kept)

    def split(self) -> tuple[Integers, Integers, Reals | None]:
        """Returns vertices that have one texture coordinate each, as most formats need them.

        Returns:
            The old vertex [n] of each new one, triangles [m, 3] of new vertices, texture coordinates [n, 2] or None.
        """
        if self.uv is None or self.uv_faces is None:
            return np.arange(self.vertex_count), self.faces, None
        corners = np.stack([self.faces.ravel(), self.uv_faces.ravel()], 1)
        pairs, index = np.unique(corners, axis=0, return_inverse=True)
        return pairs[:, 0], index.reshape(-1, 3), self.uv[pairs[:, 1]]


def identifier_of(name: str, taken: set[str]) -> str:
    """Returns a name in letters, digits and underscores that is not taken, and takes it."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "object"
    word = f"_{word}" if word[0].isdigit() else word
    unique, number = word, 1
    while unique.lower() in taken:
        number += 1
        unique = f"{word}_{number}"
    taken.add(unique.lower())
    return unique


def linear_color(text: str) -> tuple[float, float, float]:
    """Returns linear RGB of a colour such as "#3f74b5", which is sRGB."""
    value = np.array([int(text[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    red, green, blue = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).tolist()
    return red, green, blue


def _closed(vertices: Reals, faces: Integers) -> tuple[Integers, Integers]:
    """Joins vertices of a sphere or capsule that coincide, as those of a ring at a pole do, so that it is closed.

    Returns:
        The vertices [k] that are kept, and triangles [m, 3] of these, without those that collapse.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    places = np.round((vertices - (low + high) / 2) / (1e-6 * (high - low).max()))
    _, kept, index = np.unique(places, axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1)[faces]
    a, b, c = faces.T
    return kept, faces[(a != b) & (b != c) & (c != a)]


class Series:
    """The frames that are exported: `pieces`, `times` [frames] s from the first one, `fps`, `name`, `up`.

    Args:
        recording: The Recording.
        name: Name of its folder.
        cloth_only, fps, first, last, every, up: As for `export`.
        unit: Unit of length of the file, m.

    Raises:
        SceneError
    """

    def __init__(
        self,
        recording: Recording,
        name: str,
        cloth_only: bool,
        fps: float | None,
        first: int,
        last: int | None,
        every: int,
        up: str,
        unit: float,
    ) -> None:
        self._recording, self.up, self.unit = recording, up, unit
        self.scene = " ".join(str(recording.attributes.get("scene", name)).split())
        self.name = identifier_of(name, set())
        self._moments = self._choose(fps, first, last, every)
        self.times = self._moments - self._moments[0]
        interval = float(np.median(np.diff(self._moments))) if len(self) > 1 else 1 / 24
        self.fps = float(fps) if fps else float(f"{1 / interval:.9g}")
        self._seen = self._view()
        self.pieces = self._pieces(cloth_only)

    def _choose(self, fps: float | None, first: int, last: int | None, every: int) -> Reals:
        """Returns the moments [frames], s."""
        count = len(self._recording)
        last = count - 1 if last is None else last
        if not 0 <= first <= last < count:
            raise SceneError(
                f"export: frames {first} to {last} are not all there; frames 0 to {count - 1} are recorded"
            )
        if every < 1:
            raise SceneError(f"export: every: {every} is below 1")
        if fps is not None and not 0 < fps < np.inf:
            raise SceneError(f"export: fps: {fps:g} is not above 0")
        if fps is not None and every > 1:
            raise SceneError(
                "export: every: chooses recorded frames, and fps makes frames of its own; give one of them"
            )
        times = self._recording.times[first : last + 1]
        return np.asarray(moments_of(times, fps, 1.0) if fps else times[::every])

    def _view(self) -> tuple[Reals, float]:
        """Returns center and size, m, of what moves: planes are shown there."""
        points = np.concatenate(
            [
                self._recording.frame(index)[part.vertices]
                for index in (0, len(self._recording) - 1)
                for part in self._recording.cloths + [p for p in self._recording.obstacles if p.shape != "plane"]
            ]
            or [np.zeros((1, 3))]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        return (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0

    def _pieces(self, cloth_only: bool) -> list[Piece]:
        taken: set[str] = set()
        start = positions_at(self._recording, self._moments[0])
        materials = sorted({part.material for part in self._recording.cloths})
        pieces = []
        parts = self._recording.cloths + ([] if cloth_only else self._recording.obstacles)
        for number, part in enumerate(parts):
            is_cloth = number < len(self._recording.cloths)
            vertices, faces = drawn(part, start, self._seen)
            kept = np.arange(len(vertices))
            if part.shape in ("sphere", "capsule"):
                kept, faces = _closed(vertices, faces)
            color = linear_color(CLOTHS[materials.index(part.material) % len(CLOTHS)] if is_cloth else OBSTACLE)
            identifier = identifier_of(part.name, taken)
            pieces.append(
                Piece(
                    part.name,
                    identifier,
                    is_cloth,
                    faces,
                    part.material,
                    part.uv,
                    part.uv_faces,
                    color,
                    part,
                    kept,
                )
            )
        if not pieces:
            raise SceneError("export: the recording has no cloth" + ("" if cloth_only else " and no obstacle"))
        return pieces

    def __len__(self) -> int:
        return len(self._moments)

    @property
    def materials(self) -> dict[str, tuple[float, float, float]]:
        """Colours of the materials that the cloths have, by name."""
        return {piece.material: piece.color for piece in self.pieces if piece.material}

    @property
    def textured(self) -> bool:
        """Whether a piece has texture coordinates."""
        return any(piece.uv is not None for piece in self.pieces)

    def texture_of_vertices(self) -> Reals | None:
        """Returns texture coordinates [all vertices, 2], 0 where there are none; None if a vertex has several."""
        result = []
        for piece in self.pieces:
            values = np.zeros((piece.vertex_count, 2))
            if piece.uv is not None:
                values[piece.faces] = piece.uv[piece.uv_faces]
                if not np.array_equal(values[piece.faces], piece.uv[piece.uv_faces]):
                    return None
            result.append(values)
        return np.concatenate(result)

    def moves(self) -> list[bool]:
        """Whether each piece moves; cloth does."""
        result = [piece.is_cloth for piece in self.pieces]
        if len(self) == 1 or all(result):
            return [moving and len(self) > 1 for moving in result]
        start = positions_at(self._recording, self._moments[0])
        for moment in self._moments[1:]:
            now = positions_at(self._recording, moment)
            for number, piece in enumerate(self.pieces):
                own = piece.part.vertices
                result[number] = result[number] or not np.array_equal(now[own], start[own])
            if all(result):
                break
        return result

    def frame(self, index: int) -> list[Reals]:
        """Returns the positions [vertices, 3] of each piece, in units of the file."""
        positions = positions_at(self._recording, self._moments[index])
        return [self._turned(drawn(piece.part, positions, self._seen)[0][piece.kept]) for piece in self.pieces]

    def frames(self) -> Iterator[tuple[int, list[Reals]]]:
        """Iterates over (index, positions of each piece)."""
        for index in range(len(self)):
            yield index, self.frame(index)

    def counts(self, index: int) -> dict[str, Any]:
        """Returns contacts and intersections of a frame by name; nothing between recorded frames."""
        recorded, part = place_of(self._recording.times, self._moments[index])
        return {} if part else self._recording.counts(recorded)

    def _turned(self, positions: Reals) -> Reals:
        scaled = positions / self.unit
        return scaled if self.up == "z" else np.stack([scaled[:, 0], scaled[:, 2], -scaled[:, 1]], 1)
