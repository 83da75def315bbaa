# SPDX-License-Identifier: Apache-2.0
"""Many simulations that advance together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from . import _core, plausibility
from .arrays import count
from .background import Background
from .device_arrays import DeviceArray
from .errors import CollisionError, Error, SceneError
from .options import overrides_of, signature
from .parts import Obstacle
from .results import Wrench, contact_rows
from .simulation import Simulation
from .types import ArrayLike, PathLike, Reals, VectorLike
from .world_arguments import scenes_of
from .world_driving import DrivingWorlds

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import AccuracyLevel, BackendName, Overrides, Precision, StepReport
    from .scene import Scene

__all__ = ["Worlds"]


class Worlds(DrivingWorlds):
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

    __slots__ = ("_first", "_background", "__weakref__")

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
        own = scenes_of(scenes, number, vary)
        given = dict(backend=backend, precision=precision, accuracy=accuracy, device=device, threads=threads)
        try:
            core = _core.Worlds([s._core for s in own], [overrides_of({**given, **overrides})])
        except CollisionError as problem:
            for scene in own:
                if scene.intersections():
                    plausibility.explain_collision(problem, scene)
                    break
            raise
        self._background = Background()
        super().__init__(core, [Simulation._of(core.world(w), scene, self._background) for w, scene in enumerate(own)])
        self._first = core.first_vertices()
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

        Between these steps no world waits for another: on a GPU several in one call take less time than one by one.
        Ctrl-C ends the call within about half a second, or after a step that lasts longer; worlds that are not frozen
        have taken the same number of steps then.
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
            self._core.raise_error(self._arguments.index("error", world))
        except Error as problem:
            return problem
        return None

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Returns worlds to the start of their scenes, with nothing driven. Those that are frozen go on.

        Args:
            worlds: One number, numbers [k], or a mask [worlds]; None: all.
        """
        self._core.reset(self._arguments.chosen("reset", worlds))

    def force_on(self, what: Any, about: VectorLike = (0, 0, 0), worlds: ArrayLike | None = None) -> Wrench:
        """Returns what the cloth exerts in each of the worlds, as `Simulation.force_on`; every field is [k, 3].

        Args:
            what: An obstacle, as in `set_obstacle_pose`, or held cloth vertices, as in `pin`, but not one index.
            about: Points [k, 3], m, about which torque and angular impulse are taken, or one [3] for all.
            worlds: As in `pin`.

        Raises:
            ArrayError, SceneError: An argument does not fit, or the option `forces` is not set.
        """
        chosen = self._arguments.chosen("force_on", worlds)
        point = self._arguments.each("force_on: about", about, chosen, 3)
        if isinstance(what, (Obstacle, str)) or np.ndim(what) == 0:
            vectors = self._core.force_on_obstacle(chosen, self._arguments.obstacles("force_on", what, chosen))
        else:
            vectors = self._core.force_on_vertices(chosen, self._arguments.vertices("force_on", what, chosen))
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

    def _by_world(self, rows: Reals) -> Any:
        sizes = np.diff(self._first)
        if (sizes == sizes[0]).all():
            return rows.reshape(len(self), sizes[0], 3)
        return np.split(rows, self._first[1:-1])


Worlds.__init__.__signature__ = signature(Worlds.__init__)  # type: ignore[attr-defined]
