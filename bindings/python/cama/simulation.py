# SPDX-License-Identifier: Apache-2.0
"""Simulations of scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from . import _core, plausibility
from .arrays import count
from .background import Background
from .driving import Driving
from .errors import CollisionError, MeshError, SceneError
from .io import checkpoint
from .options import overrides_of, signature
from .results import Frame, GasState, Wrench
from .scene import Scene
from .simulated_scene import SimulatedScene
from .types import PathLike

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import AccuracyLevel, BackendName, Overrides, Precision
    from .viewing.live import Live

__all__ = ["Simulation", "Frame", "GasState", "Wrench"]

LONGEST_STEP = 0.1  # s that an error may choose
MOST_STEPS = 1e7  # of a frame
MOST_STRETCHED = 1e6  # sizes of its rest shape that a vertex may start away; more overflow single precision


def _check_extents(scene: Scene) -> None:
    """Raises MeshError for cloth that starts so far from its rest shape that its energy is no number."""
    for cloth in scene.cloths:
        if cloth.rest_shape == "start" or not len(cloth.material_vertices):
            continue
        vertices = cloth.vertices
        middle = np.median(vertices, axis=0)
        away = np.abs(vertices - middle).max(axis=1)
        if away.max() / MOST_STRETCHED > np.ptp(cloth.material_vertices, axis=0).max():
            raise MeshError(
                f"cloth {cloth.name!r}: vertex {away.argmax()} starts {away.max():.3g} m from the others, more than "
                f"{MOST_STRETCHED:,.0f} times the size of the rest shape; move it to its place, or mend the unit "
                "of the mesh or of its rest shape"
            )


class Simulation(Driving):
    """A simulation of one scene on one backend.

    Vertices are numbered through all cloths in order, then through all obstacles. Arrays are copies of the state.

    Args:
        scene: A `cama.Scene`, or what `Scene.load` accepts.
        backend: "auto", "cpu", "opencl" or "cuda".
        precision: "double", "mixed" (forces, matrix and residual in double precision, the solve in single precision
            with refinement) or "single"; None: the accuracy level's.
        accuracy: One of `cama.accuracy_levels()`. The level determines the time step and all other options except
            `backend`, `device` and `threads`. If given, the scene's `options` are not used; None: the level in the
            scene's `options`, else "production".
        device: Index of the backend's device.
        threads: Threads of the CPU backend; 0: one for every 1,000 triangles, at most one for every core.
        overrides: Any option of `cama.option_table()` in place of the level's and the scene's, for example
            error="0.1 %", time_step=1/400 (s), tolerance=1e-6, preconditioner="jacobi", intersections="untangle" or
            paper={"search": "fronts"}.

    Raises:
        cama.Error: The scene cannot be simulated; a subclass says why, before any computation.
        CollisionError: The scene starts with intersections, and `intersections` is "reject", or "untangle" failed.

    Warns:
        cama.PlausibilityWarning: A value is hardly meant, for example a length in centimetres.
    """

    __slots__ = ("_frame", "_parts", "_before_step", "_background", "__weakref__")  # other fields are an AttributeError

    def __init__(
        self,
        scene: Scene | PathLike,
        backend: BackendName = "auto",
        precision: Precision | None = None,
        accuracy: AccuracyLevel | None = None,
        device: int = 0,
        threads: int = 0,
        **overrides: Unpack[Overrides],
    ) -> None:
        given_scene = scene if isinstance(scene, Scene) else Scene.load(scene)
        _check_extents(given_scene)
        own = SimulatedScene.of(given_scene)
        given = dict(backend=backend, precision=precision, accuracy=accuracy, device=device, threads=threads)
        try:
            core = _core.Simulation(own._core, overrides_of({**given, **overrides}))
        except CollisionError as problem:
            plausibility.explain_collision(problem, own)
            raise
        super().__init__(core, own)
        self._begin()
        plausibility.warn(plausibility.findings(self.scene, self._core.options()))

    def _begin(self) -> None:
        self._frame = 0
        self._parts: dict[str, str] | None = None
        self._before_step: Callable[[Simulation], object] | None = None
        self._background = Background()

    @classmethod
    def _of(cls, core: _core.Simulation, scene: SimulatedScene, background: Background) -> Simulation:
        """Wraps a simulation that exists, such as a world of `cama.Worlds`."""
        made = cls.__new__(cls)
        Driving.__init__(made, core, scene)
        made._begin()
        made._background = background
        return made

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Simulation is not pickled or copied: pickle its scene, or save_checkpoint and load_checkpoint"
        )

    def step(self, n: int = 1) -> None:
        """Computes n time steps with the GIL released. Ctrl-C stops between steps and keeps what was computed.

        A step that the solver cannot compute is undone and divided into shorter ones, down to 1/16 of the step;
        `report["retries"]` counts the failed attempts.

        Raises:
            SolverError: Shorter steps fail too. The state is that before the step.
            CollisionError: Obstacles pinch cloth with no way out. The state is that before the step.
        """
        steps = count("step: n", n)
        self._core.begin_interval()
        if self._before_step is None:
            self._core.step(steps)
            return
        for _ in range(steps):
            if self._before_step is not None:
                self._before_step(self)
            self._core.step(1)

    def step_async(self, n: int = 1) -> Future[None]:
        """Computes n time steps in the background, while Python goes on; returns at once.

        Whatever asks this simulation meanwhile, in any thread, waits for the steps: what it reads is the state after
        them. Several calls are done in order. `before_step` is called in the background.

        Returns:
            A future: `result()` waits and raises what `step` raises, `done()` says whether the steps are computed,
            `cancel()` gives up steps that have not begun.

        Raises:
            ArrayError: n is not a count.
            SceneError: `before_step` calls it, in steps in the background.
        """
        steps = count("step_async: n", n)
        return self._background.submit(self._core, lambda: self.step(steps))

    def step_frame(self) -> int:
        """Computes the steps of a frame, with `error` up to its end, as `step` does; returns their number.

        SceneError for a frame time in which no simulation would come to the end of a frame.
        """
        self._check_frame()
        if not self.error:
            self.step(self.steps_per_frame)
            return self.steps_per_frame
        before = self.step_count
        self._core.begin_interval()
        while True:
            if self._before_step is not None:
                self._before_step(self)
            self._core.step(1)
            if self._core.frame_ended():
                return self.step_count - before

    def _check_frame(self) -> None:
        """Raises SceneError if a frame takes more than MOST_STEPS."""
        step = LONGEST_STEP if self.error else self.time_step
        steps = self.scene.seconds_per_frame / step
        if steps > MOST_STEPS:
            raise SceneError(
                f"frame_time: a frame of {self.scene.seconds_per_frame:.4g} s takes {steps:.2g} steps of {step:.4g} s; "
                "give the time between two frames in seconds, such as 1/60, or longer steps"
            )

    def frames(self, n: int | None = None, audit: bool = True) -> Iterator[Frame]:
        """Iterates over frames, each `steps_per_frame` steps, or as many as `error` asks for.

        Args:
            n: Number of frames; None: the scene's.
            audit: Whether to count intersections in every frame, with exact predicates.
        """
        for _ in range(self.scene.frames if n is None else count("frames: n", n)):
            self.step_frame()
            self._frame += 1
            report = self.report
            yield Frame(
                self._frame,
                self.time,
                self.positions,
                report["contacts"],
                self.count_intersections() if audit else -1,
                report,
            )

    @property
    def before_step(self) -> Callable[[Simulation], object] | None:
        """A function that `step` calls with this simulation before every time step; None: none.

        It may read the state and drive: set targets, poses, forces, gravity and wind, pin and release. An exception
        from it ends `step`; what was computed stays.
        """
        return self._before_step

    @before_step.setter
    def before_step(self, value: Callable[[Simulation], object] | None) -> None:
        if value is not None and not callable(value):
            raise TypeError(f"before_step: {value!r} cannot be called")
        self._before_step = value

    def save_checkpoint(self, path: PathLike) -> None:
        """Writes all that later steps depend on to an HDF5 file, from which `load_checkpoint` continues.

        What was driven is in it; `before_step` is not.

        The file is written completely or not at all. Raises FileError.
        """
        checkpoint.write(path, self)

    def scene_parts(self) -> dict[str, str]:
        """Returns {part: digest} of the scene, by which a checkpoint recognizes its scene."""
        if self._parts is None:
            self._parts = checkpoint.parts_of(self.scene)
        return self._parts

    def load_checkpoint(self, path: PathLike, changed_scene: bool = False) -> list[str]:
        """Continues from a checkpoint of the same scene at the same resolution.

        With the same options, on any backend, the steps are bit by bit those of the run that wrote the checkpoint. If
        an error is raised, nothing has changed.

        Args:
            path: The file, or the folder that `cama run` wrote.
            changed_scene: Whether all but meshes and masses may differ from the checkpoint's scene.

        Returns:
            Texts that name the options that differ from the checkpoint's, the time step among them; empty if none does.

        Raises:
            FileError: The file is not a checkpoint.
            SceneError: The checkpoint is of another scene, or damaged.
            CollisionError: Cloth intersects.
        """
        fields, options, parts = checkpoint.read(path)
        if not changed_scene:
            checkpoint.check_scene(self, parts)
        self._core.restore(fields)
        self._frame = (
            self.step_count // self.steps_per_frame
            if self.steps_per_frame
            else round(self.time / self.scene.seconds_per_frame)
        )
        return checkpoint.differences(self, options)

    def show(self, host: str = "127.0.0.1", port: int | None = None) -> Live:
        """Opens a page in which this simulation is run, looked at and dragged, until it is closed.

        The page's own thread computes while it runs; the simulation may be read at any time, and stepped while the
        page is paused. In a notebook the page is the value of the cell.

        Args:
            host: Address to serve at; "0.0.0.0": reachable by everyone in the network.
            port: Port to serve at; None: the first free one from 8080 on.

        Returns:
            A viewer: its `url` is the page's address, `run()`, `pause()` and `update()` do what they say, and `close()`
            or the end of a `with` block ends it.

        Raises:
            BackendError: viser is not installed, or the address cannot be served.
        """
        from .viewing.live import Live

        return Live(self, host, port)

    def __repr__(self) -> str:
        return (
            f"<cama.Simulation of {self.scene.name!r} on {self.backend}: step {self.step_count}, time {self.time:g} s>"
        )


Simulation.__init__.__signature__ = signature(Simulation.__init__)  # type: ignore[attr-defined]
