# SPDX-License-Identifier: Apache-2.0
"""How pins and obstacles move."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

from . import _core
from .arrays import number, quaternion, reals, vector
from .errors import ArrayError, SceneError
from .types import ArrayLike, VectorLike

__all__ = ["Motion"]


class Motion(_core.Motion):
    """A prescribed motion, continuous in time.

    velocity [m/s], rotation_rate [rad/s, axis times rate, about `center`] and the sine `oscillation` [m, with `period` s]
    act between `start` and `stop` [s]. `keys` is a list of dicts with `time` and any of `translation`, `rotation`
    (unit quaternion w, x, y, z), `scale`, `center`, interpolated between and held outside. `times` [k] and `positions`
    [k, vertices, 3] give a vertex animation instead. Throws ArrayError.
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
        times: Optional[ArrayLike] = None,
        positions: Optional[ArrayLike] = None,
    ) -> None:
        super().__init__()
        self.velocity = vector("motion: velocity", velocity)
        self.rotation_rate = vector("motion: rotation_rate", rotation_rate)
        self.oscillation = vector("motion: oscillation", oscillation)
        self.center = vector("motion: center", center)
        self.period = number("motion: period", period)
        self.start = number("motion: start", start)
        self.stop = number("motion: stop", stop)
        for index, key in enumerate(keys):
            self._add_key(f"motion: key {index}", **key)
        if (times is None) != (positions is None):
            raise ArrayError("motion: times and positions come together")
        if times is not None:
            self._set_samples(times, positions)

    @classmethod
    def of(cls, value: Union[_core.Motion, dict[str, Any], None]) -> _core.Motion:
        """A motion from itself, a dict of arguments, or None: at rest."""
        if isinstance(value, dict):
            try:
                return cls(**value)
            except TypeError as problem:
                raise SceneError(f"motion: {problem}") from None
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
