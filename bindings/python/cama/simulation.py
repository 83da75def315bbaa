# SPDX-License-Identifier: Apache-2.0
"""Simulations of scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import numpy.typing as npt

from . import _core, plausibility
from .arrays import count, indices, number, quaternion, vector
from .background import Background
from .collision import UntangleReport
from .device_arrays import DeviceArray, on_host, spread
from .device_arrays import vectors as device_vectors
from .errors import ArrayError, CollisionError, MeshError, SceneError
from .io import checkpoint
from .options import overrides_of, signature
from .parts import Cloth, Obstacle
from .rigid import RigidPose
from .scene import Scene, SimulatedScene
from .types import ArrayLike, Integers, PathLike, Reals, Vector, VectorLike

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._core import Energy
    from ._options import AccuracyLevel, BackendName, Overrides, Precision, StepReport
    from .viewing.live import Live

__all__ = ["Simulation", "Frame", "GasState", "Wrench"]

CONTACT = np.dtype(
    [
        ("vertices", np.int32, 4),
        ("weights", np.float64, 4),
        ("normal", np.float64, 3),
        ("distance", np.float64),
        ("kind", np.int32),
    ]
)
LONGEST_STEP = 0.1  # s that an error may choose
MOST_STEPS = 1e7  # of a frame
MOST_STRETCHED = 1e6  # sizes of its rest shape that a vertex may start away; more overflow single precision
FORCES = [("normal_force", np.float64), ("tangential_force", np.float64, 3)]  # with the option forces


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


@dataclass(frozen=True)
class GasState:
    """The gas that a cloth encloses, as `Simulation.gas` has it."""

    volume: float  #: m^3
    pressure: float  #: above that outside, Pa
    amount: float  #: absolute pressure times volume, J
    ambient: float  #: absolute pressure outside, Pa


@dataclass(frozen=True)
class Wrench:
    """What cloth exerts, as `Simulation.force_on` returns it; of `Worlds.force_on` each is [worlds, 3]."""

    force: Reals  #: [3] N, mean over the last step
    torque: Reals  #: [3] N m, mean over the last step
    impulse: Reals  #: [3] N s, over the last call of `step`
    angular_impulse: Reals  #: [3] N m s, over the last call of `step`


@dataclass
class Frame:
    """One recorded moment of a simulation."""

    index: int  #: frames since the start, 1 for the first that was computed
    time: float  #: s
    positions: Reals = field(repr=False)  #: [vertices, 3] m, cloths then obstacles
    contacts: int  #: contacts in the last step's matrix
    intersections: int  #: edges through faces, -1 where not audited
    report: StepReport = field(repr=False)  #: of the last step, see `Simulation.report`


class Simulation:
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

    __slots__ = (
        "_core",
        "_scene",
        "_frame",
        "_parts",
        "_before_step",
        "_background",
        "__weakref__",
    )  # other fields are an AttributeError

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
        self._scene = SimulatedScene.of(given_scene)
        self._begin()
        given = dict(backend=backend, precision=precision, accuracy=accuracy, device=device, threads=threads)
        try:
            self._core = _core.Simulation(self.scene._core, overrides_of({**given, **overrides}))
        except CollisionError as problem:
            plausibility.explain_collision(problem, self.scene)
            raise
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
        made._core = core
        made._scene = scene
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
    def scene(self) -> Scene:
        """The scene that is simulated, read-only: an assignment, which could have no effect, raises SceneError."""
        return self._scene

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

    def rigid_pose(self, obstacle: Obstacle | int | str) -> RigidPose:
        """Returns where a rigid obstacle is, and how it moves.

        Args:
            obstacle: Handle, index or name.

        Raises:
            SceneError: The obstacle is not there, or not rigid.
        """
        return RigidPose(*(np.array(v) for v in self._core.rigid_pose(self._obstacle("rigid_pose", obstacle))))

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

    @property
    def pressures(self) -> Reals:
        """Pressure inside each cloth above that outside [cloths], Pa."""
        return np.array(self._core.pressures())

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

    @property
    def gas(self) -> dict[str, GasState]:
        """State of the gas in each cloth that encloses some, by the name of the cloth: {"balloon": GasState}."""
        cloths = self._scene.cloths
        return {cloths[row[0]].name: GasState(*row[1:]) for row in self._core.gas()}

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

    @property
    def plastic_curvature(self) -> Reals:
        """Curvature that each triangle of cloth keeps [triangles, 3], 1/m: along warp, along weft and twice the twist.

        The triangles are those of all cloths in order. Zero where the material has no yield curvature.
        """
        return self._core.plastic_curvature()

    def _vertices(self, what: str, vertices: ArrayLike) -> Integers:
        return indices(f"{what}: vertices", vertices, self.cloth_vertex_count)

    def _obstacle(self, what: str, obstacle: Obstacle | int | str) -> int:
        return self._scene._index(what, obstacle, self._scene.obstacles)

    @property
    def step_count(self) -> int:
        """Number of steps computed."""
        return self._core.step_count()

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._core.time()

    @property
    def time_step(self) -> float:
        """Time step, s: the caller's, the scene's or the accuracy level's; with `error` that of the last step."""
        return self._core.time_step()

    @property
    def error(self) -> float:
        """Error of the motion in a frame of 1/60 s that time steps are chosen by, m; 0: all have one length."""
        return self._core.error()

    @property
    def steps_per_frame(self) -> int:
        """Number of steps between two recorded frames, which fill the scene's `seconds_per_frame`; 0: it varies."""
        return 0 if self.error else max(1, round(self.scene.seconds_per_frame / self.time_step))

    @property
    def chosen_options(self) -> list[dict[str, str]]:
        """The options that trade accuracy for time, and who chose them.

        A list of dicts with name, value (text), origin ("level", "scene" or "user") and trades.
        """
        return [dict(zip(("name", "value", "origin", "trades"), row)) for row in self._core.chosen_options()]

    @property
    def vertex_count(self) -> int:
        """Number of cloth and obstacle vertices."""
        return self._core.vertex_count()

    @property
    def cloth_vertex_count(self) -> int:
        """Number of cloth vertices."""
        return self._core.cloth_vertex_count()

    @property
    def cloth_triangle_count(self) -> int:
        """Number of cloth triangles, which come first in `faces`."""
        return self._core.cloth_triangle_count()

    @property
    def cloth_ranges(self) -> list[tuple[int, int]]:
        """Vertex ranges [(first, last)] of the cloths; last is excluded."""
        return self._core.cloth_ranges()

    @property
    def obstacle_ranges(self) -> list[tuple[int, int]]:
        """Vertex ranges [(first, last)] of the obstacles; last is excluded."""
        return self._core.obstacle_ranges()

    @property
    def positions(self) -> Reals:
        """Positions [vertices, 3], m."""
        return self._core.positions()

    @property
    def velocities(self) -> Reals:
        """Velocities [vertices, 3], m/s."""
        return self._core.velocities()

    @property
    def device_positions(self) -> DeviceArray:
        """Positions [vertices, 3], m, on the device, as they are now; see `DeviceArray`.

        Raises:
            BackendError: The backend is "opencl", whose memory other libraries cannot read; use `positions`.
        """
        return DeviceArray._of(self._core.device_positions())

    @property
    def device_velocities(self) -> DeviceArray:
        """Velocities [vertices, 3], m/s, on the device, as `device_positions`."""
        return DeviceArray._of(self._core.device_velocities())

    @property
    def device_forces(self) -> DeviceArray:
        """`forces` [vertices, 3], N, on the device, as `device_positions`.

        Raises:
            SceneError: The option `forces` is not set.
            BackendError: The backend is "opencl".
        """
        return DeviceArray._of(self._core.device_forces())

    @property
    def faces(self) -> Integers:
        """Triangles [triangles, 3], those of cloth first."""
        return self._core.faces()

    @property
    def masses(self) -> Reals:
        """Masses [cloth vertices], kg."""
        return self._core.masses()

    @property
    def contacts(self) -> npt.NDArray[np.void]:
        """The contacts of the last step, a structured array with one row for each.

        Fields: vertices [4] (a vertex and a face, or two edges), weights [4] (signed barycentric), normal [3], distance
        in m, kind (0: vertex and face, 1: two edges). With the option `forces` also normal_force, N, along the normal,
        and tangential_force [3], N, the friction, both on the side with positive weights; impacts are not among them.
        """
        return contact_rows(self._core.contacts(), bool(self._core.options()["forces"]))

    @property
    def forces(self) -> Reals:
        """Forces [vertices, 3] of the cloth on what is prescribed, N, mean over the last step.

        At an obstacle's vertex it is the force on the obstacle, at a pinned or attached vertex the force on what holds
        it. At a free vertex it is zero, but for momentum that nothing received: what the certified commit took from it
        against other cloth, and what BDF2 does not carry on after a blow. Over all vertices the forces are those that
        the cloth lost.

        Raises:
            SceneError: The option `forces` is not set.
        """
        return self._core.forces()

    @property
    def impulses(self) -> Reals:
        """Impulses [vertices, 3] of the cloth on what is prescribed, N s, over the last call of `step`.

        Raises:
            SceneError: The option `forces` is not set.
        """
        return self._core.impulses()

    def force_on(self, what: Obstacle | int | str | ArrayLike, about: VectorLike = (0, 0, 0)) -> Wrench:
        """Returns what the cloth exerts on an obstacle, or on what holds vertices of it.

        Args:
            what: An obstacle (handle, index or name), or held cloth vertices: an array of indices or a mask, for
                example those of a pin.
            about: Point [3], m, about which torque and angular impulse are taken, for example where the obstacle is.

        Raises:
            ArrayError, SceneError: An argument does not fit, or the option `forces` is not set.
        """
        point = np.array(vector("force_on: about", about))
        if isinstance(what, (Obstacle, str)) or np.ndim(what) == 0:
            vectors = self._core.force_on_obstacle(self._obstacle("force_on", what))
        else:
            vectors = self._core.force_on_vertices(self._vertices("force_on", what))
        force, torque, impulse, angular_impulse = (np.array(v) for v in vectors)
        return Wrench(force, torque - np.cross(point, force), impulse, angular_impulse - np.cross(point, impulse))

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

    @property
    def report(self) -> StepReport:
        """What the last step did.

        A dict with contacts, candidates, impacts, iterations, residual, newton_iterations, newton_residual, retries,
        truncated, milliseconds and more.
        """
        return self._core.report()

    @property
    def timings(self) -> dict[str, float]:
        """Times of the last step {stage: ms}; nested stages are named "outer/inner"."""
        return stage_paths(self._core.timings())

    @property
    def streams(self) -> list[dict[str, Any]]:
        """The arrays on the device that outlive a stage: a list of dicts with name, element, size and bytes."""
        return [dict(zip(("name", "element", "size", "bytes"), row)) for row in self._core.streams()]

    def explain(self) -> list[tuple[str, str]]:
        """Returns (stage, why this scene needs it) for every stage, in order."""
        return self._core.explain()

    def energy(self) -> Energy:
        """Returns the kinetic, stretching, bending and gravity energy, J."""
        return self._core.energy()

    @property
    def untangled(self) -> UntangleReport:
        """What untangling did to the start; 0 rounds if there was nothing to do or no untangling was asked for."""
        return UntangleReport(**self._core.untangled())

    @property
    def min_gap(self) -> float:
        """Smallest distance over the candidate pairs of the last step, m; inf if there are none."""
        return self._core.min_gap()

    @property
    def max_strain(self) -> float:
        """Largest principal stretch minus one."""
        return self._core.max_strain()

    def count_intersections(self) -> int:
        """Counts edges that pass through faces, with exact predicates; pairs of obstacles are left out."""
        return self._core.count_intersections()

    @property
    def state_hash(self) -> str:
        """A hash of the bits of cloth positions and velocities, 16 hexadecimal digits."""
        return f"{self._core.state_hash():016x}"

    @property
    def peak_memory_bytes(self) -> int:
        """Largest amount of device memory that this simulation held at once."""
        return self._core.peak_memory_bytes()

    @property
    def backend(self) -> str:
        """Name of the backend in use."""
        return self._core.backend()[0]

    @property
    def device(self) -> str:
        """Name of the hardware in use."""
        return self._core.backend()[1]

    @property
    def options(self) -> dict[str, Any]:
        """All options in force, by name; those of the paper are "paper.NAME"."""
        return self._core.options()

    def __repr__(self) -> str:
        return (
            f"<cama.Simulation of {self.scene.name!r} on {self.backend}: step {self.step_count}, time {self.time:g} s>"
        )


