# SPDX-License-Identifier: Apache-2.0
"""Many simulations that advance together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from . import _core, plausibility
from .arrays import count, integers, reals
from .errors import ArrayError, CollisionError, Error, SceneError
from .options import overrides_of, signature
from .scene import Scene, SimulatedScene
from .simulation import Simulation
from .types import ArrayLike, Integers, PathLike, Reals

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

    __slots__ = ("_core", "_worlds", "_first", "__weakref__")

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
        self._worlds = [Simulation._of(self._core.world(w), scene) for w, scene in enumerate(own)]
        self._first = self._core.first_vertices()
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

    @property
    def positions(self) -> Any:
        """Positions [worlds, vertices, 3], m; a list of arrays [vertices, 3] where the worlds' sizes differ."""
        return self._by_world(self._core.positions())

    @property
    def velocities(self) -> Any:
        """Velocities, m/s, as `positions`."""
        return self._by_world(self._core.velocities())

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
        if len(values) != len(chosen):
            raise ArrayError(f"{what}: of {len(values)} worlds, expected {len(chosen)}")
        return [
            reals(f"{what} of world {world}", rows, (self._worlds[world].cloth_vertex_count, 3))
            for world, rows in zip(chosen, values)
        ]

    def _by_world(self, rows: Reals) -> Any:
        sizes = np.diff(self._first)
        if (sizes == sizes[0]).all():
            return rows.reshape(len(self), sizes[0], 3)
        return np.split(rows, self._first[1:-1])


Worlds.__init__.__signature__ = signature(Worlds.__init__)  # type: ignore[attr-defined]


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
