# SPDX-License-Identifier: Apache-2.0
"""The list of extreme cases: sizes, and what must hold at the end beside "no intersection at any step"."""

from dataclasses import dataclass
from typing import Callable

import numpy as np

from . import scenes, shapes


@dataclass(frozen=True)
class Case:
    """One case."""

    build: Callable  #: (resolution, seed) -> cama.Scene
    expect: Callable  #: Run -> list of complaints
    resolution: int = 1000  #: cloth triangles of the long test
    full: int = 20000  #: of a large run
    bound: float = 2.0  #: no cloth vertex farther from the origin along an axis, m
    error: str = ""  #: class of the error that must end the run
    words: str = ""  #: in that error's text
    hide: tuple = ()  #: obstacles left out of pictures
    look: tuple = (-60.0, 22.0)  #: azimuth and elevation of pictures, degrees


def _complain(*checks):
    return [text for holds, text in checks if not holds]


def _quiet(run, ratio):
    left = run.kinetic[-1] / max(run.kinetic)
    return left < ratio, f"kinetic energy at the end is {left:.2g} of its peak"


def order_along(run, center, directions):
    """Complaints about rays from `center` that meet the cloths in another order than theirs, from the first outward."""
    complaints, met = [], 0
    for d in directions:
        d = np.asarray(d, float) / np.linalg.norm(d)
        side = np.cross(d, [1, 0, 0] if abs(d[0]) < 0.8 else [0, 1, 0])
        side /= np.linalg.norm(side)
        basis = np.stack([side, np.cross(d, side), d])
        last = 0.0
        for k in range(len(run.scene.cloths)):
            vertices, faces = run.cloth(k)
            hits = shapes.heights((vertices - center) @ basis.T, faces, [(0, 0)])[0]
            hits = hits[hits > 0]
            if not len(hits):
                continue
            met += 1
            if hits[0] <= last:
                complaints.append(
                    f"along {np.round(d, 2).tolist()}: cloth {k} at {hits[0]:.5g} m is inside {last:.5g} m"
                )
            last = hits[-1]
    return complaints if met else ["no ray meets a cloth"]


def cone_of_directions(degrees, count=12):
    """The upward axis and `count` directions around it."""
    angle = 2 * np.pi * np.arange(count) / count
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return [(0.01, 0.02, 1)] + [(s * np.cos(a), s * np.sin(a), c) for a in angle]


def expect_nothing(run):
    return []


def expect_drape(run):
    return order_along(run, np.zeros(3), cone_of_directions(10) + cone_of_directions(35))


def expect_twisting(run):
    first = [a for a, _ in run.simulation.cloth_ranges]
    pinned = [first[p["cloth"]] + np.asarray(p["vertices"]) for p in run.scene.pins]
    held, ends = np.concatenate(pinned[:3]), np.concatenate(pinned[3:])
    turned = run.start[held] @ shapes.rotation((0, 0, 1), 2 * np.pi * 2.08).T
    gathered = (0, 0, 0.093) + 0.18 * (run.start[ends] - (0, 0, 0.993))
    return order_along(run, np.array([0, 0, 0.9]), cone_of_directions(10)) + _complain(
        (np.allclose(run.positions[held], turned, atol=1e-6), "the middle is not where the ball turned it"),
        (np.allclose(run.positions[ends], gathered, atol=1e-6), "the ends are not where they were led"),
    )


def expect_funnel(run):
    first, last = (run.cloth(0, p)[0][:, 2].mean() for p in (run.start, run.positions))
    return _complain((last < first - 0.2, f"the cloth fell by {first - last:.3g} m only"))


def expect_rope(run):
    """Ends where whole turns put them; the long edges wind about each other as often as the ends were turned."""
    rest = run.scene.cloths[0].material_vertices
    top, bottom = (np.flatnonzero(np.isclose(rest[:, 1], y)) for y in (rest[:, 1].max(), rest[:, 1].min()))
    top, bottom = top[np.argsort(rest[top, 0])], bottom[np.argsort(rest[bottom, 0])]
    winding = abs(shapes.gauss(run.positions[top], run.positions[bottom]).sum())
    ends = run.scene.pins
    moved = [run.positions[p["vertices"]] - run.start[p["vertices"]] for p in ends]
    return _complain(
        (9 <= winding <= 10.5, f"the edges wind about each other {winding:.3g} times, not 10"),
        (
            np.allclose(moved[0], [0.1, 0, 0], atol=1e-6) and np.allclose(moved[1], [-0.1, 0, 0], atol=1e-6),
            "the ends are not where ten turns put them",
        ),
    )


