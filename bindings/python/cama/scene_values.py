# SPDX-License-Identifier: Apache-2.0
"""Values of a whole scene: times, contact, gravity, wind, options."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import _core
from .arrays import number, vector, whole
from .errors import SceneError
from .options import nested, overrides_of
from .types import Vector, VectorLike


class SceneValues:
    """The values of a scene that are not of one of its parts."""

    __slots__ = ("_core", "_folder")  # a field that is not there is an AttributeError

    def __init__(self, core: _core.Scene, folder: Path) -> None:
        self._core, self._folder = core, folder

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._core.name

    @name.setter
    def name(self, value: str) -> None:
        self._core.name = str(value)

    @property
    def description(self) -> str:
        """What the scene shows."""
        return self._core.description

    @description.setter
    def description(self, value: str) -> None:
        self._core.description = str(value)

    @property
    def seconds_per_frame(self) -> float:
        """Time between recorded frames, s: `frame_time`; if that is 0, `time_step`; if both are 0, 1/60."""
        return self._core.seconds_per_frame

    @property
    def time_step(self) -> float:
        """Time step, s; 0: the accuracy level's."""
        return self._core.time_step

    @time_step.setter
    def time_step(self, value: float) -> None:
        self._core.time_step = number("time_step", value)

    @property
    def frame_time(self) -> float:
        """Time between recorded frames, s; 0: `time_step`, or 1/60 s without one."""
        return self._core.frame_time

    @frame_time.setter
    def frame_time(self, value: float) -> None:
        self._core.frame_time = number("frame_time", value)

    @property
    def frames(self) -> int:
        """Number of frames that `cama run` records."""
        return self._core.frames

    @frames.setter
    def frames(self, value: int) -> None:
        self._core.frames = whole("frames", value)

    @property
    def thickness(self) -> float:
        """Contact thickness, m."""
        return self._core.contact.thickness

    @thickness.setter
    def thickness(self, value: float) -> None:
        self._core.contact.thickness = number("thickness", value)

    @property
    def stiffness(self) -> float:
        """Contact penalty, N/m^3."""
        return self._core.contact.stiffness

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        self._core.contact.stiffness = number("stiffness", value)

    @property
    def friction(self) -> float:
        """Coulomb coefficient of cloth against cloth, for materials that give none."""
        return self._core.contact.friction

    @friction.setter
    def friction(self, value: float) -> None:
        self._core.contact.friction = number("friction", value)

    @property
    def static_friction(self) -> float:
        """The coefficient while cloth sticks, not below `friction`; -1: equal to it."""
        return self._core.contact.static_friction

    @static_friction.setter
    def static_friction(self, value: float) -> None:
        self._core.contact.static_friction = number("static_friction", value)

    @property
    def gravity(self) -> Vector:
        """[3] m/s^2."""
        return self._core.gravity

    @gravity.setter
    def gravity(self, value: VectorLike) -> None:
        self._core.gravity = vector("gravity", value)

    @property
    def wind(self) -> dict[str, Any] | None:
        """None, or a dict with velocity, density and drag."""
        wind = self._core.wind
        return None if wind is None else {"velocity": wind.velocity, "density": wind.density, "drag": wind.drag}

    @wind.setter
    def wind(self, value: Mapping[str, Any] | None) -> None:
        wind = None
        if value is not None:
            wind = _core.Wind()
            for key, entry in dict(value).items():
                if key not in ("velocity", "density", "drag"):
                    raise SceneError(f"wind: unknown key {key!r}; there are velocity, density, drag")
                setattr(
                    wind, key, vector("wind: velocity", entry) if key == "velocity" else number(f"wind: {key}", entry)
                )
        self._core.wind = wind

    @property
    def options(self) -> dict[str, Any]:
        """The options that `Simulation` uses unless its caller gives others: `accuracy` and others such as `tolerance`.

        These are the `options` of scene.json; assign a dict to change them. SceneError for a name that is not known, an
        option that belongs to the user alone (`backend`, `pinch`, ...), and a value that is not one of its option.
        """
        return nested(self._core.options.values())

    @options.setter
    def options(self, value: Mapping[str, Any]) -> None:
        options = overrides_of(value)
        _core.check_scene_options(options)
        self._core.options = options

    @property
    def folder(self) -> Path:
        """Folder that relative file names of its scene file start at."""
        return self._folder


def switch(name: str, value: bool) -> bool:
    """Raises SceneError if the value is neither true nor false, such as the object that scene.json has at this key."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError(
            f"{name}: {value!r} is not True or False; thickness, stiffness, friction and static_friction are arguments "
            "of their own"
        )
    return bool(value)
