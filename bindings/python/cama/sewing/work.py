# SPDX-License-Identifier: Apache-2.0
"""The work of `dress`: placing, sewing, joining and draping one garment."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..errors import CollisionError, Error
from ..hints import counted
from ..material import Material
from ..scene import Scene
from ..simulation import Simulation
from ..types import Integers, Reals
from .meshing import PatternMesh, merge_map
from .order import RISE, ends_of_bands, held_vertices
from .result import REST_SPEED, TOLERANCE, Dressed, judge
from .wearer import Wearer

if TYPE_CHECKING:
    from .output import Output

NEAR = 1e-2  # m: pairs that are joined when a seam closes no further, so that the rest of it can
PATIENCE = 4  # phases without progress after which a seam closes no further
TRIES = 5  # of joining pairs, each without those at which the one before made cloth intersect
LEVEL: Literal["interactive"] = "interactive"  # accuracy; at "preview" small triangles of a cuff burst
PARTING, PARTINGS = 0.01, 12  # m by which a panel moves outward that crosses other cloth; how often at most
STEP = 0.01  # s, time step
STEPS = 10  # in a phase, after which stitches become stiffer and a frame is recorded
WEAKEST, STIFFEST = 0.005, 2e4  # N/m, of the stitch of a pair of vertices
LAG = 6  # doublings of stiffness by which the lowest seam is behind the highest
BAND_LAG = 4  # doublings by which the ends of a band, such as a cuff, are behind
SEWING_SPEED = 0.6  # m/s, mean: above it stitches stay as they are
MAX_PHASES = 70  # of sewing
SEWING_DAMPING = 10.0  # 1/s, mass damping while sewing
DRAPING_DAMPING = 3.0  # 1/s, mass damping while draping
INNER_DAMPING = 0.05  # s, least damping of stretch and bending while draping: tight cloth between contacts trembles
SEWING_FRICTION = 0.05
HANGING_DAMPING, HANGING_PHASES = 3.0, 25  # 1/s; phases of the fall
BODY_FRICTION = 0.4
FRAME_TIME, MOTION = 0.02, 5.0  # s, between the frames of the scene of a body that moves; its length


class Dressing:
    """The work of `dress`: the state of the cloth between its simulations."""

    def __init__(
        self,
        name: str,
        mesh: PatternMesh,
        wearer: Wearer,
        fabric: Material,
        under: Sequence[Dressed],
        how: dict[str, Any],
        say: Callable[[str], object] | None,
    ) -> None:
        self.name, self.mesh, self.fabric, self.how = name, mesh, fabric, how
        self.under = tuple(under)  # garments below this one
        self.under_positions = [garment.positions for garment in under]
        self.own = len(self.under)  # number of this cloth in a scene
        self.first = sum(len(garment.positions) for garment in under)  # its first vertex
        self.say = say or (lambda text: None)
        self.wearer = wearer
        self.pairs = mesh.pairs
        self.positions = mesh.positions  # of the panels' vertices; those that are joined have one place
        self.vertex_of: Integers = np.arange(len(mesh.points), dtype=np.int32)  # garment's vertex of each
        self.gaps = np.zeros(len(self.pairs))  # of each pair when it was joined
        self.time = 0.0
        self.writer: Output | None = None

    def run(self, writer: Output | None, seconds: float, started: float) -> Dressed:
        self.writer = writer
        pattern = self.mesh.pattern
        self.say(f"{pattern.name}: {len(self.mesh.faces):,} triangles, {counted(len(pattern.seams), 'seam')}")
        self._clear_start()
        problems: list[str] = []
        sewing = draping = 0
        last = None
        try:
            self._hang()
            sewing = self._sew()
            if self.gaps_now().max(initial=0) <= NEAR:  # what is not sewn would fall apart
                draping, last = self._drape(seconds)
        except Error as problem:
            problems.append(f"ended early, at {self.time:.1f} s: {problem}")
        result = self._scene(0.0, self.wearer.moving)
        verdict = judge(self, result, last, problems)
        final = result.cloths[self.own].vertices
        elapsed = time.monotonic() - started
        under = tuple(replace(garment, positions=x) for garment, x in zip(self.under, self.under_positions))
        return Dressed(
            self.name,
            verdict,
            result,
            self.wearer,
            self.mesh,
            self.vertex_of,
            final,
            elapsed,
            sewing,
            draping,
            self.fabric,
            under,
        )

    @staticmethod
    def _material(fabric: Material, damping: float, friction: float | None) -> Material:
        material = Material(fabric)
        material.mass_damping = max(damping, material.mass_damping)
        if damping == DRAPING_DAMPING:
            material.damping = max(INNER_DAMPING, material.damping)
        if friction is not None:
            material.friction, material.static_friction = friction, -1
        return material

    def _scene(self, damping: float = 0.0, moving: dict[str, Any] | None = None) -> Scene:
        """Returns a scene of the garments under gravity; seams that are open are stitched.

        damping: Least mass damping of the fabrics, 1/s.
        moving: Arguments of `add_obstacle` for the body as it moves; None: it stands still.
        """
        scene = Scene(name=self.mesh.pattern.name, frame_time=STEP * STEPS)
        if moving:
            scene.frame_time, scene.frames = FRAME_TIME, round(MOTION / FRAME_TIME)
        self._add(scene, damping, None, moving)
        open_ = self.open()
        if open_.any():
            first, second = self.vertex_of[self.pairs[open_]].T
            scene.stitch(self.own, first, self.own, second, stiffness=STIFFEST)
        return scene

    def _sewing_scene(self, stiffness: Reals) -> Scene:
        """Returns a scene without gravity, with a stitch of its own stiffness for each open pair [pairs]."""
        scene = Scene(gravity=(0, 0, 0), name=self.mesh.pattern.name, frame_time=STEP * STEPS)
        self._add(scene, SEWING_DAMPING, SEWING_FRICTION)
        open_ = self.open()
        for value in np.unique(stiffness[open_]):
            first, second = self.vertex_of[self.pairs[open_ & (stiffness == value)]].T
            scene.stitch(self.own, first, self.own, second, stiffness=float(value))
        return scene

    def _add(self, scene: Scene, damping: float, friction: float | None, moving: dict[str, Any] | None = None) -> None:
        """Adds the garments and the body to a scene; friction None: that of the fabrics and of a body."""
        for garment, positions in zip(self.under, self.under_positions):
            scene.add_cloth(
                positions,
                garment.faces,
                material_vertices=garment.mesh.material,
                material_faces=garment.mesh.faces,
                shrinkage=garment.mesh.shrinkage,
                material=self._material(garment.fabric, damping, friction),
                name=garment.name,
            )
        scene.add_cloth(
            self._joined_positions(),
            self.vertex_of[self.mesh.faces],
            material_vertices=self.mesh.material,
            material_faces=self.mesh.faces,
            shrinkage=self.mesh.shrinkage,
            material=self._material(self.fabric, damping, friction),
            name=self.name,
        )
        worn = [(garment.mesh, garment.vertex_of) for garment in self.under]
        for index, (mesh, vertex_of) in enumerate([*worn, (self.mesh, self.vertex_of)]):
            for elastic in mesh.elastics(vertex_of):
                scene.elastic(index, **elastic)
        body = {"mesh": self.wearer.vertices, "faces": self.wearer.faces}
        scene.add_obstacle(**(moving or body), friction=BODY_FRICTION if friction is None else friction, name="body")

    def _joined_positions(self) -> Reals:
        """Returns the positions [vertices of the garment, 3]: the means of what is joined."""
        counts = np.bincount(self.vertex_of)
        sums = np.stack([np.bincount(self.vertex_of, self.positions[:, axis]) for axis in range(3)], axis=1)
        return sums / counts[:, None]

    def open(self) -> np.ndarray:
        """Whether each pair [pairs] is still two vertices."""
        return self.vertex_of[self.pairs[:, 0]] != self.vertex_of[self.pairs[:, 1]]

    def gaps_now(self) -> Reals:
        """Returns the distance [pairs] of each pair, m."""
        return np.linalg.norm(self.positions[self.pairs[:, 0]] - self.positions[self.pairs[:, 1]], axis=1)

    def _clear_start(self) -> None:
        """Moves the placed panels until nothing intersects. Raises CollisionError."""
        self._part_panels()
        scene = self._sewing_scene(np.full(len(self.pairs), WEAKEST))
        self._untangle(scene, "the placed panels", "move the panels out, away from the body")
        if self.writer is not None:
            self.writer.start(Simulation(scene, accuracy=LEVEL, time_step=STEP, **self.how))

    def _part_panels(self) -> None:
        """Moves panels that cross other cloth outward, as a whole.

        A pattern's file may place panels in one plane that overlap there, such as a sleeve and a wide skirt. Moving
        their vertices one by one would crumple them. Of two panels the one that hangs lower moves.
        """
        panel_of = self.mesh.panel_of_vertex
        top = [self.positions[panel_of == p, 2].max() for p in range(len(self.mesh.pattern.panels))]
        fewest, best = np.inf, self.positions
        for _ in range(PARTINGS + 1):
            count, crossing = self._crossing_panels()
            if count < fewest:
                fewest, best = count, self.positions
            if not crossing:
                break
            lower = {a if b < 0 or (top[a], -a) < (top[b], -b) else b for a, b in crossing}
            self.positions = self.positions.copy()
            for panel in sorted(lower):
                self.positions[panel_of == panel] += PARTING * self._outward(panel)
        self.positions = best

    def _crossing_panels(self) -> tuple[int, set[tuple[int, int]]]:
        """Returns how many intersections cloth has with cloth, and the panels: (panel, panel or -1: other garments)."""
        scene = self._sewing_scene(np.full(len(self.pairs), WEAKEST))
        panel_of, faces = self.mesh.panel_of_vertex, self.mesh.faces
        count, found = 0, set()
        for pair in scene.intersections():
            cloth = np.maximum(pair.edge_object, pair.face_object) <= self.own
            own = cloth & ((pair.edge_object == self.own) | (pair.face_object == self.own))
            count += int(own.sum())
            for edge, edge_object, face, face_object in zip(
                pair.edge[own, 0], pair.edge_object[own], pair.face[own], pair.face_object[own]
            ):
                a = int(panel_of[edge]) if edge_object == self.own else -1
                b = int(panel_of[faces[face, 0]]) if face_object == self.own else -1
                if a != b:
                    found.add((max(a, b), min(a, b)))
        return count, found

    def _outward(self, panel: int) -> Reals:
        """Returns the horizontal part of a placed panel's normal [3] that leads away from the body, of length 1."""
        own = self.positions[self.mesh.panel_of_vertex == panel]
        beside = np.abs(self.wearer.vertices[:, 2] - own[:, 2].mean()) < max(0.05, np.ptp(own[:, 2]) / 2)
        axis = self.wearer.vertices[beside if beside.any() else slice(None)].mean(axis=0)
        away = (own.mean(axis=0) - axis) * (1, 1, 0)
        normal = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)[2][2] * (1, 1, 0)
        normal *= np.sign(normal @ away)
        direction = normal if np.linalg.norm(normal) > 0.5 else away
        return direction / max(np.linalg.norm(direction), 1e-12)

    def _untangle(self, scene: Scene, what: str, remedy: str) -> None:
        """Removes the intersections at the start of a scene and takes over its positions. Raises CollisionError."""
        report = scene.untangle()
        if report.before:
            self.say(
                f"{what}: {counted(report.before, 'intersection')} undone, by moves of up to "
                f"{report.largest_move * 1e3:.3g} mm"
            )
        if report.after:
            where = "; ".join(f"{p.count} of {p.first_name} with {p.second_name}" for p in scene.intersections())
            raise CollisionError(
                f"{self.mesh.pattern.name}: {report.after:,} of {report.before:,} intersections of {what} remain: "
                f"{where}; {remedy}"
            )
        self._take_over(np.concatenate([cloth.vertices for cloth in scene.cloths]))

    def _take_over(self, vertices: Reals) -> None:
        """Takes over the vertices of all garments."""
        first = 0
        for index, garment in enumerate(self.under):
            self.under_positions[index] = vertices[first : first + len(garment.positions)]
            first += len(garment.positions)
        self.positions = vertices[first:][self.vertex_of]

    def _hang(self) -> None:
        """Lets panels that rise above the seam by which they hang, such as half circles of a skirt, fall below it."""
        held = held_vertices(self.mesh)
        hanging = np.zeros(len(self.positions), bool)
        for index, panel in enumerate(self.mesh.pattern.panels):
            own = self.mesh.panel_of_vertex == index
            heights = self.positions[own & held, 2]
            if len(heights) and self.positions[own, 2].max() - heights.max() > RISE:
                hanging |= own
                self.say(f"{panel.name} rises above the seam that it hangs by: it falls first")
        if not hanging.any():
            return
        scene = Scene(name=self.mesh.pattern.name, frame_time=STEP * STEPS)
        self._add(scene, HANGING_DAMPING, SEWING_FRICTION)
        pairs = self.pairs.T
        scene.stitch(self.own, pairs[0], self.own, pairs[1], stiffness=WEAKEST / 2**LAG)  # so as not to collide
        scene.pin(self.own, ~hanging | held)
        simulation = Simulation(scene, accuracy=LEVEL, time_step=STEP, **self.how)
        for _ in range(HANGING_PHASES):
            simulation.step(STEPS)
            self.say(f"hanging {self.time + STEP * STEPS:.1f} s: {self._take(simulation):.2g} m/s")

    def _sew(self) -> int:
        """Draws the seams together and joins them; returns the number of phases."""
        height = self.positions[self.pairs].mean(axis=1)[:, 2]
        depth = height.max(initial=-np.inf) - height
        lag = np.round(2 * LAG * depth / max(depth.max(initial=0), 1e-9)) / 2 + BAND_LAG * ends_of_bands(self.mesh)
        level, full, last = 0.0, np.log2(STIFFEST / WEAKEST), lag.max(initial=0)
        phase, stuck, waiting, narrowest = 0, 0, 0, np.inf
        while self.open().any() and phase < MAX_PHASES:
            simulation = Simulation(
                self._sewing_scene(WEAKEST * 2.0 ** np.clip(level - lag, 0, full)),
                accuracy=LEVEL,
                time_step=STEP,
                **self.how,
            )
            simulation.step(STEPS)
            speed, phase = self._take(simulation), phase + 1
            gaps = self.gaps_now()
            self.say(
                f"sewing {self.time:.1f} s: seams at most {gaps.max() * 1e3:.3g} mm apart, {gaps.mean() * 1e3:.2g} mm "
                f"in the mean; {speed:.2g} m/s"
            )
            level += speed < SEWING_SPEED
            stuck = 0 if gaps.max() < 0.9 * narrowest else stuck + 1
            narrowest = min(narrowest, gaps.max())
            if gaps.max() <= TOLERANCE and level > last:
                waiting = 0 if self._join(TOLERANCE) else waiting + 1
                if waiting >= PATIENCE:
                    break
            elif level > full + last and stuck >= PATIENCE:
                if not self._join(NEAR):
                    break
                stuck, narrowest = 0, np.inf
        return phase

    def _join(self, distance: float) -> int:
        """Joins the pairs of vertices that are within a distance, m; returns how many.

        Pairs whose joining makes cloth intersect so that it cannot be untangled stay open for now.
        """
        gaps, open_, before = self.gaps_now(), self.open(), self.vertex_of
        close = open_ & (gaps <= distance)
        for _ in range(TRIES):
            if not close.any():
                break
            self.vertex_of = merge_map(len(self.positions), self.pairs[~open_ | close])
            scene = self._sewing_scene(np.full(len(self.pairs), WEAKEST))
            try:
                self._untangle(scene, "the joined seams", "look at the panels there")
            except CollisionError:
                close &= ~np.isin(self.vertex_of[self.pairs], self._tangled(scene)).any(axis=1)
                self.vertex_of = before
                continue
            self.gaps[close] = gaps[close]
            return int(close.sum())
        return 0

    def _tangled(self, scene: Scene) -> Integers:
        """Returns the vertices of this garment that intersect, and those of the triangles beside them."""
        faces = self.vertex_of[self.mesh.faces]
        found = [np.zeros(0, int)]
        for pair in scene.intersections():
            found.append(pair.edge[pair.edge_object == self.own].ravel())
            found.append(faces[pair.face[pair.face_object == self.own]].ravel())
        return np.unique(faces[np.isin(faces, np.concatenate(found)).any(axis=1)])

    def _take(self, simulation: Simulation) -> float:
        """Takes over positions of a simulation, records a frame; returns the root mean square speed, m/s."""
        count = simulation.cloth_vertex_count
        self.time += STEP * STEPS
        self._take_over(simulation.positions[:count])
        if self.writer is not None:
            self.writer.add(self.time, np.concatenate([*self.under_positions, self.positions]), simulation)
        return float(np.sqrt((simulation.velocities[:count] ** 2).sum(axis=1).mean()))

    def _drape(self, seconds: float) -> tuple[int, Simulation]:
        scene = self._scene(DRAPING_DAMPING)
        simulation = Simulation(scene, accuracy=LEVEL, time_step=STEP, **self.how)
        phase, speed = 0, np.inf
        while phase < 5 or (speed > REST_SPEED and phase < seconds / (STEP * STEPS)):
            simulation.step(STEPS)
            speed, phase = self._take(simulation), phase + 1
            self.say(f"draping {self.time:.1f} s: {speed * 1e3:.2g} mm/s")
        return phase, simulation
