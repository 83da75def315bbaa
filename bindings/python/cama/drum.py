# SPDX-License-Identifier: Apache-2.0
"""The drum of a tumble dryer: a closed surface around a level axis, with paddles, that turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .arrays import number, whole
from .errors import SceneError
from .types import Integers, Reals

__all__ = ["Drum"]


@dataclass(frozen=True)
class Drum:
    """A drum around the y axis, closed at both ends; cloth is inside. Raises SceneError, ArrayError."""

    radius: float = 0.5  #: m
    depth: float = 1.0  #: along y, m
    paddles: int = 3  #: ridges along its wall
    paddle: float = 0.12  #: height of a paddle, m
    rate: float = 3.5  #: rad/s
    ease: float = 0.6  #: time in which it comes up to its rate, s
    triangles: int = 6000

    def __post_init__(self) -> None:
        whole("drum: paddles", self.paddles)
        whole("drum: triangles", self.triangles)
        for name in ("radius", "depth", "rate", "ease"):
            if not number(f"drum: {name}", getattr(self, name)) > 0:
                raise SceneError(f"drum: {name}: must be greater than 0, got {getattr(self, name):g}")
        if not 0 <= self.paddles <= 12:
            raise SceneError(f"drum: paddles: must be from 0 to 12, got {self.paddles}")
        if not 0 <= number("drum: paddle", self.paddle) < 0.6 * self.radius:
            raise SceneError(f"drum: paddle: must be from 0 to 0.6 of the radius, got {self.paddle:g}")
        if not 200 <= self.triangles <= 1_000_000:
            raise SceneError(f"drum: triangles: must be from 200 to 1,000,000, got {self.triangles:,}")

    def outline(self, angle: Reals) -> Reals:
        """Returns the radius [n] at angles [n], m."""
        if not self.paddles:
            return np.full(len(angle), self.radius)
        turn = 2 * math.pi / self.paddles
        away = np.abs((angle - 0.5 * math.pi + 0.5 * turn) % turn - 0.5 * turn)  # one is uppermost at first
        return self.radius - self.paddle * np.exp(-((away / 0.16) ** 4))

    def mesh(self) -> tuple[Reals, Integers]:
        """Returns vertices [n, 3], m, and triangles [m, 3] whose normals point inward, to the cloth."""
        strip = 2 * math.pi * self.radius * (self.depth + 2 * self.radius)  # with ends of equally many columns
        edge = math.sqrt(2 * strip / self.triangles)
        around = max(24, round(2 * math.pi * self.radius / edge))
        along, rings = max(2, round(self.depth / edge)), max(2, round(self.radius / edge))
        angle = 2 * math.pi * np.arange(around) / around
        reach = self.outline(angle)
        sections = [(-0.5 * self.depth, k / rings) for k in range(1, rings)]
        sections += [(self.depth * (k / along - 0.5), 1.0) for k in range(along + 1)]
        sections += [(0.5 * self.depth, k / rings) for k in range(rings - 1, 0, -1)]
        rows = [
            np.stack([share * reach * np.cos(angle), np.full(around, y), share * reach * np.sin(angle)], axis=1)
            for y, share in sections
        ]
        first, last = len(rows) * around, len(rows) * around + 1
        vertices = np.concatenate([*rows, [[0, -0.5 * self.depth, 0], [0, 0.5 * self.depth, 0]]])
        j = np.arange(around)
        k = (j + 1) % around
        faces = [np.stack([np.full(around, first), j, k], axis=1)]
        for row in range(len(rows) - 1):
            a, b, c, d = row * around + j, row * around + k, (row + 1) * around + k, (row + 1) * around + j
            even = ((j + row) % 2 == 0)[:, None]  # diagonals alternate
            faces.append(np.where(even, np.stack([a, d, c], axis=1), np.stack([a, d, b], axis=1)))
            faces.append(np.where(even, np.stack([a, c, b], axis=1), np.stack([b, d, c], axis=1)))
        end = (len(rows) - 1) * around
        faces.append(np.stack([np.full(around, last), end + k, end + j], axis=1))
        return vertices, np.ascontiguousarray(np.concatenate(faces)[:, ::-1], np.int32)

    def angle(self, time: Reals) -> Reals:
        """Returns the angle [n] about y at times [n], rad: it starts from rest with two vanishing derivatives."""
        part = np.clip(np.asarray(time) / self.ease, 0, 1)
        begun = self.ease * part**4 * (2.5 + part * (part - 3))
        return self.rate * (begun + np.maximum(np.asarray(time) - self.ease, 0))

    def keys(self, duration: float) -> list[dict[str, object]]:
        """Returns its motion as keys of a scene file, 30 a second."""
        times = np.linspace(0, duration, max(2, math.ceil(30 * duration) + 1))
        return [
            {"time": float(t), "rotate": {"axis": [0, 1, 0], "angle_deg": math.degrees(a)}}
            for t, a in zip(times, self.angle(times))
        ]
