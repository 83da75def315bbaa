# SPDX-License-Identifier: Apache-2.0
"""What drives many simulations between their steps, in all of them at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _core
from .driving import seconds
from .parts import Obstacle
from .simulation import Simulation
from .types import ArrayLike, Reals
from .world_arguments import WorldArguments


class DrivingWorlds:
    """What can be set in many simulations, from the next step on."""

    __slots__ = ("_core", "_worlds", "_arguments")

    def __init__(self, core: _core.Worlds, worlds: list[Simulation]) -> None:
        self._core, self._worlds, self._arguments = core, worlds, WorldArguments(worlds)

    def pin(
        self,
        vertices: Any,
        targets: Any = None,
        duration: float | None = None,
        worlds: ArrayLike | None = None,
    ) -> None:
        """Holds cloth vertices of worlds from the next step on, as `Simulation.pin`.

        Args:
            vertices: Vertices, the same in all k worlds: indices [n], one index, or a mask [cloth vertices]; or rows of
                them, one for each world.
            targets: Positions [k, n, 3], m, or [n, 3] for all of them, or a list of k arrays where the numbers of
                vertices differ; None: they stay where they are.
            duration: Time in which they reach them, s; None: one time step.
            worlds: The k worlds: one number, numbers [k], or a mask [worlds]; None: all.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._arguments.chosen("pin", worlds)
        rows = self._arguments.vertices("pin", vertices, chosen)
        given = [np.empty((0, 3))] * len(chosen)
        if targets is not None:
            given = self._arguments.vectors("pin: targets", targets, chosen, [len(row) for row in rows])
        self._core.pin(chosen, rows, given, seconds("pin", duration))

    def set_targets(
        self, vertices: Any, positions: Any, duration: float | None = None, worlds: ArrayLike | None = None
    ) -> None:
        """Moves vertices of worlds that `pin` holds, as `Simulation.set_targets`.

        Args:
            vertices: As in `pin`.
            positions: Positions [k, n, 3], m, as the targets of `pin`.
            duration: Time in which they reach them, s; None: one time step.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._arguments.chosen("set_targets", worlds)
        rows = self._arguments.vertices("set_targets", vertices, chosen)
        given = self._arguments.vectors("set_targets: positions", positions, chosen, [len(row) for row in rows])
        self._core.set_targets(chosen, rows, given, seconds("set_targets", duration))

    def release(self, vertices: Any, worlds: ArrayLike | None = None) -> None:
        """Lets go of vertices of worlds, as `Simulation.release`.

        Args:
            vertices: As in `pin`.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._arguments.chosen("release", worlds)
        self._core.release(chosen, self._arguments.vertices("release", vertices, chosen))

    def set_force(self, vertices: Any, forces: Any, worlds: ArrayLike | None = None) -> None:
        """Applies forces to cloth vertices of worlds until they are set anew, as `Simulation.set_force`.

        Args:
            vertices: As in `pin`.
            forces: Forces [k, n, 3], N, or [n, 3] for all worlds, or one [3] for all vertices of all worlds, or a list
                of k arrays where the numbers of vertices differ.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._arguments.chosen("set_force", worlds)
        rows = self._arguments.vertices("set_force", vertices, chosen)
        given = self._arguments.vectors("set_force: forces", forces, chosen, [len(row) for row in rows], one=True)
        self._core.set_force(chosen, rows, given)

    def set_obstacle_pose(
        self,
        obstacle: Obstacle | int | str,
        translation: Any = (0, 0, 0),
        rotation: Any = (1, 0, 0, 0),
        duration: float | None = None,
        worlds: ArrayLike | None = None,
    ) -> None:
        """Moves an obstacle of each of the worlds to x -> rotation x + translation, as `Simulation.set_obstacle_pose`.

        Args:
            obstacle: Index or name in each world, or a handle of one world's scene.
            translation: Vectors [k, 3], m, or one [3] for all.
            rotation: Unit quaternions [k, 4]: w, x, y, z, or one [4] for all.
            duration: Time in which the pose is reached, s; None: one time step.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._arguments.chosen("set_obstacle_pose", worlds)
        self._core.set_obstacle_pose(
            chosen,
            self._arguments.obstacles("set_obstacle_pose", obstacle, chosen),
            self._arguments.each("set_obstacle_pose: translation", translation, chosen, 3),
            self._arguments.each("set_obstacle_pose: rotation", rotation, chosen, 4),
            seconds("set_obstacle_pose", duration),
        )

    @property
    def gravity(self) -> Reals:
        """Gravity [worlds, 3], m/s^2. An assignment, also of one [3] for all, holds from the next step on."""
        return self._core.gravity()

    @gravity.setter
    def gravity(self, value: Any) -> None:
        self.set_gravity(value)

    def set_gravity(self, gravity: Any, worlds: ArrayLike | None = None) -> None:
        """Sets the gravity of worlds from the next step on.

        Args:
            gravity: Vectors [k, 3], m/s^2, or one [3] for all.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed in any world.
        """
        chosen = self._arguments.chosen("set_gravity", worlds)
        self._core.set_gravity(chosen, self._arguments.each("gravity", gravity, chosen, 3))

    @property
    def wind(self) -> Reals:
        """Velocity of the air [worlds, 3], m/s, zero without wind. An assignment holds from the next step on."""
        return self._core.wind()

    @wind.setter
    def wind(self, value: Any) -> None:
        self.set_wind(value)

    def set_wind(self, velocity: Any, worlds: ArrayLike | None = None) -> None:
        """Sets the velocity of the air in worlds whose scenes have a wind, from the next step on.

        Args:
            velocity: Vectors [k, 3], m/s, or one [3] for all.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit, or a scene has no wind. Nothing has changed in any world.
        """
        chosen = self._arguments.chosen("set_wind", worlds)
        self._core.set_wind(chosen, self._arguments.each("wind", velocity, chosen, 3))

    def set_state(self, positions: Any, velocities: Any, worlds: ArrayLike | None = None) -> None:
        """Replaces the positions and velocities of all cloth vertices of worlds.

        Args:
            positions: Positions [k, cloth vertices, 3], m, or a list of k arrays where the worlds' sizes differ.
            velocities: Velocities, likewise, m/s.
            worlds: The k worlds: one number, numbers [k], or a mask [worlds]; None: all.

        Raises:
            ArrayError: The arrays do not fit. Nothing has changed.
            CollisionError: The positions of a world intersect, as of `Simulation.set_state`. Its state is unchanged;
                the states of the others are set.
        """
        chosen = self._arguments.chosen("set_state", worlds)
        self._core.set_state(
            chosen,
            self._arguments.rows("set_state: positions", positions, chosen),
            self._arguments.rows("set_state: velocities", velocities, chosen),
        )
