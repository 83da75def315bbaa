# SPDX-License-Identifier: Apache-2.0
"""What `cama.dress` returns: a sewn garment and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..material import Material
from ..scene import Scene
from ..types import Integers, Reals
from .meshing import PatternMesh
from .wearer import Wearer


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