def _floor(run, least=0.0):
    """Cloth heights above a floor at z = 0."""
    low = run.positions[: run.simulation.cloth_vertex_count, 2].min()
    return low > least, f"a vertex is at z = {low:.3g} m"


def expect_pile(run):
    points = [(x, y) for x in (-0.05, 0.002, 0.05) for y in (-0.05, 0.001, 0.05)]
    complaints, inverted = [], 0
    for p in points:
        last = -np.inf
        for k in range(len(run.scene.cloths)):
            hits = shapes.heights(*run.cloth(k), [p])[0]
            inverted += len(hits) > 0 and hits[0] <= last
            last = hits[-1] if len(hits) else last
    if inverted:
        complaints.append(f"{inverted} places where a sheet is below one that was dropped under it")
    return complaints + _complain(_floor(run), _quiet(run, 0.05))


def _needles(run, tips):
    """Every needle that the cloth lay over is still under it, or the sheet's border slid over its tip."""
    vertices, faces = run.cloth(0)
    return [
        f"needle at {np.round(p, 3).tolist()}: cloth at {hits[0]:.4g} m, tip at {p[2]:.4g} m"
        for p, hits in zip(tips, shapes.heights(vertices, faces, tips[:, :2]))
        if len(hits) and hits[0] < p[2]
    ]


def _tips(run):
    vertices = run.scene.obstacles[0].vertices
    return vertices[vertices[:, 2] > vertices[:, 2].max() - 1e-9]


def expect_needle_bed(run):
    inner = [p for p in _tips(run) if np.abs(p[:2]).max() < 0.15]
    under = [len(h) > 0 for h in shapes.heights(*run.cloth(0), np.array(inner)[:, :2])]
    # The border hangs free around the needles and swings for a while; what they carry moves little with it.
    count, speed = run.simulation.cloth_vertex_count, np.linalg.norm(run.simulation.velocities, axis=1)
    carried = np.abs(run.positions[:count, :2]).max(axis=1) < 0.15
    moving = (run.simulation.masses * np.square(speed[:count]))[carried].sum() / 2 / max(run.kinetic)
    return _needles(run, _tips(run)) + _complain(
        _quiet(run, 0.05),
        (moving < 5e-3, f"what the needles carry has {moving:.2g} of the peak of kinetic energy at the end"),
        (all(under), "an inner needle is not under the cloth"),
    )


def expect_shot(run):
    strain = run.simulation.max_strain
    return _complain((strain < 0.5, f"stretched by {strain:.3g} at the end"))


def _between(run, low, high):
    z = run.positions[: run.simulation.cloth_vertex_count, 2]
    return (
        low < z.min() and z.max() < high,
        f"cloth from {z.min():.4g} to {z.max():.4g} m, plates at {low:.4g} and {high:.4g} m",
    )


def expect_press(run):
    return _complain(_between(run, 0, 4 * scenes.THICKNESS), _quiet(run, 1e-3))


def expect_press_tight(run):
    return _complain(_between(run, 0, 0.5 * scenes.THICKNESS))


def expect_clamp(run):
    return _complain(_quiet(run, 1e-2))


def expect_hole(run):
    """The hole is what it says, and all cloth is below the plate."""
    vertices = run.scene.obstacles[0].vertices
    radius = np.linalg.norm(vertices[:, :2], axis=1).min()
    share = np.pi * radius**2 / scenes.HOLE_SIDE**2
    high = run.positions[: run.simulation.cloth_vertex_count, 2].max()
    return _complain(
        (abs(share - scenes.HOLE_SHARE) < 1e-6, f"the hole has {share:.4g} of the sheet's area"),
        (high < -0.006, f"cloth is left at z = {high:.3g} m"),
    )


