# SPDX-License-Identifier: Apache-2.0
"""What drives a simulation between its steps: pins, poses of obstacles, forces, air, pressure, a new state."""

from __future__ import annotations

import numpy as np

from .arrays import number, quaternion, vector
from .device_arrays import on_host, spread
from .device_arrays import vectors as device_vectors
from .errors import ArrayError, SceneError
from .parts import Cloth, Obstacle
from .readings import Readings
from .types import ArrayLike, Vector, VectorLike


class Driving(Readings):
    """What can be set in a simulation of a scene, from the next step on."""

    __slots__ = ()

    def pin(self, vertices: ArrayLike, targets: ArrayLike | None = None, duration: float | None = None) -> None:
        """Holds cloth vertices from the next step on, also ones that the scene pins or attaches.

        Args:
            vertices: Vertices, numbered through all cloths (`cloth_ranges`): indices [k], one index, or a mask
                [cloth vertices].
            targets: Positions [k, 3], m, that they reach; None: they stay where they are.
            duration: Time in which they reach them, linearly, s; None: one time step.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        chosen = self._vertices("pin", vertices)
        here = np.empty((0, 3)) if targets is None else on_host("pin: targets", targets, len(chosen), self._core)
        self._core.pin(chosen, here, seconds("pin", duration))

    def set_targets(self, vertices: ArrayLike, positions: ArrayLike, duration: float | None = None) -> None:
        """Moves vertices that `pin` holds.

        The way there is linear in time. Like prescribed motion it is swept against everything in its way, and divided
        where cloth needs it.

        Args:
            vertices: As in `pin`.
            positions: Positions [k, 3], m, reached at the end of the duration and held.
            duration: Time in which they reach them, s, for example one control interval; None: one time step.

        Raises:
            ArrayError, SceneError: An argument does not fit, or `pin` does not hold a vertex. Nothing has changed.
        """
        chosen = self._vertices("set_targets", vertices)
        targets = on_host("set_targets: positions", positions, len(chosen), self._core)
        self._core.set_targets(chosen, targets, seconds("set_targets", duration))

    def release(self, vertices: ArrayLike) -> None:
        """Lets go of vertices that pins or attachments hold, also those of the scene. They keep their velocity.

        Args:
            vertices: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        self._core.release(self._vertices("release", vertices))

    def attach(self, vertices: ArrayLike, obstacle: Obstacle | int | str) -> None:
        """Fixes cloth vertices to the nearest points of an obstacle's triangles, at their present offset.

        Args:
            vertices: As in `pin`.
            obstacle: A mesh or a box of the scene: handle, index or name.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        self._core.attach(self._vertices("attach", vertices), self._obstacle("attach", obstacle))

    def set_obstacle_pose(
        self,
        obstacle: Obstacle | int | str,
        translation: VectorLike = (0, 0, 0),
        rotation: ArrayLike = (1, 0, 0, 0),
        duration: float | None = None,
    ) -> None:
        """Moves an obstacle to x -> rotation x + translation.

        x are its vertices as the scene has them before any motion, or as `set_obstacle_vertices` left them.
        The way there is linear in time, rotation by the shorter arc, and swept as prescribed motion is. It ends the
        obstacle's own rigid motion; a character's animation goes on.

        Args:
            obstacle: Handle, index or name.
            translation: Vector [3], m.
            rotation: Unit quaternion [4]: w, x, y, z.
            duration: Time in which the pose is reached, s; None: one time step.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        self._core.set_obstacle_pose(
            self._obstacle("set_obstacle_pose", obstacle),
            vector("set_obstacle_pose: translation", translation),
            quaternion("set_obstacle_pose: rotation", rotation),
            seconds("set_obstacle_pose", duration),
        )

    def set_obstacle_vertices(
        self, obstacle: Obstacle | int | str, positions: ArrayLike, duration: float | None = None
    ) -> None:
        """Moves the vertices of an obstacle that is a mesh. It ends the obstacle's own motion.

        Args:
            obstacle: Handle, index or name.
            positions: Positions [vertices of the obstacle, 3], m.
            duration: Time in which they are reached, linearly, s; None: one time step.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        index = self._obstacle("set_obstacle_vertices", obstacle)
        first, last = self.obstacle_ranges[index]
        moved = on_host("set_obstacle_vertices: positions", positions, last - first, self._core)
        self._core.set_obstacle_vertices(index, moved, seconds("set_obstacle_vertices", duration))

    def set_force(self, vertices: ArrayLike, forces: ArrayLike) -> None:
        """Applies forces to cloth vertices from the next step on, until they are set anew; zero ends them.

        Args:
            vertices: As in `pin`.
            forces: Forces [k, 3], or one [3] for all of them, N.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        chosen = self._vertices("set_force", vertices)
        given = device_vectors("set_force: forces", spread(forces, len(chosen)), len(chosen), self._core)
        self._core.set_force(chosen, given)

    @property
    def gravity(self) -> Vector:
        """Gravity [3], m/s^2. An assignment holds from the next step on."""
        x, y, z = self._core.gravity()
        return x, y, z

    @gravity.setter
    def gravity(self, value: VectorLike) -> None:
        self._core.set_gravity(vector("gravity", value))

    @property
    def wind(self) -> Vector:
        """Velocity of the air [3], m/s. An assignment holds from the next step on; without wind it is a SceneError."""
        x, y, z = self._core.wind()
        return x, y, z

    @wind.setter
    def wind(self, value: VectorLike) -> None:
        self._core.set_wind(vector("wind", value))

    def set_pressure(self, cloth: Cloth | int | str, pressure: float) -> None:
        """Sets the pressure inside a closed cloth from the next step on.

        Args:
            cloth: Handle, number or name of the cloth.
            pressure: Above that outside, Pa; it pushes along the normals of the faces.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        self._core.set_pressure(
            self._scene._index("set_pressure", cloth, self._scene.cloths), number("set_pressure: pressure", pressure)
        )

    def set_gas(self, cloth: Cloth | int | str, *, amount: float | None = None, ambient: float | None = None) -> None:
        """Sets the gas that a cloth encloses, or the pressure outside, from the next step on.

        Args:
            cloth: Handle, number or name of a cloth with gas.
            amount: Absolute pressure times volume, J; None: it stays.
            ambient: Absolute pressure outside, Pa; None: it stays.

        Raises:
            ArrayError, SceneError: An argument does not fit. Nothing has changed.
        """
        index = self._scene._index("set_gas", cloth, self._scene.cloths)
        now = self.gas.get(self._scene.cloths[index].name)
        if now is None:
            raise SceneError(f"set_gas: {self._scene.cloths[index].name} has no gas; give it some in the scene")
        self._core.set_gas(
            index,
            now.amount if amount is None else number("set_gas: amount", amount),
            now.ambient if ambient is None else number("set_gas: ambient", ambient),
        )

    def set_state(self, positions: ArrayLike, velocities: ArrayLike) -> None:
        """Replaces the positions and velocities of all cloth vertices.

        Args:
            positions: Positions [cloth vertices, 3], m.
            velocities: Velocities [cloth vertices, 3], m/s.

        Raises:
            ArrayError: The arrays do not fit. The state is unchanged.
            CollisionError: The positions intersect, the option `intersections` is not "exempt", and something in the
                scene can touch. The state is unchanged.
        """
        count = self.cloth_vertex_count
        x = device_vectors("set_state: positions", positions, count, self._core)
        v = device_vectors("set_state: velocities", velocities, count, self._core)
        if isinstance(x, np.ndarray) != isinstance(v, np.ndarray):  # one on the host, one on the device
            x = on_host("set_state: positions", positions, count, self._core)
            v = on_host("set_state: velocities", velocities, count, self._core)
        self._core.set_state(x, v)


def seconds(what: str, duration: float | None) -> float:
    """Returns a duration in s; 0 stands for one time step."""
    given = 0.0 if duration is None else number(f"{what}: duration", duration)
    if duration is not None and given <= 0:
        raise ArrayError(f"{what}: duration is {given} s; it must be positive")
    return given
