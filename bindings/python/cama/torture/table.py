# SPDX-License-Identifier: Apache-2.0
"""The list of torture cases, 1 to 45, and the checks of each: what is expected, where it applies, how it is run."""

from dataclasses import dataclass
from functools import partial
from typing import Callable, Optional

from . import collisions, inputs, materials, meshes, running
from .scene_cases import CASES

BACKENDS = ("cpu", "opencl", "cuda")
PRECISIONS = ("double", "mixed", "single")

#: What each number of the list is about.
NUMBERS = {
    1: "one triangle, no pins",
    2: "empty scene, no triangle",
    3: "isolated vertices",
    4: "degenerate and duplicate triangles",
    5: "non-manifold edge, Moebius strip, flipped faces",
    6: "slivers of aspect 1e4",
    7: "edge lengths varying 1e4 to 1",
    8: "1e6 m from the origin; 1 mm and 1 km",
    9: "start that intersects itself",
    10: "start that touches; sheets in one plane",
    11: "thickness longer than edges",
    12: "pile of sheets",
    13: "ten turns of twist",
    14: "knot, interlocked rings",
    15: "funnel, hole of 3 %",
    16: "pinch to below the thickness",
    17: "obstacle teleports or turns over",
    18: "bullet, knife, needles at speed",
    19: "needle bed",
    20: "two huge triangles under fine cloth",
    21: "all in a point or a line",
    22: "identical centroids",
    23: "time step 1 s and 1e-7 s",
    24: "stiffness 0, 1e12, indefinite",
    25: "bending 0, 1e3, full fold",
    26: "density 1e-6, 1e6, ratio 1e6",
    27: "friction 0 to 1e6, angle of friction",
    28: "all pinned; pulled apart; pin through cloth",
    29: "rest stays bitwise still",
    30: "free translation and rotation",
    31: "NaN and Inf in every input",
    32: "lists far too small",
    33: "solve that is cut off or indefinite",
    34: "device out of memory",
    35: "dryer, ten minutes",
    36: "wind of 100 m/s",
    37: "two sheets a micrometre apart",
    38: "near-parallel edges sliding",
    39: "corner to corner, corner to edge",
    40: "edge through an endpoint, grazing",
    41: "T-junction seams, wrong material scale",
    42: "confetti",
    43: "restart",
    44: "threads and devices",
    45: "sizes beyond 32 bits",
}


@dataclass(frozen=True)
class Check:
    """One thing to try."""

    number: int  #: of the list
    name: str  #: of the check
    expected: str  #: in words
    body: Optional[Callable]  #: Probe -> None; throws probe.Wrong or cama.Error
    error: str = ""  #: class of the cama.Error that must end the body
    words: str = ""  #: in that error's text
    backends: tuple = BACKENDS  #: where it applies
    precisions: tuple = PRECISIONS  #: in which it applies
    alone: bool = False  #: only right in a process of its own
    long: bool = False  #: left out unless asked for: more than about ten seconds
    reason: str = ""  #: why it is not run here, and what stands in for it
    fault: str = ""  #: what does not hold in this version
    seen_as: str = ""  #: words of the outcome that are due to it; any other outcome is a failure
    fault_in: tuple = PRECISIONS  #: precisions that have it

    def applies(self, backend, precision):
        """Whether there is something to run."""
        return self.body is not None and backend in self.backends and precision in self.precisions

    def known(self, outcome, precision):
        """The fault that an outcome is due to, or an empty text."""
        return self.fault if self.fault and self.seen_as in outcome and precision in self.fault_in else ""


def _scene(number, name, resolution, expected, long=False, fault="", seen_as="", fault_in=PRECISIONS, **build):
    case = CASES[name]
    label = f"ends with {case.error} ({case.words}); no intersection before" if case.error else expected

    def body(p):
        p.scene_case(case, resolution, **build)

    faults = dict(fault=fault, seen_as=seen_as, fault_in=fault_in)
    return Check(number, name, label, body, error=case.error, words=case.words, long=long, **faults)


def _of(module, number, name, expected, **more):
    return Check(number, name, expected, getattr(module, name), **more)


_mesh, _touch, _matter, _input, _go = (partial(_of, m) for m in (meshes, collisions, materials, inputs, running))
STRETCHED = "no intersection; not left stretched by more than half"

