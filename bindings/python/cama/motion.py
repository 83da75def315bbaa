# SPDX-License-Identifier: Apache-2.0
"""Motions of pins and obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from . import _core
from .arrays import number, quaternion, reals, vector
from .errors import ArrayError, SceneError
from .hints import similar
from .types import ArrayLike, VectorLike

__all__ = ["Motion"]

KEY = ("time", "translation", "rotation", "scale", "center")
ARGUMENTS = (
    "velocity",
    "rotation_rate",
    "oscillation",
    "period",
    "center",
    "start",
    "stop",
    "keys",
    "times",
    "positions",
)


def _check_names(what: str, given: object, known: tuple[str, ...], needed: str | None = None) -> None:
    """Raises SceneError if something is not a dict of these names."""
    if not isinstance(given, Mapping):
        raise SceneError(f"{what}: {given!r} is not a dict with {', '.join(known)}")
    for name in given:
        if name not in known:
            raise SceneError(f"{what}: {name!r} is not known; there are {', '.join(known)}{similar(name, known)}")
    if needed is not None and needed not in given:
        raise SceneError(f"{what}: has no {needed}")


class Motion(_core.Motion):
    """A prescribed motion, continuous in time.

    Args:
        velocity: Velocity [3], m/s.
        rotation_rate: Axis times rate of a rotation about `center` [3], rad/s.
        oscillation: Amplitude of a sine [3], m.
        period: Period of the sine, s.
        center: Centre of rotation [3], m.
        start: Time at which velocity, rotation and oscillation begin, s.
        stop: Time at which they end, s.
        keys: Dicts with `time` and any of `translation`, `rotation` (unit quaternion w, x, y, z), `scale` and `center`.
            Between keys they are interpolated; before the first and after the last they are constant.
        times: Times [k] of a vertex animation, s, in place of all of the above.
        positions: Positions [k, vertices, 3] at these times, m.

    Raises:
        ArrayError: An argument or a value of a key has a wrong type or shape.
        SceneError: `keys` are not dicts of these names, or one has no time.
    """

    __slots__ = ()

    def __init__(
        self,
        velocity: VectorLike = (0, 0, 0),
        rotation_rate: VectorLike = (0, 0, 0),
        oscillation: VectorLike = (0, 0, 0),
        period: float = 1.0,
        center: VectorLike = (0, 0, 0),
        start: float = 0.0,
        stop: float = 1e300,
        keys: Iterable[Mapping[str, Any]] = (),
        times: ArrayLike | None = None,
        positions: ArrayLike | None = None,
    ) -> None:
        super().__init__()
        self.velocity = vector("motion: velocity", velocity)
        self.rotation_rate = vector("motion: rotation_rate", rotation_rate)
        self.oscillation = vector("motion: oscillation", oscillation)
        self.center = vector("motion: center", center)
        self.period = number("motion: period", period)
        self.start = number("motion: start", start)
        self.stop = number("motion: stop", stop)
        if not isinstance(keys, Iterable):
            raise SceneError(f"motion: keys: {keys!r} is not a list of dicts")
        for index, key in enumerate(keys):
            _check_names(f"motion: key {index}", key, KEY, "time")
            self._add_key(f"motion: key {index}", **key)
        if (times is None) != (positions is None):
            raise ArrayError("motion: times and positions come together")
        if times is not None:
            self._set_samples(times, positions)

    @classmethod
    def of(cls, value: _core.Motion | dict[str, Any] | None) -> _core.Motion:
        """Returns a motion made from a motion, a dict of arguments, or None (at rest)."""
        if isinstance(value, dict):
            _check_names("motion", value, ARGUMENTS)
            return cls(**value)
        if value is not None and not isinstance(value, _core.Motion):
            raise SceneError(f"motion: {value!r} is neither a cama.Motion nor a dict of its arguments")
        return cls() if value is None else value

    def _add_key(
        self,
        name: str,
        time: float,
        translation: VectorLike = (0, 0, 0),
        rotation: VectorLike = (1, 0, 0, 0),
        scale: float = 1.0,
        center: VectorLike = (0, 0, 0),
    ) -> None:
        self.add_key(
            number(f"{name}: time", time),
            vector(f"{name}: translation", translation),
            quaternion(f"{name}: rotation", rotation),
            number(f"{name}: scale", scale),
            vector(f"{name}: center", center),
        )

    def _set_samples(self, times: object, positions: object) -> None:
        times = reals("motion: times", times, (None,))
        positions = reals("motion: positions", positions, (len(times), None, 3))
        if not len(times) or (times[1:] <= times[:-1]).any():
            raise ArrayError("motion: times: at least one, each later than the one before")
        self.set_samples(times, positions)