def center_line(run, positions):
    """[n, 3]: the middle of a strip whose rows are `columns + 1` vertices."""
    rest = run.scene.cloths[0].material_vertices
    across = len(np.unique(np.round(rest[:, 0], 9)))
    return positions[: len(rest)].reshape(-1, across, 3).mean(axis=1)


def expect_knot(run):
    before, after = (shapes.writhe(center_line(run, p)) for p in (run.start, run.positions))
    return _complain(
        (abs(before) > 3, f"writhe {before:.3g} at the start: no overhand knot"),
        (abs(after) > 2 and after * before > 0, f"writhe went from {before:.3g} to {after:.3g}: the knot is gone"),
    )


def expect_chain(run):
    def ring(k, positions):
        vertices = run.cloth(k, positions)[0]
        return vertices.reshape(3, -1, 3)[1]

    n = len(run.scene.cloths)
    links = [
        [shapes.linking(ring(a, p), ring(b, p)) for a in range(n) for b in range(a)] for p in (run.start, run.positions)
    ]
    expected = [1 if a - b == 1 else 0 for a in range(n) for b in range(a)]
    return _complain(
        (np.allclose(np.abs(links[0]), expected, atol=1e-6), f"linking numbers at the start: {links[0]}"),
        (np.allclose(links[1], links[0], atol=1e-6), f"linking numbers {links[0]} became {links[1]}"),
        _quiet(run, 0.1),  # the links swing: with steps of 1/1200 s they keep 0.07
    )


def expect_coincident(run):
    center = run.scene.obstacles[0].vertices.mean(axis=0)
    return order_along(run, center, cone_of_directions(10) + cone_of_directions(30)) + _complain(_quiet(run, 1e-2))


def expect_thick(run):
    return _complain(
        _floor(run),
        _quiet(run, 1e-2),
        (run.simulation.max_strain < 0.1, f"stretched by {run.simulation.max_strain:.3g} at rest"),
    )


def expect_stack(run):
    return _complain(_floor(run), _quiet(run, 1e-6))


CASES = {
    "sphere": Case(scenes.sphere, expect_nothing, 1500, 60000),
    "funnel": Case(scenes.funnel, expect_funnel, 1500, 60000),
    "drape": Case(scenes.drape, expect_drape, 1500, 60000),
    "twisting": Case(scenes.twisting, expect_twisting, 1500, 60000, bound=2.5),
    "rope": Case(scenes.rope, expect_rope, bound=0.5, look=(-70.0, 25.0)),
    "pile": Case(scenes.pile, expect_pile, 1600, 50000, bound=1.0),
    "needle_bed": Case(scenes.needle_bed, expect_needle_bed, bound=1.0, hide=("floor",)),
    "knife": Case(scenes.knife, expect_shot, bound=60.0),
    "needle_shot": Case(scenes.needle_shot, expect_shot, bound=60.0, hide=("floor",)),
    "press": Case(scenes.press, expect_press, bound=1.0, hide=("upper plate",), look=(-60.0, 35.0)),
    "press_tight": Case(scenes.press_tight, expect_press_tight, bound=1.0, hide=("upper plate",), look=(-60.0, 35.0)),
    "press_shut": Case(
        scenes.press_shut,
        expect_nothing,
        bound=1.0,
        error="CollisionError",
        words="pinch",
        hide=("upper plate",),
        look=(-60.0, 35.0),
    ),
    "clamp": Case(scenes.clamp, expect_clamp, bound=1.0, hide=("right",), look=(20.0, 15.0)),
    "hole": Case(scenes.hole, expect_hole, look=(-60.0, 10.0)),
    "knot": Case(scenes.knot, expect_knot, 900, 20000, bound=4.0),
    "chain": Case(scenes.chain, expect_chain, 900, 20000, bound=1.0),
    "coincident": Case(scenes.coincident, expect_coincident, bound=1.0),
    "thick": Case(scenes.thick, expect_thick, bound=1.0, hide=("floor",)),
    "bullet": Case(scenes.bullet, expect_shot, bound=60.0),
    "teleport": Case(scenes.teleport, expect_shot),
    "flip": Case(scenes.flip, expect_shot, bound=5.0),
    "stack": Case(scenes.stack, expect_stack, 1000, 4000, bound=1.0),
}
