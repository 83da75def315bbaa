# SPDX-License-Identifier: Apache-2.0
"""Many simulations that advance together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from . import _core, plausibility
from .arrays import count, indices, integers, reals
from .background import Background
from .device_arrays import DeviceArray, brought
from .errors import ArrayError, CollisionError, Error, SceneError
from .options import overrides_of, signature
from .parts import Obstacle
from .scene import Scene, SimulatedScene
from .simulation import Simulation, Wrench, contact_rows, seconds
from .types import ArrayLike, Integers, PathLike, Reals, VectorLike

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import AccuracyLevel, BackendName, Overrides, Precision, StepReport

__all__ = ["Worlds"]


class Worlds:
    """Many simulations that advance together and do not touch each other.

    On a GPU the kernels of all worlds run in the same launches, on the CPU each thread takes worlds in turn. Every
    world ends in the same bits as a `Simulation` of its scene alone. A world is a `Simulation`: `worlds[3]` can be
    read, driven, saved and restored. What many worlds share is done for all of them at once by the methods of this
    class.

    A world whose step fails is frozen in the state before that step, and the others go on; see `frozen`, `error` and
    `reset`.

    Args:
        scenes: A scene for each world, or one scene of which there are `number` copies. A scene is a `cama.Scene`, or
            what `Scene.load` accepts.
        number: Number of copies.
        vary: Called with each world's own copy of its scene and the number of the world, from 0, before the worlds are
            made; it may change the copy: materials, positions, pins, wind, motions.
        backend: As of `Simulation`; all worlds share it.
        precision: As of `Simulation`.
        accuracy: As of `Simulation`.
        device: As of `Simulation`.
        threads: Threads of the host for all worlds; 0: as many as there are cores.
        overrides: Options of all worlds, as of `Simulation`.

    Raises:
        cama.Error: A world cannot be simulated; a subclass says why and names the world.

    Warns:
        cama.PlausibilityWarning: A value of the first world is hardly meant.
    """

    __slots__ = ("_core", "_worlds", "_first", "_cloth", "_background", "__weakref__")

    def __init__(
        self,
        scenes: Scene | PathLike | Sequence[Scene | PathLike],
        number: int | None = None,
        vary: Callable[[Scene, int], object] | None = None,
        backend: BackendName = "auto",
        precision: Precision | None = None,
        accuracy: AccuracyLevel | None = None,
        device: int = 0,
        threads: int = 0,
        **overrides: Unpack[Overrides],
    ) -> None:
        own = [_varied(scene, world, vary) for world, scene in enumerate(_listed(scenes, number))]
        given = dict(backend=backend, precision=precision, accuracy=accuracy, device=device, threads=threads)
        try:
            self._core = _core.Worlds([s._core for s in own], [overrides_of({**given, **overrides})])
        except CollisionError as problem:
            for scene in own:
                if scene.intersections():
                    plausibility.explain_collision(problem, scene)
                    break
            raise
        self._background = Background()
        self._worlds = [Simulation._of(self._core.world(w), scene, self._background) for w, scene in enumerate(own)]
        self._first = self._core.first_vertices()
        self._cloth = [world.cloth_vertex_count for world in self._worlds]
        plausibility.warn(plausibility.findings(own[0], self._worlds[0].options))

    def __reduce__(self) -> NoReturn:
        raise TypeError("Worlds are not pickled or copied: pickle the scenes, or save_checkpoint of each world")

    def __len__(self) -> int:
        return len(self._worlds)

    def __getitem__(self, world: int) -> Simulation:
        """Returns a world; it may be read, driven and restored, and also take steps alone."""
        return self._worlds[world]

    def __iter__(self) -> Iterator[Simulation]:
        return iter(self._worlds)

    def step(self, n: int = 1) -> None:
        """Computes n time steps in every world that is not frozen, with the GIL released.

        With `error` each world chooses the lengths of its own steps. `before_step` of the worlds is not called.

        Raises:
            BackendError: The device is lost. What a single world meets freezes it instead.
        """
        self._core.step(count("step: n", n))

    def step_async(self, n: int = 1) -> Future[None]:
        """Computes n time steps as `step` does, in the background; returns at once.

        Whatever asks these worlds meanwhile, in any thread, waits for the steps: what it reads is the state after them.

        Returns:
            A future, as of `Simulation.step_async`.
        """
        steps = count("step_async: n", n)
        return self._background.submit(self._core, lambda: self.step(steps))

    def step_frame(self) -> None:
        """Computes the steps up to the end of a frame in every world that is not frozen, as `step` does."""
        self._core.step_frame()

    @property
    def frozen(self) -> list[int]:
        """Worlds whose step failed; the others go on without them."""
        return self._core.frozen()

    def error(self, world: int) -> Error | None:
        """Returns the error that froze a world; None: it is not frozen."""
        try:
            self._core.raise_error(self._index("error", world))
        except Error as problem:
            return problem
        return None

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Returns worlds to the start of their scenes, with nothing driven. Those that are frozen go on.

        Args:
            worlds: One number, numbers [k], or a mask [worlds]; None: all.
        """
        self._core.reset(self._chosen("reset", worlds))

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
        chosen = self._chosen("set_state", worlds)
        self._core.set_state(
            chosen,
            self._rows("set_state: positions", positions, chosen),
            self._rows("set_state: velocities", velocities, chosen),
        )

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
        chosen = self._chosen("pin", worlds)
        rows = self._vertices("pin", vertices, chosen)
        here = [np.empty((0, 3))] * len(chosen)
        given = here if targets is None else self._vectors("pin: targets", targets, chosen, [len(row) for row in rows])
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
        chosen = self._chosen("set_targets", worlds)
        rows = self._vertices("set_targets", vertices, chosen)
        given = self._vectors("set_targets: positions", positions, chosen, [len(row) for row in rows])
        self._core.set_targets(chosen, rows, given, seconds("set_targets", duration))

    def release(self, vertices: Any, worlds: ArrayLike | None = None) -> None:
        """Lets go of vertices of worlds, as `Simulation.release`.

        Args:
            vertices: As in `pin`.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit; the text names the world. Nothing has changed in any.
        """
        chosen = self._chosen("release", worlds)
        self._core.release(chosen, self._vertices("release", vertices, chosen))

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
        chosen = self._chosen("set_force", worlds)
        rows = self._vertices("set_force", vertices, chosen)
        given = self._vectors("set_force: forces", forces, chosen, [len(row) for row in rows], one=True)
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
        chosen = self._chosen("set_obstacle_pose", worlds)
        self._core.set_obstacle_pose(
            chosen,
            self._obstacles("set_obstacle_pose", obstacle, chosen),
            self._each("set_obstacle_pose: translation", translation, chosen, 3),
            self._each("set_obstacle_pose: rotation", rotation, chosen, 4),
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
        chosen = self._chosen("set_gravity", worlds)
        self._core.set_gravity(chosen, self._each("gravity", gravity, chosen, 3))

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
        chosen = self._chosen("set_wind", worlds)
        self._core.set_wind(chosen, self._each("wind", velocity, chosen, 3))

    def force_on(self, what: Any, about: VectorLike = (0, 0, 0), worlds: ArrayLike | None = None) -> Wrench:
        """Returns what the cloth exerts in each of the worlds, as `Simulation.force_on`; every field is [k, 3].

        Args:
            what: An obstacle, as in `set_obstacle_pose`, or held cloth vertices, as in `pin`, but not one index.
            about: Points [k, 3], m, about which torque and angular impulse are taken, or one [3] for all.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit, or the option `forces` is not set.
        """
        chosen = self._chosen("force_on", worlds)
        point = self._each("force_on: about", about, chosen, 3)
        if isinstance(what, (Obstacle, str)) or np.ndim(what) == 0:
            vectors = self._core.force_on_obstacle(chosen, self._obstacles("force_on", what, chosen))
        else:
            vectors = self._core.force_on_vertices(chosen, self._vertices("force_on", what, chosen))
        force, torque, impulse, angular_impulse = vectors
        return Wrench(force, torque - np.cross(point, force), impulse, angular_impulse - np.cross(point, impulse))

    @property
    def contacts(self) -> list[Any]:
        """The contacts of each world's last step, as `Simulation.contacts`."""
        every = np.arange(len(self), dtype=np.int32)
        return [
            contact_rows(columns, bool(world.options["forces"]))
            for world, columns in zip(self._worlds, self._core.contacts(every))
        ]

    @property
    def positions(self) -> Any:
        """Positions [worlds, vertices, 3], m; a list of arrays [vertices, 3] where the worlds' sizes differ."""
        return self._by_world(self._core.positions())

    @property
    def velocities(self) -> Any:
        """Velocities, m/s, as `positions`."""
        return self._by_world(self._core.velocities())

    @property
    def forces(self) -> Any:
        """Forces of the cloth on what is prescribed, N, as `Simulation.forces`, in the shape of `positions`."""
        return self._by_world(self._core.forces())

    @property
    def impulses(self) -> Any:
        """Impulses of the cloth on what is prescribed, N s, as `Simulation.impulses`, in the shape of `positions`."""
        return self._by_world(self._core.impulses())

    @property
    def device_positions(self) -> DeviceArray:
        """Positions [worlds, vertices, 3], m, on the device, gathered there in memory of their own; see `DeviceArray`.

        Raises:
            SceneError: The worlds' sizes differ; use `device_positions` of each world.
            BackendError: The backend is "opencl", whose memory other libraries cannot read; use `positions`.
        """
        return self._on_device("device_positions", self._core.device_positions)

    @property
    def device_velocities(self) -> DeviceArray:
        """Velocities [worlds, vertices, 3], m/s, on the device, as `device_positions`."""
        return self._on_device("device_velocities", self._core.device_velocities)

    @property
    def device_forces(self) -> DeviceArray:
        """`forces` [worlds, vertices, 3], N, on the device, as `device_positions`."""
        return self._on_device("device_forces", self._core.device_forces)

    def _on_device(self, what: str, gather: Callable[[], _core.LentArray]) -> DeviceArray:
        if len(set(np.diff(self._first))) > 1:
            raise SceneError(f"{what}: the worlds have different numbers of vertices; use {what} of each world")
        return DeviceArray._of(gather())

    @property
    def times(self) -> Reals:
        """Simulated time [worlds], s."""
        return np.array([world.time for world in self._worlds])

    @property
    def reports(self) -> list[StepReport]:
        """What the last step of each world did, as `Simulation.report`; milliseconds are those of all worlds."""
        return [world.report for world in self._worlds]

    @property
    def launches(self) -> int:
        """Launches on the device since the start, of all worlds together; 0 where they do not share a device."""
        return self._core.launches()

    def __repr__(self) -> str:
        first = self._worlds[0]
        return f"<cama.Worlds: {len(self)} of {first.scene.name!r} on {first.backend}, {len(self.frozen)} frozen>"

    def _index(self, what: str, world: int) -> int:
        chosen = self._chosen(what, world)
        if len(chosen) != 1:
            raise ArrayError(f"{what}: {len(chosen)} worlds, expected one")
        return int(chosen[0])

    def _chosen(self, what: str, worlds: ArrayLike | None) -> Integers:
        if worlds is None:
            return np.arange(len(self), dtype=np.int32)
        array = np.asarray(worlds)
        if array.dtype.kind == "b":
            if array.shape != (len(self),):
                raise ArrayError(f"{what}: worlds: a mask of shape {list(array.shape)}, expected [{len(self)}]")
            return np.flatnonzero(array).astype(np.int32)
        chosen = integers(f"{what}: worlds", array.reshape(1) if array.ndim == 0 else array, (None,))
        for world in chosen:
            if not 0 <= world < len(self):
                raise ArrayError(f"{what}: world {world} is out of range; there are {len(self)} worlds, from 0")
        if len(np.unique(chosen)) != len(chosen):
            raise ArrayError(f"{what}: worlds: a world is named twice")
        return chosen

    def _rows(self, what: str, values: Any, chosen: Integers) -> list[Reals]:
        return self._vectors(what, values, chosen, [self._cloth[w] for w in chosen], same=False)

    def _vectors(
        self, what: str, values: Any, chosen: Integers, rows: list[int], same: bool = True, one: bool = False
    ) -> list[Reals]:
        """Returns vectors [rows[i], 3] of each world. same: one array may be for all worlds; one: also one vector."""
        given = brought(what, values, self._worlds[0]._core)
        dimensions = _dimensions(given)
        if one and dimensions == 1 and len(given) == 3:
            vector = reals(what, given, (3,))
            return [np.ascontiguousarray(np.broadcast_to(vector, (n, 3))) for n in rows]
        whole = _checked(given, rows)
        if whole is not None:
            return list(whole)
        if same and dimensions == 2:
            given = [given] * len(chosen)
        elif dimensions < 1 or len(given) != len(chosen):
            found = "no row for each world" if dimensions < 1 else f"of {len(given)} worlds"
            raise ArrayError(f"{what}: {found}, expected {len(chosen)}")
        return [reals(f"{what} of world {world}", row, (n, 3)) for world, row, n in zip(chosen, given, rows)]

    def _vertices(self, what: str, vertices: Any, chosen: Integers) -> list[Integers]:
        """Returns the indices of each world's vertices."""
        if _dimensions(vertices) < 2:
            if len(chosen) and len({self._cloth[world] for world in chosen}) == 1:
                name = f"{what}: vertices of world {chosen[0]}"
                return [indices(name, vertices, self._cloth[chosen[0]])] * len(chosen)
            vertices = [vertices] * len(chosen)
        elif len(vertices) != len(chosen):
            raise ArrayError(f"{what}: vertices: of {len(vertices)} worlds, expected {len(chosen)}")
        return [
            indices(f"{what}: vertices of world {world}", row, self._cloth[world])
            for world, row in zip(chosen, vertices)
        ]

    def _obstacles(self, what: str, obstacle: Obstacle | int | str, chosen: Integers) -> Integers:
        """Returns the index of the obstacle in each world. A handle stands for its index in its scene."""
        found = []
        for world in chosen:
            scene = self._worlds[world]._scene
            own = obstacle
            if isinstance(obstacle, Obstacle) and not any(obstacle is o for o in scene.obstacles):
                own = obstacle.name
            try:
                found.append(scene._index(what, own, scene.obstacles))
            except Error as problem:
                raise type(problem)(f"world {world}: {problem}") from None
        return np.array(found, np.int32)

    def _each(self, what: str, values: Any, chosen: Integers, width: int) -> Reals:
        """Returns [worlds, width] from that, or from one [width] for all worlds."""
        given = brought(what, values, self._worlds[0]._core)
        if _dimensions(given) == 1:
            one = reals(what, given, (width,))
            return np.ascontiguousarray(np.broadcast_to(one, (len(chosen), width)))
        return reals(what, given, (len(chosen), width))

    def _by_world(self, rows: Reals) -> Any:
        sizes = np.diff(self._first)
        if (sizes == sizes[0]).all():
            return rows.reshape(len(self), sizes[0], 3)
        return np.split(rows, self._first[1:-1])


Worlds.__init__.__signature__ = signature(Worlds.__init__)  # type: ignore[attr-defined]


def _checked(values: Any, rows: list[int]) -> Reals | None:
    """Returns an array [worlds, n, 3] in which nothing is wrong; None: the worlds have to be looked at one by one."""
    if not (isinstance(values, np.ndarray) and rows and values.shape == (len(rows), rows[0], 3)):
        return None
    if values.dtype.kind not in "fiu" or len(set(rows)) > 1:
        return None
    whole = np.ascontiguousarray(values, dtype=np.float64)
    return whole if np.isfinite(whole).all() else None


def _dimensions(values: Any) -> int:
    """Number of dimensions; of lists whose rows differ in length 2, or 3 where the rows are arrays of vectors."""
    try:
        return np.ndim(values)
    except ValueError:
        return 1 + max((_dimensions(row) for row in values), default=0)


def _listed(scenes: Scene | PathLike | Sequence[Scene | PathLike], number: int | None) -> list[Scene]:
    if isinstance(scenes, Sequence) and not isinstance(scenes, str):
        if number is not None:
            raise SceneError(
                "worlds: number is for copies of one scene; give a list of scenes, or one scene and a number"
            )
        return [scene if isinstance(scene, Scene) else Scene.load(scene) for scene in scenes]
    scene = scenes if isinstance(scenes, Scene) else Scene.load(scenes)
    copies = count("worlds: number", 1 if number is None else number)
    return [scene] * copies


def _varied(scene: Scene, world: int, vary: Callable[[Scene, int], object] | None) -> SimulatedScene:
    if vary is None:
        return SimulatedScene.of(scene)
    own = scene.copy()
    vary(own, world)
    return SimulatedScene.of(own)
