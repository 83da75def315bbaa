# SPDX-License-Identifier: Apache-2.0
"""The scene that a simulation shows."""

from __future__ import annotations

from typing import Any, NoReturn

from . import _core
from .errors import SceneError
from .scene import Scene


class SimulatedScene(Scene):
    """The scene of a simulation, which is read-only: the simulation would not see a change."""

    __slots__ = ()

    @classmethod
    def of(cls, scene: Scene) -> SimulatedScene:
        """Returns a read-only copy of a scene."""
        return cls._of(_core.Scene(scene._core), scene._folder)

    def _refuse(self, what: str) -> NoReturn:
        raise SceneError(
            f"{what}: the scene of a simulation is read-only; drive the simulation (pin, set_targets, "
            "set_obstacle_pose, gravity, ...), or change the scene and make a new simulation"
        )

    def _allow_change(self, what: str) -> None:
        self._refuse(what)

    def __setattr__(self, name: str, value: object) -> None:
        if name not in ("_core", "_folder"):
            self._refuse(name)
        object.__setattr__(self, name, value)

    def add_cloth(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("add_cloth")

    def add_obstacle(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("add_obstacle")

    def pin(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("pin")

    def attach(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("attach")

    def stitch(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("stitch")

    def elastic(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("elastic")

    def crease(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("crease")

    def untangle(self, *arguments: Any, **named: Any) -> NoReturn:
        self._refuse("untangle")
