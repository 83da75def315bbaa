# SPDX-License-Identifier: Apache-2.0
"""What `cama.dress` returns: a sewn garment and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MeshError
from ..hints import counted
from ..material import Material
from ..scene import Scene
from ..types import Integers, Reals
from .meshing import PatternMesh
from .wearer import Wearer

if TYPE_CHECKING:
    from ..simulation import Simulation
    from .work import Dressing

TOLERANCE = 1e-3  # m: seams that are closed to this are joined
REST_SPEED = 3e-3  # m/s, root mean square over the cloth, below which it is at rest
SLIPPED = 0.15  # of the body's height: a garment that sinks further has slid down


@dataclass
class Verdict:
    """What became of a pattern: closed seams, no intersections, cloth at rest, or what failed and where."""

    problems: list[str]  #: what failed, with the place; empty if the garment is good
    seam_gap: float  #: largest distance of two vertices that belong together, m, at the end; 0 where they are joined
    joined_gap: float  #: largest distance of two vertices when they were joined, m
    widest_seam: str  #: the seam that is open furthest, or ""
    intersections: int  #: edges through faces at the end
    speed: float  #: root mean square of the cloth's speed at the end, m/s; NaN if it was not draped
    max_strain: float  #: largest principal stretch at the end, minus one
    strained_at: str  #: the panel with it

    @property
    def good(self) -> bool:
        """Whether nothing failed."""
        return not self.problems

    def __str__(self) -> str:
        if self.good:
            return f"good: seams closed, from {self.joined_gap * 1e3:.2g} mm, no intersections, at rest"
        return "; ".join(self.problems)


@dataclass
class Dressed:
    """A sewn garment on a body, as `dress` returns it; of an outfit the outermost one."""

    name: str  #: of its cloth in the scene
    verdict: Verdict  #: whether the garment is good
    scene: Scene = field(repr=False)  #: the garments at the end, on the body: a scene to start from
    wearer: Wearer = field(repr=False)  #: the body
    mesh: PatternMesh = field(repr=False)  #: the flat panels
    vertex_of: Integers = field(repr=False)  #: [vertices of `mesh`], the garment's vertex that each became
    positions: Reals = field(repr=False)  #: [vertices of the garment, 3] m
    seconds: float  #: wall time
    sewing_phases: int  #: phases of 0.1 s until the seams were joined
    draping_phases: int  #: phases of 0.1 s from there to rest
    fabric: Material = field(repr=False)  #: its fabric
    under: tuple[Dressed, ...] = field(default=(), repr=False)  #: the garments below it, the innermost first

    @property
    def faces(self) -> Integers:
        """Triangles [m, 3] of the garment; `mesh.faces` are the same in material space."""
        return self.vertex_of[self.mesh.faces]

    @property
    def open_pairs(self) -> Integers:
        """Vertices [k, 2] of the garment that belong together, but did not close."""
        pairs = self.vertex_of[self.mesh.pairs]
        return pairs[pairs[:, 0] != pairs[:, 1]]


def place(point: Reals) -> str:
    """Returns "(0.1, 0.2, 1.3) m"."""
    return f"({', '.join(f'{value:.2f}' for value in point)}) m"


def principal_strains(corners: Reals, rest: Reals) -> Reals:
    """Returns the larger principal stretch minus one [m] of triangles [m, 3, 3] with rest corners [m, 3, 2]."""
    now = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    flat = np.stack([rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]], axis=2)
    gradient = now @ np.linalg.inv(flat)
    return np.linalg.svd(gradient, compute_uv=False)[:, 0] - 1


def judge(work: Dressing, scene: Scene, last: Simulation | None, problems: list[str]) -> Verdict:
    """Returns the verdict on a garment.

    Args:
        work: What was done.
        scene: The garments at the end.
        last: The simulation that draped them; None: there was none.
        problems: What failed before.
    """
    pattern, cloth = work.mesh.pattern, scene.cloths[work.own]
    gaps, open_ = work.gaps_now(), work.open()
    gap, seam = float(gaps.max(initial=0)), ""
    if gap > TOLERANCE:
        widest = int(np.argmax(gaps))
        seam = pattern.seam_name(_seam_of(work, widest))
        problems.append(
            f"{counted(int((open_ & (gaps > TOLERANCE)).sum()), 'pair')} of vertices did not close; {seam} is "
            f"{gap * 1e3:.3g} mm apart at {place(work.positions[work.pairs[widest, 0]])}"
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
            f"{_panel_of(work, fastest)} at {place(np.concatenate([c.vertices for c in scene.cloths])[fastest])}"
        )
    for each, mesh in zip(scene.cloths, [*(garment.mesh for garment in work.under), work.mesh]):
        dropped = float(mesh.positions[:, 2].max() - each.vertices[:, 2].max())
        if dropped > SLIPPED * float(np.ptp(work.wearer.vertices[:, 2])):
            problems.append(f"the {each.name} slid down by {dropped:.2f} m: nothing holds it on this body")
    strains = principal_strains(cloth.vertices[cloth.faces], cloth.rest_corners)
    most = int(np.argmax(strains))
    panel = pattern.panels[work.mesh.panel_of_face[most]].name
    count = sum(pair.count for pair in found)
    joined = max([float(work.gaps.max(initial=0)), *(garment.verdict.joined_gap for garment in work.under)])
    return Verdict(problems, gap, joined, seam, count, speed, float(strains[most]), panel)


def _seam_of(work: Dressing, pair: int) -> int:
    wanted = work.pairs[pair]
    for index, rows in enumerate(work.mesh.seam_pairs):
        if (np.sort(rows, axis=1) == wanted).all(axis=1).any():
            return index
    raise MeshError(f"pair {pair} is of no seam")


def _panel_of(work: Dressing, vertex: int) -> str:
    """Returns the name of the panel of a vertex of this garment, or that of a garment below it."""
    names = [garment.name for garment in work.under for _ in range(len(garment.positions))]
    if vertex < work.first:
        return names[vertex]
    own = np.flatnonzero(work.vertex_of == vertex - work.first)[0]
    return work.mesh.pattern.panels[work.mesh.panel_of_vertex[own]].name
