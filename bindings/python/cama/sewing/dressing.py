# SPDX-License-Identifier: Apache-2.0
"""`cama.dress`: a sewing pattern is placed around a body, sewn, and draped to rest."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..arrays import number
from ..body import Body
from ..errors import CollisionError, Error, MeshError, SceneError
from ..hints import counted
from ..material import Material
from ..plausibility import PlausibilityWarning
from ..scene import Scene
from ..simulation import Simulation
from ..types import Description, Integers, PathLike, Reals
from .meshing import PatternMesh, edge_length_of, merge_map, mesh_pattern
from .pattern import SewingPattern
from .result import Dressed, Verdict, place, principal_strains
from .wearer import Wearer, wearer_of

if TYPE_CHECKING:
    from .output import Output

__all__ = ["Dressed", "Verdict", "dress"]

TOLERANCE = 1e-3  # m: seams that are closed to this are joined
NEAR = 1e-2  # m: pairs that are joined when a seam closes no further, so that the rest of it can
PATIENCE = 4  # phases without progress after which a seam closes no further
TRIES = 5  # of joining pairs, each without those at which the one before made cloth intersect
REST_SPEED = 3e-3  # m/s, root mean square over the cloth, below which it is at rest
LEVEL, STEP = "interactive", 0.01  # accuracy; s, time step. At "preview" small triangles of a cuff burst
STEPS = 10  # in a phase, after which stitches become stiffer and a frame is recorded
WEAKEST, STIFFEST = 0.005, 2e4  # N/m, of the stitch of a pair of vertices
LAG = 6  # doublings of stiffness by which the lowest seam is behind the highest
BAND_LAG, BAND = 4, 3.0  # doublings by which the ends of a band, such as a cuff, are behind; area of what holds one
SEWING_SPEED = 0.6  # m/s, mean: above it stitches stay as they are
MAX_PHASES = 70  # of sewing
SEWING_DAMPING = 10.0  # 1/s, mass damping while sewing
DRAPING_DAMPING = 3.0  # 1/s, mass damping while draping
INNER_DAMPING = 0.05  # s, least damping of stretch and bending while draping: tight cloth between contacts trembles
SEWING_FRICTION = 0.05
RISE = 0.1  # m, of a panel above the seam that it hangs by, above which it falls before it is sewn
HANGING_DAMPING, HANGING_PHASES = 3.0, 25  # 1/s; phases of the fall
BODY_FRICTION = 0.4
SLIPPED = 0.15  # of the body's height: a garment that sinks further has slid down
FRAME_TIME, MOTION = 0.02, 5.0  # s, between the frames of the scene of a body that moves; its length


def dress(
    pattern: SewingPattern | PathLike | Sequence[SewingPattern | PathLike],
    body: PathLike | Description | Body | tuple[Any, Any],
    *,
    motion: str | None = None,
    lead_in: float = 1.0,
    fabric: PathLike | Description | Material | Sequence[PathLike | Description | Material] = "cotton",
    triangles: int = 8000,
    edge_length: float | None = None,
    output: PathLike | None = None,
    units: Literal["m", "cm", "mm", "inch"] | None = None,
    up: Literal["y", "z"] | None = None,
    seconds: float = 12.0,
    backend: str = "auto",
    threads: int = 0,
    say: Callable[[str], object] | None = None,
) -> Dressed:
    """Sews a pattern around a body and lets it come to rest.

    The panels are meshed, placed as the pattern says, and moved clear of the body and of each other (`Scene.untangle`).
    Then stitches draw the seams together without gravity, the upper ones first, with a stiffness that doubles every
    tenth of a second; vertices closer than 1 mm are joined, and the garment drapes under gravity until it rests.

    Args:
        pattern: A `SewingPattern`, or a file that `SewingPattern.load` reads; or several, which are put on one after
            the other, the first next to the skin.
        body: A `cama.Body`, a character with its animation, a mesh file, (vertices [n, 3] in m, faces [m, 3]), or an
            obstacle as in scene.json, for example {"walker": {}}. It stands still as it is dressed, as at time 0.
        motion: What a body of a mesh does once it is dressed: "stand", "walk", "dance", "kick" or "turn", as
            `cama.Body(motion, mesh=...)`; None: nothing, or its own animation.
        lead_in: Time in which a body with an animation or a `motion` moves from the pose that it is dressed in into the
            motion, s. A character is dressed in its bind pose.
        fabric: A fabric's name, a file, a dict or a `cama.Material`; or as many of them as there are patterns.
        triangles: About how many triangles each garment has.
        edge_length: Length of their edges, m, in place of `triangles`; None: by `triangles`.
        output: A folder for the garment, a scene, the frames and a summary; None: nothing is written.
        units: Unit of the body's file; None: by its height, which is 0.4 to 3 m.
        up: The axis of the body's file that points up; None: that of the pattern's file.
        seconds: Longest time of draping, s.
        backend, threads: As for `Simulation`.
        say: Called with a line of text when a stage begins and after each phase; None: nothing is said.

    Returns:
        The garment and a verdict. A garment whose verdict is not good is returned and written too. In its scene the
        body moves, if it can, for 5 s.

    Raises:
        FileError, SceneError, MeshError, MaterialError: Pattern, body or fabric cannot be used.
        CollisionError: The placed panels cannot be moved clear of the body; the text says where they are.
        BackendError: SciPy is not installed.
    """
    started = time.monotonic()
    patterns = list(pattern) if isinstance(pattern, (list, tuple)) else [pattern]
    fabrics = list(fabric) if isinstance(fabric, (list, tuple)) else [fabric] * len(patterns)
    if not patterns or len(fabrics) != len(patterns):
        raise SceneError(
            f"dress: {counted(len(patterns), 'pattern')} and {counted(len(fabrics), 'fabric')}; give one fabric, or one "
            "for each pattern"
        )
    materials = [Material.of(each) for each in fabrics]
    made = [given if isinstance(given, SewingPattern) else SewingPattern.load(given) for given in patterns]
    meshes = []
    for each in made:
        length = number("dress: edge_length", edge_length) if edge_length is not None else edge_length_of(each, triangles)
        meshes.append(mesh_pattern(each, length))
    wearer = wearer_of(body, motion, number("dress: lead_in", lead_in), units, up or made[0].up)
    names = _names([each.name for each in made])
    dressed: list[Dressed] = []
    with contextlib.ExitStack() as stack:
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", PlausibilityWarning)  # of panels that are far from each other
        writer: Output | None = None
        if output is not None:
            from .output import Output

            writer = stack.enter_context(Output(output))
        for name, mesh, material in zip(names, meshes, materials):
            how = {"backend": backend, "threads": threads}
            work = _Dressing(name, mesh, wearer, material, dressed, how, say)
            last = len(dressed) == len(meshes) - 1
            dressed.append(work.run(writer if last else None, number("dress: seconds", seconds), started))
            if not np.isfinite(dressed[-1].verdict.speed):
                break  # it would not stay on
        if writer is not None:
            writer.finish(dressed[-1])
    return dressed[-1]


def _names(patterns: list[str]) -> list[str]:
    """Returns the names of the cloths: those of the patterns, with a number where they are the same."""
    if len(patterns) == 1:
        return ["garment"]
    return [
        f"{name} {patterns[:index].count(name) + 1}" if patterns.count(name) > 1 else name
        for index, name in enumerate(patterns)
    ]


class _Dressing:
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
            if self._gaps().max(initial=0) <= NEAR:  # what is not sewn would fall apart
                draping, last = self._drape(seconds)
        except Error as problem:
            problems.append(f"ended early, at {self.time:.1f} s: {problem}")
        result = self._scene(0.0, self.wearer.moving)
        verdict = self._verdict(result, last, problems)
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
        open_ = self._open()
        if open_.any():
            first, second = self.vertex_of[self.pairs[open_]].T
            scene.stitch(self.own, first, self.own, second, stiffness=STIFFEST)
        return scene

    def _sewing_scene(self, stiffness: Reals) -> Scene:
        """Returns a scene without gravity, with a stitch of its own stiffness for each open pair [pairs]."""
        scene = Scene(gravity=(0, 0, 0), name=self.mesh.pattern.name, frame_time=STEP * STEPS)
        self._add(scene, SEWING_DAMPING, SEWING_FRICTION)
        open_ = self._open()
        for value in np.unique(stiffness[open_]):
            first, second = self.vertex_of[self.pairs[open_ & (stiffness == value)]].T
            scene.stitch(self.own, first, self.own, second, stiffness=float(value))
        return scene

    def _add(
        self, scene: Scene, damping: float, friction: float | None, moving: dict[str, Any] | None = None
    ) -> None:
        """Adds the garments and the body to a scene; friction None: that of the fabrics and of a body."""
        for garment, positions in zip(self.under, self.under_positions):
            scene.add_cloth(
                positions,
                garment.faces,
                material_vertices=garment.mesh.material,
                material_faces=garment.mesh.faces,
                material=self._material(garment.fabric, damping, friction),
                name=garment.name,
            )
        scene.add_cloth(
            self._joined_positions(),
            self.vertex_of[self.mesh.faces],
            material_vertices=self.mesh.material,
            material_faces=self.mesh.faces,
            material=self._material(self.fabric, damping, friction),
            name=self.name,
        )
        body = {"mesh": self.wearer.vertices, "faces": self.wearer.faces}
        scene.add_obstacle(**(moving or body), friction=BODY_FRICTION if friction is None else friction, name="body")

    def _joined_positions(self) -> Reals:
        """Returns the positions [vertices of the garment, 3]: the means of what is joined."""
        counts = np.bincount(self.vertex_of)
        sums = np.stack([np.bincount(self.vertex_of, self.positions[:, axis]) for axis in range(3)], axis=1)
        return sums / counts[:, None]

    def _open(self) -> np.ndarray:
        """Whether each pair [pairs] is still two vertices."""
        return self.vertex_of[self.pairs[:, 0]] != self.vertex_of[self.pairs[:, 1]]

    def _gaps(self) -> Reals:
        """Returns the distance [pairs] of each pair, m."""
        return np.linalg.norm(self.positions[self.pairs[:, 0]] - self.positions[self.pairs[:, 1]], axis=1)

    def _clear_start(self) -> None:
        """Moves the placed panels until nothing intersects. Raises CollisionError."""
        scene = self._sewing_scene(np.full(len(self.pairs), WEAKEST))
        self._untangle(scene, "the placed panels", "move the panels out, away from the body")
        if self.writer is not None:
            self.writer.start(Simulation(scene, accuracy=LEVEL, time_step=STEP, **self.how))

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
        held = self._held_vertices()
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

    def _held_vertices(self) -> np.ndarray:
        """Whether each vertex is sewn to a panel whose middle is higher than that of its own."""
        panels = self.mesh.panel_of_vertex
        middle = np.bincount(panels, self.mesh.positions[:, 2]) / np.bincount(panels)
        held = np.zeros(len(panels), bool)
        for first, second in (self.pairs.T, self.pairs.T[::-1]):
            held[first[middle[panels[second]] > middle[panels[first]] + RISE]] = True
        return held

    def _sew(self) -> int:
        """Draws the seams together and joins them; returns the number of phases."""
        height = self.positions[self.pairs].mean(axis=1)[:, 2]
        depth = height.max(initial=-np.inf) - height
        lag = np.round(2 * LAG * depth / max(depth.max(initial=0), 1e-9)) / 2 + BAND_LAG * ends_of_bands(self.mesh)
        level, full, last = 0.0, np.log2(STIFFEST / WEAKEST), lag.max(initial=0)
        phase, stuck, waiting, narrowest = 0, 0, 0, np.inf
        while self._open().any() and phase < MAX_PHASES:
            simulation = Simulation(
                self._sewing_scene(WEAKEST * 2.0 ** np.clip(level - lag, 0, full)),
                accuracy=LEVEL,
                time_step=STEP,
                **self.how,
            )
            simulation.step(STEPS)
            speed, phase = self._take(simulation), phase + 1
            gaps = self._gaps()
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
        gaps, open_, before = self._gaps(), self._open(), self.vertex_of
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

    def _verdict(self, scene: Scene, last: Simulation | None, problems: list[str]) -> Verdict:
        pattern, cloth = self.mesh.pattern, scene.cloths[self.own]
        gaps, open_ = self._gaps(), self._open()
        gap, seam = float(gaps.max(initial=0)), ""
        if gap > TOLERANCE:
            widest = int(np.argmax(gaps))
            seam = pattern.seam_name(self._seam_of(widest))
            problems.append(
                f"{counted(int((open_ & (gaps > TOLERANCE)).sum()), 'pair')} of vertices did not close; {seam} is "
                f"{gap * 1e3:.3g} mm apart at {place(self.positions[self.pairs[widest, 0]])}"
            )
        found = scene.intersections()
        problems += [f"{pair.count} intersections of {pair.first_name} with {pair.second_name}" for pair in found]
        speeds = np.full(1, np.nan)
        if last is not None:
            speeds = np.linalg.norm(last.velocities[: last.cloth_vertex_count], axis=1)
        speed = float(np.sqrt((speeds**2).mean()))
        if speed > REST_SPEED:
            fastest = int(np.argmax(speeds))
            problems.append(
                f"not at rest: {speed * 1e3:.2g} mm/s, fastest {speeds[fastest] * 1e3:.2g} mm/s in "
                f"{self._panel_of(fastest)} at {place(np.concatenate([c.vertices for c in scene.cloths])[fastest])}"
            )
        for each, mesh in zip(scene.cloths, [*(garment.mesh for garment in self.under), self.mesh]):
            dropped = float(mesh.positions[:, 2].max() - each.vertices[:, 2].max())
            if dropped > SLIPPED * float(np.ptp(self.wearer.vertices[:, 2])):
                problems.append(f"the {each.name} slid down by {dropped:.2f} m: nothing holds it on this body")
        strains = principal_strains(cloth.vertices[cloth.faces], self.mesh.material[self.mesh.faces])
        most = int(np.argmax(strains))
        panel = pattern.panels[self.mesh.panel_of_face[most]].name
        count = sum(pair.count for pair in found)
        joined = max([float(self.gaps.max(initial=0)), *(garment.verdict.joined_gap for garment in self.under)])
        return Verdict(problems, gap, joined, seam, count, speed, float(strains[most]), panel)

    def _seam_of(self, pair: int) -> int:
        wanted = self.pairs[pair]
        for index, rows in enumerate(self.mesh.seam_pairs):
            if (np.sort(rows, axis=1) == wanted).all(axis=1).any():
                return index
        raise MeshError(f"pair {pair} is of no seam")

    def _panel_of(self, vertex: int) -> str:
        """Returns the name of the panel of a vertex of this garment, or that of a garment below it."""
        names = [garment.name for garment in self.under for _ in range(len(garment.positions))]
        if vertex < self.first:
            return names[vertex]
        own = np.flatnonzero(self.vertex_of == vertex - self.first)[0]
        return self.mesh.pattern.panels[self.mesh.panel_of_vertex[own]].name


def ends_of_bands(mesh: PatternMesh) -> np.ndarray:
    """Whether each pair [pairs] closes a band around a limb, such as a cuff: of two panels that hang by larger ones.

    Such a band is sewn to the sleeve before its ends meet, or it closes beside the arm.
    """
    area = np.array([abs(panel.area) for panel in mesh.pattern.panels])
    height = np.bincount(mesh.panel_of_vertex, mesh.positions[:, 2]) / np.bincount(mesh.panel_of_vertex)
    band = np.zeros(len(area), bool)
    for seam in mesh.pattern.seams:
        for own, other in ((seam.first[0], seam.second[0]), (seam.second[0], seam.first[0])):
            band[own] |= area[other] > BAND * area[own] and height[other] > height[own]
    return band[mesh.panel_of_vertex[mesh.pairs]].all(axis=1)
