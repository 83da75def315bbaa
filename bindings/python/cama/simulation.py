# SPDX-License-Identifier: Apache-2.0
"""Running a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NoReturn, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core
from .arrays import count, reals
from .collision import UntangleReport
from .io import checkpoint
from .options import merged, values
from .scene import Scene
from .types import ArrayLike, Integers, PathLike, Reals

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._core import AccuracyLevel, BackendName, Energy, Overrides, Precision, StepReport

__all__ = ["Simulation", "Frame"]

CONTACT = np.dtype(
    [
        ("vertices", np.int32, 4),
        ("weights", np.float64, 4),
        ("normal", np.float64, 3),
        ("distance", np.float64),
        ("kind", np.int32),
    ]
)


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
    """Backend, state and pipeline of one scene.

    scene: a cama.Scene, or what `Scene.load` takes.  backend: "auto", "cpu", "opencl" or "cuda".
    accuracy: one of cama.accuracy_levels(): "preview", "interactive", "production", "accurate", "reference", "paper"; sets the time step and
    all that follows but backend, device and threads. None: the scene's `options`, else "production". Given, it sets the scene's options
    aside; single options in `overrides` come on top of either.
    precision: "double", "mixed" (forces, matrix and residual in double, the solve in single with refinement) or "single"; None: what
    the accuracy says.
    device: index.  threads: of the CPU backend, 0: one for every 1,000 triangles, at most all processors.
    overrides: single options, for example time_step (s, 0: the level's), integrator ("backward_euler", "bdf2"), newton_iterations, newton_tolerance, contact_refresh ("step", "iteration"),
    tolerance=1e-6, max_iterations, preconditioner="jacobi", solver="direct", assembly="algorithm1", search="fronts", commit, cubic_impacts,
    max_impact_passes, intersections ("reject", "exempt" or "untangle": what becomes of a start that intersects),
    pinch ("stop" or "release": what becomes of cloth that moving bodies pinch).

    Vertices are numbered through all cloths in order, then all obstacles. Arrays are copies of the state when asked for.
    Throws a subclass of cama.Error before any kernel runs if the scene cannot be simulated; CollisionError if it starts with
    intersections, unless the policy is "exempt" (start as it is) or "untangle" (move the cloth first) succeeds.
    """

    def __init__(
        self,
        scene: Union[Scene, PathLike],
        backend: BackendName = "auto",
        precision: Optional[Precision] = None,
        accuracy: Optional[AccuracyLevel] = None,
        device: int = 0,
        threads: int = 0,
        **overrides: Unpack[Overrides],
    ) -> None:
        self.scene = scene.copy() if isinstance(scene, Scene) else Scene.load(scene)
        chosen, self._of_scene = merged(self.scene.options, backend, precision, accuracy, device, threads, overrides)
        self._core = _core.Simulation(self.scene._core, chosen)
        self._frame = 0
        self._parts: Optional[dict[str, str]] = None

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Simulation is not pickled or copied: pickle its scene, or save_checkpoint and load_checkpoint"
        )

    def step(self, n: int = 1) -> None:
        """Computes n time steps with the GIL released. Ctrl-C stops between steps and keeps what was computed.

        A step that the solver cannot do is taken back and made of shorter ones, down to 1/16: `report["retries"]` counts what failed.
        Throws SolverError when that does not help either, or CollisionError; the state is that before the step.
        """
        self._core.step(count("step: n", n))

    def frames(self, n: Optional[int] = None, audit: bool = True) -> Iterator[Frame]:
        """Iterates over the next n frames (default: the scene's), each `steps_per_frame` steps.

        audit: count intersections in every frame, exactly.
        """
        for _ in range(self.scene.frames if n is None else count("frames: n", n)):
            self.step(self.steps_per_frame)
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
    def step_count(self) -> int:
        """Steps computed."""
        return self._core.step_count()

    @property
    def time(self) -> float:
        """s."""
        return self._core.time()

    @property
    def time_step(self) -> float:
        """s; the scene's, the accuracy level's or the user's."""
        return self._core.time_step()

    @property
    def steps_per_frame(self) -> int:
        """Time steps from one recorded frame to the next: as many as fill the scene's seconds_per_frame."""
        return max(1, round(self.scene.seconds_per_frame / self.time_step))

    @property
    def settings(self) -> list[dict[str, str]]:
        """Options that trade accuracy for time: list of dicts with name, value (text), origin ("level", "scene" or "user"), trades."""
        rows = [dict(zip(("name", "value", "origin", "trades"), row)) for row in self._core.settings()]
        return [
            {**row, "origin": "scene"} if row["origin"] == "user" and row["name"] in self._of_scene else row
            for row in rows
        ]

    @property
    def vertex_count(self) -> int:
        """Cloth and obstacle vertices."""
        return self._core.vertex_count()

    @property
    def cloth_vertex_count(self) -> int:
        """Cloth vertices."""
        return self._core.cloth_vertex_count()

    @property
    def cloth_triangle_count(self) -> int:
        """Cloth triangles; they come first in `faces`."""
        return self._core.cloth_triangle_count()

    @property
    def cloth_ranges(self) -> list[tuple[int, int]]:
        """[(first, last)] vertices of each cloth, last excluded."""
        return self._core.cloth_ranges()

    @property
    def obstacle_ranges(self) -> list[tuple[int, int]]:
        """[(first, last)] vertices of each obstacle, last excluded."""
        return self._core.obstacle_ranges()

    @property
    def positions(self) -> Reals:
        """[vertices, 3] float64, m."""
        return self._core.positions()

    @property
    def velocities(self) -> Reals:
        """[vertices, 3] float64, m/s."""
        return self._core.velocities()

    @property
    def faces(self) -> Integers:
        """[triangles, 3] int32, cloths first."""
        return self._core.faces()

    @property
    def masses(self) -> Reals:
        """[cloth vertices] float64, kg."""
        return self._core.masses()

    @property
    def contacts(self) -> npt.NDArray[np.void]:
        """Structured array, one row per contact of the last step.

        Fields: vertices [4] (vertex then face, or two edges), weights [4] signed barycentric, normal [3], distance in m,
        kind (0 vertex-face, 1 edge-edge).
        """
        columns = self._core.contacts()
        rows = np.empty(len(columns[0]), CONTACT)
        for name, column in zip(CONTACT.names or (), columns):
            rows[name] = column
        return rows

    def set_state(self, positions: ArrayLike, velocities: ArrayLike) -> None:
        """Replaces positions [m] and velocities [m/s] of all cloth vertices, [cloth vertices, 3] each.

        Throws ArrayError; CollisionError if the positions intersect, unless the option intersections is "exempt" or nothing in the scene
        can touch. Nothing is set then.
        """
        shape = (self.cloth_vertex_count, 3)
        self._core.set_state(
            reals("set_state: positions", positions, shape), reals("set_state: velocities", velocities, shape)
        )

    def save_checkpoint(self, path: PathLike) -> None:
        """Writes all that later steps depend on to an HDF5 file, whole or not at all: `load_checkpoint` goes on from there.

        Throws FileError.
        """
        checkpoint.write(path, self)

    def scene_parts(self) -> dict[str, str]:
        """{part: digest} of what the scene says: what a checkpoint holds to know its scene by."""
        if self._parts is None:
            self._parts = checkpoint.parts_of(self.scene)
        return self._parts

    def load_checkpoint(self, path: PathLike, changed_scene: bool = False) -> list[str]:
        """Goes on from a checkpoint of the same scene at the same resolution; path: the file, or the folder of `cama run`.

        changed_scene: all but meshes and masses may differ from the scene that the checkpoint was taken of.

        With the same options, on any backend, the steps are bit by bit those of the run that wrote it. Options may differ, the time step
        too: returns a list of texts that say which do, empty where none does. Throws FileError for what is no checkpoint, SceneError for
        one of another scene, a damaged one, or one that holds vertices which pins have let go of here, CollisionError where cloth
        intersects. Nothing changes then.
        """
        fields, settings, parts = checkpoint.read(path)
        if not changed_scene:
            checkpoint.check_scene(self, parts)
        self._core.restore(fields)
        self._frame = self.step_count // self.steps_per_frame
        return checkpoint.differences(self, settings)

    @property
    def report(self) -> StepReport:
        """What the last step did: dict of contacts, candidates, impacts, iterations, residual, newton_iterations, newton_residual, retries,
        truncated, milliseconds, ..."""
        return self._core.report()

    @property
    def timings(self) -> dict[str, float]:
        """Milliseconds of the last step: {stage: ms}; nested stages are "outer/inner"."""
        return stage_paths(self._core.timings())

    @property
    def streams(self) -> list[dict[str, Any]]:
        """Every stream that outlives a stage: list of dicts with name, element, size, bytes."""
        return [dict(zip(("name", "element", "size", "bytes"), row)) for row in self._core.streams()]

    def explain(self) -> list[tuple[str, str]]:
        """List of (stage, why this scene needs it), in order."""
        return self._core.explain()

    def energy(self) -> Energy:
        """Dict of kinetic, stretching, bending and gravity energy, J."""
        return self._core.energy()

    @property
    def untangled(self) -> UntangleReport:
        """collision.UntangleReport of the start; 0 rounds where there was nothing to do or the policy is another."""
        return UntangleReport(**self._core.untangled())

    @property
    def min_gap(self) -> float:
        """Smallest distance over the last step's candidate pairs, m; inf if there are none."""
        return self._core.min_gap()

    @property
    def max_strain(self) -> float:
        """Largest principal stretch minus one."""
        return self._core.max_strain()

    def count_intersections(self) -> int:
        """Edges through faces between all objects but obstacle and obstacle, by exact predicates."""
        return self._core.count_intersections()

    @property
    def state_hash(self) -> str:
        """16 hexadecimal digits over the bits of cloth positions and velocities."""
        return f"{self._core.state_hash():016x}"

    @property
    def peak_memory_bytes(self) -> int:
        """Most device memory that this simulation held at once."""
        return self._core.peak_memory_bytes()

    @property
    def backend(self) -> str:
        """Name of the backend in use."""
        return self._core.backend()[0]

    @property
    def device(self) -> str:
        """What the hardware is called."""
        return self._core.backend()[1]

    @property
    def options(self) -> dict[str, Any]:
        """Dict of every option in force."""
        return values(self._core.options())

    def __repr__(self) -> str:
        return (
            f"<cama.Simulation of {self.scene.name!r} on {self.backend}: step {self.step_count}, time {self.time:g} s>"
        )


def stage_paths(rows: Iterable[tuple[str, int, float]]) -> dict[str, float]:
    """(name, depth, ms) rows in pipeline order as {"outer/inner": ms}; the pipeline around all stages is left out.

    Equal names beside each other are added up.
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