CHECKS = (
    _mesh(1, "single_triangle", "free fall, as the integrator has it"),
    _input(2, "empty_scene", "SceneError"),
    _input(2, "no_triangles", "MeshError"),
    _input(3, "isolated_vertices", "MeshError names the vertex"),
    _input(4, "degenerate_triangles", "MeshError names the face"),
    _input(4, "duplicate_triangles", "MeshError names both faces"),
    _mesh(5, "non_manifold_edge", "five pages on one edge: no intersection, strain below 5 %"),
    _mesh(5, "moebius_strip", "no intersection, strain below 10 %"),
    _mesh(5, "flipped_faces", "bends as the same mesh with all faces one way round"),
    _mesh(6, "slivers", "strain at most twice rho g L / k, end where its weight puts it; single: that or SolverError"),
    _mesh(6, "swinging_slivers", "no end farther away than the strip is long; single: that or SolverError"),
    _mesh(7, "graded_edges", "strain at most twice rho g L / k, solve converges"),
    _mesh(8, "far_away", "the shape at the origin, but for the rounding of coordinates"),
    _mesh(8, "millimetre", "the shape at 1 m, scaled"),
    _mesh(8, "kilometre", "the shape at 1 m, scaled"),
    _touch(9, "start_that_intersects", "CollisionError with names; exempt runs; untangle: no intersection"),
    _touch(10, "touching", "CollisionError with both names"),
    _touch(10, "coplanar", "no intersection"),
    _scene(11, "thick", 80, "no intersection, no strain above 10 %, comes to rest"),
    _scene(12, "pile", 320, "no intersection, no inversion of layers", sheets=5, seconds=0.6),
    _scene(12, "stack", 120, "no intersection, kinetic energy falls to 1e-6", sheets=3, seconds=1.5),
    _scene(13, "rope", 200, "no intersection, wound ten times", seconds=2.0),
    _scene(13, "twisting", 200, "no intersection, layers in order", long=True),
    _scene(14, "knot", 300, "no intersection, still a knot (writhe)"),
    _scene(14, "chain", 200, "no intersection, still linked (Gauss)"),
    _scene(15, "funnel", 200, "no intersection, goes down", long=True),
    _scene(15, "hole", 200, "no intersection, all through the hole"),
    _scene(
        16,
        "press",
        100,
        "no intersection, between the plates, comes to rest",
        seen_as="kinetic energy at the end",
        fault_in=("single",),
        fault="folds that two plates hold keep shaking with some thousandths of the energy that the cloth had in its "
        "fall, where contacts and impacts alternate; which start shows it is a matter of rounding",
    ),
    _scene(16, "press_tight", 100, "no intersection, between the plates"),
    _scene(16, "press_shut", 100, ""),
    _scene(16, "clamp", 100, "no intersection, comes to rest"),
    _scene(17, "teleport", 100, STRETCHED),
    _scene(17, "flip", 100, STRETCHED),
    _scene(18, "bullet", 100, STRETCHED),
    _scene(18, "knife", 200, STRETCHED),
    _scene(18, "needle_shot", 200, STRETCHED),
    _scene(19, "needle_bed", 200, "no intersection, no needle through, comes to rest"),
    _mesh(20, "huge_triangles", "pairs grow as the triangles, not as their square; nothing below the floor"),
    _mesh(21, "collapsed_to_a_point", "unfolds without intersection, or SolverError"),
    _mesh(21, "collapsed_to_a_line", "unfolds without intersection, or SolverError"),
    _mesh(21, "all_on_one_point", "MeshError: no area"),
    _mesh(22, "identical_centroids", "free fall"),
    _mesh(22, "same_centroid", "CollisionError; exempt runs"),
    _matter(23, "second_step", "no intersection, finite"),
    _matter(23, "tiny_step", "velocity g t to rounding"),
    _matter(24, "no_stiffness", "what is not held falls freely"),
    _matter(24, "huge_stiffness", "strain below 1 %; single: MaterialError"),
    _matter(24, "indefinite_stiffness", "MaterialError names k12"),
    _matter(25, "no_bending", "hangs; bending energy 0"),
    _matter(25, "huge_bending", "stays a plate"),
    _matter(25, "folded_crease", "bending energy of a hinge over a full turn (closed form)"),
    _matter(25, "paper_crease", "no intersection, opens"),
    _matter(26, "light", "no intersection, finite"),
    _matter(26, "heavy", "no intersection, finite"),
    _matter(26, "mass_ratio", "no intersection, finite"),
    _touch(27, "frictionless", "g sin(angle)"),
    _touch(27, "friction_angle", "1 % below slides with g sin(angle) / 100, 1 % above stops"),
    _touch(27, "friction_angle_at_rest", "1 % below the angle what rests starts to slide"),
    _touch(27, "huge_friction", "no motion at 1, 10 and 1e6"),
    _touch(28, "all_pinned", "keeps every bit; follows its motion"),
    _touch(28, "pulled_apart", "strain about 9, finite, no intersection"),
    _touch(28, "pin_through_own_cloth", "no intersection"),
    _matter(29, "at_rest", "every bit stays for 1000 steps"),
    _matter(29, "at_rest_for_long", "every bit stays for 1e5 steps", long=True),
    _matter(
        29,
        "at_rest_any_mesh",
        "the same where the rest shape is rounded",
        seen_as="not bitwise still",
        fault_in=("double", "mixed"),
        fault="rounding of the rest shape moves vertices by 1e-14 m",
    ),
    _matter(30, "translation", "momentum to 1e-12 (single: 1e-6), positions v t"),
    _matter(30, "rotation", "momentum to 1e-12 (mixed: 1e-9, single: 1e-5), spin lost not gained"),
    _input(31, "not_finite", "each refused by a subclass of cama.Error"),
    _go(32, "lists_from_nothing", "the bits of lists that were large before"),
    _go(33, "solve_cap", "residual in the report above the tolerance; finite"),
    _go(33, "solve_cap_of_one", "the same with one iteration"),
    Check(
        33,
        "indefinite_matrix",
        "SolverError with the step",
        None,
        reason="no input makes the matrix indefinite; unit test "
        '"a system that is not positive definite raises SolverError and says the step" plants one',
    ),
    _go(
        34,
        "out_of_memory",
        "DeviceMemoryError, state kept, later the bits of a run with enough",
        backends=("cpu",),
        alone=True,
    ),
    Check(
        34,
        "device_out_of_memory",
        "the same on a device",
        None,
        reason="a full device disturbs who else uses it; tests/consistency/test_failures.cpp fails every allocation "
        "on every backend",
    ),
    Check(
        35,
        "dryer",
        "no drift to an intersection in 10 minutes with 5 garments",
        None,
        reason="no such scene is shipped, and 120,000 steps take hours; `rope`, `pile` and `twisting` are the "
        "longest runs here",
    ),
    _matter(36, "storm", "no intersection, finite"),
    _scene(37, "coincident", 100, "no intersection, layers in order, comes to rest"),
    _touch(38, "near_parallel_edges", "no intersection"),
    _touch(39, "corner_to_corner", "no intersection, the tip does not pass"),
    _touch(39, "corner_to_edge", "no intersection, the tip does not pass"),
    _touch(40, "edge_through_endpoint", "no intersection"),
    _touch(40, "grazing", "no intersection"),
    _matter(41, "t_junction", "the seam closes; no intersection (audit: sides of a seam may touch)"),
    _matter(41, "scale_error", "MeshError names the factor"),
    _mesh(42, "confetti", "1000 pieces: no intersection, none below the floor"),
    _go(43, "restart", "without contact: every bit"),
    _go(43, "restart_in_contact_block_jacobi", "with contact, block Jacobi: every bit"),
    _go(43, "restart_in_contact", "with contact, default solver: every bit"),
    _go(44, "thread_counts", "1, 2, 7 and 64 threads: same bits", backends=("cpu",)),
    _go(44, "same_as_cpu", "the bits of the CPU", backends=("opencl", "cuda")),
    Check(
        44,
        "several_devices",
        "1, 2 and 8 GPUs: same result",
        None,
        reason="a simulation runs on one device in this version",
    ),
    _input(45, "indices", "MeshError or ArrayError names the face"),
    Check(
        45,
        "twenty_million",
        "20M triangles run",
        None,
        reason="needs about 60 GB (3.1 kB a triangle were seen at 10,000); unit test "
        '"scan refuses a list of 2^31 entries" holds the limit by name',
    ),
)


def select(words=()):
    """Checks by number or name, in the order of the list; none: all.

    Raises KeyError with the word that is none of these.
    """
    if not words:
        return CHECKS
    for word in words:
        if not any(word in (c.name, str(c.number)) for c in CHECKS):
            raise KeyError(word)
    return tuple(c for c in CHECKS if c.name in words or str(c.number) in words)