Simulation.__init__.__signature__ = signature(Simulation.__init__)  # type: ignore[attr-defined]


def seconds(what: str, duration: float | None) -> float:
    """Returns a duration in s; 0 stands for one time step."""
    given = 0.0 if duration is None else number(f"{what}: duration", duration)
    if duration is not None and given <= 0:
        raise ArrayError(f"{what}: duration is {given} s; it must be positive")
    return given


def contact_rows(columns: Sequence[npt.NDArray[Any]], forces: bool) -> npt.NDArray[np.void]:
    """Returns contacts as a structured array, as `Simulation.contacts`."""
    rows = np.empty(len(columns[0]), CONTACT.descr + FORCES if forces else CONTACT)
    for name, column in zip(rows.dtype.names or (), columns):
        rows[name] = column
    return rows


def stage_paths(rows: Iterable[tuple[str, int, float]]) -> dict[str, float]:
    """Turns rows (name, depth, ms) in the order of the pipeline into {"outer/inner": ms}.

    The pipeline that surrounds all stages is left out. Equal names beside each other are added.
    """
    rows = list(rows)
    if len(rows) > 1 and sum(depth == 0 for _, depth, _ in rows) == 1:
        rows = [(name, depth - 1, milliseconds) for name, depth, milliseconds in rows[1:]]
    result: dict[str, float] = {}
    path: list[str] = []
    for name, depth, milliseconds in rows:
        path[depth:] = [name]
        key = "/".join(path)
        result[key] = result.get(key, 0.0) + milliseconds
    return result
