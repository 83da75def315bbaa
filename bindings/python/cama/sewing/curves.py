# SPDX-License-Identifier: Apache-2.0
"""Plane curves of pattern edges: lines, Bézier curves of degree 2 and 3, and arcs of circles."""

from __future__ import annotations

import numpy as np

from ..types import Reals

SAMPLES = 1024  # of a Bézier curve, between which its length is linear in its parameter


def relative_point(start: Reals, end: Reals, point: Reals) -> Reals:
    """Returns start + x (end - start) + y times (end - start) turned by +90 degrees, of a point (x, y)."""
    along = end - start
    return start + point[0] * along + point[1] * np.array([-along[1], along[0]])


class Sampled:
    """A curve whose length is measured on samples of its parameter from 0 to 1."""

    def __init__(self, samples: int) -> None:
        self._t = np.linspace(0, 1, samples + 1)
        steps = np.linalg.norm(np.diff(self._at(self._t), axis=0), axis=1)
        self._lengths = np.concatenate([[0.0], np.cumsum(steps)])

    def _at(self, t: Reals) -> Reals:
        """Returns the points [n, 2] at parameters [n]."""
        raise NotImplementedError

    @property
    def length(self) -> float:
        """Length of the curve."""
        return float(self._lengths[-1])

    @property
    def straight(self) -> bool:
        """Whether it is a line."""
        return len(self._t) == 2

    def at(self, fractions: Reals) -> Reals:
        """Returns the points [n, 2] at fractions [n] of the length."""
        return self._at(np.interp(np.asarray(fractions, float) * self.length, self._lengths, self._t))

    def scaled(self, factors: Reals) -> Sampled:
        """Returns the curve with its coordinates multiplied by factors [2]."""
        return Stretched(self, factors)


class Bezier(Sampled):
    """A Bézier curve with control points [degree + 1, 2]; of degree 1 a line."""

    def __init__(self, control: Reals) -> None:
        self.control = np.asarray(control, float)
        super().__init__(SAMPLES if len(self.control) > 2 else 1)

    def _at(self, t: Reals) -> Reals:
        points = np.repeat(self.control[None], len(t), axis=0)  # de Casteljau
        while points.shape[1] > 1:
            points = points[:, :-1] * (1 - t)[:, None, None] + points[:, 1:] * t[:, None, None]
        return points[:, 0]

    def scaled(self, factors: Reals) -> Sampled:
        return Bezier(self.control * factors)


class Stretched(Sampled):
    """A curve whose coordinates are multiplied by factors [2]."""

    def __init__(self, curve: Sampled | Arc, factors: Reals) -> None:
        self._curve, self._factors = curve, np.asarray(factors, float)
        super().__init__(SAMPLES)

    def _at(self, t: Reals) -> Reals:
        return self._curve.at(t) * self._factors


class Arc:
    """An arc of a circle through two points.

    Args:
        start, end: Ends [2].
        radius: Radius, at least half of the distance of the ends.
        large: Whether it is the longer of the two arcs.
        counterclockwise: Whether it turns counterclockwise from start to end.
    """

    def __init__(self, start: Reals, end: Reals, radius: float, large: bool, counterclockwise: bool) -> None:
        chord = end - start
        half = 0.5 * float(np.linalg.norm(chord))
        self.radius = max(float(radius), half)
        side = 1.0 if large != counterclockwise else -1.0
        normal = np.array([-chord[1], chord[0]]) / (2 * half)
        self.center = 0.5 * (start + end) + side * normal * np.sqrt(max(self.radius**2 - half**2, 0.0))
        sweep = 2 * np.arcsin(min(1.0, half / self.radius))
        sweep = 2 * np.pi - sweep if large else sweep
        self.sweep = sweep if counterclockwise else -sweep
        self._first = np.arctan2(*(start - self.center)[::-1])
        self._ends = start, end

    straight = False

    @property
    def length(self) -> float:
        """Length of the arc."""
        return abs(self.sweep) * self.radius

    def at(self, fractions: Reals) -> Reals:
        """Returns the points [n, 2] at fractions [n] of the length."""
        fractions = np.asarray(fractions, float)
        angle = self._first + fractions * self.sweep
        points = self.center + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points[fractions == 0], points[fractions == 1] = self._ends
        return points

    def scaled(self, factors: Reals) -> Sampled:
        """Returns the curve with its coordinates multiplied by factors [2]: an arc of an ellipse."""
        return Stretched(self, factors)
