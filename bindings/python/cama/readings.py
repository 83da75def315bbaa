# SPDX-License-Identifier: Apache-2.0
"""What is read from a simulation: its state, forces, reports and options."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _core
from .arrays import indices, vector
from .collision import UntangleReport
from .device_arrays import DeviceArray
from .parts import Obstacle
from .results import GasState, Wrench, contact_rows, stage_paths
from .rigid import RigidPose
from .scene import Scene
from .simulated_scene import SimulatedScene
from .types import ArrayLike, Integers, Reals, VectorLike

if TYPE_CHECKING:
    from ._core import Energy
    from ._options import StepReport


class Readings:
    """What can be read from a simulation of a scene. Arrays are copies of the state."""

    __slots__ = ("_core", "_scene")

    def __init__(self, core: _core.Simulation, scene: SimulatedScene) -> None:
        self._core, self._scene = core, scene

    @property
    def scene(self) -> Scene:
        """The scene that is simulated, read-only: an assignment, which could have no effect, raises SceneError."""
        return self._scene

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

    def rigid_pose(self, obstacle: Obstacle | int | str) -> RigidPose:
        """Returns where a rigid obstacle is, and how it moves.

        Args:
            obstacle: Handle, index or name.

        Raises:
            SceneError: The obstacle is not there, or not rigid.
        """
        return RigidPose(*(np.array(v) for v in self._core.rigid_pose(self._obstacle("rigid_pose", obstacle))))

    @property
    def pressures(self) -> Reals:
        """Pressure inside each cloth above that outside [cloths], Pa."""
        return np.array(self._core.pressures())

    @property
    def gas(self) -> dict[str, GasState]:
        """State of the gas in each cloth that encloses some, by the name of the cloth: {"balloon": GasState}."""
        cloths = self._scene.cloths
        return {cloths[row[0]].name: GasState(*row[1:]) for row in self._core.gas()}

    @property
    def plastic_curvature(self) -> Reals:
        """Curvature that each triangle of cloth keeps [triangles, 3], 1/m: along warp, along weft and twice the twist.

        The triangles are those of all cloths in order. Zero where the material has no yield curvature.
        """
        return self._core.plastic_curvature()

    def energy(self) -> Energy:
        """Returns the kinetic, stretching, bending and gravity energy, and that of enclosed gas, J.

        The last is the work that gas can still do at constant temperature, until its pressure is that outside, or up
        to 1 m^3 where there is none outside.
        """
        return self._core.energy()

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
    def untangled(self) -> UntangleReport:
        """What untangling did to the start; 0 rounds if there was nothing to do or no untangling was asked for."""
        return UntangleReport(**self._core.untangled())

    @property
    def state_hash(self) -> str:
        """A hash of the bits of cloth positions and velocities, 16 hexadecimal digits."""
        return f"{self._core.state_hash():016x}"

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

    @property
    def chosen_options(self) -> list[dict[str, str]]:
        """The options that trade accuracy for time, and who chose them.

        A list of dicts with name, value (text), origin and trades. The origin is "level", "scene", "user", or
        "time_step" for an integrator that is not the level's because the time step is too long for it.
        """
        return [dict(zip(("name", "value", "origin", "trades"), row)) for row in self._core.chosen_options()]

    def _vertices(self, what: str, vertices: ArrayLike) -> Integers:
        return indices(f"{what}: vertices", vertices, self.cloth_vertex_count)

    def _obstacle(self, what: str, obstacle: Obstacle | int | str) -> int:
        return self._scene._index(what, obstacle, self._scene.obstacles)
