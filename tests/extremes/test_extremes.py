# SPDX-License-Identifier: Apache-2.0
"""No intersection at any step of any extreme case, by cama's exact audit and by ipctk; and what each case must end
with.

The quick tests are short runs of small meshes; `-m long` runs every case with ten jittered starts.
"""

import numpy as np
import pytest

import cama
from cama.torture import judge, scenes, shapes
from cama.torture.meshes import GRAVITY, fallen
from cama.torture.scene_cases import CASES
from cama.torture.seeds import perform

REPEATS = 10

# name, cloth triangles, arguments of the case: what a short run needs to reach the hard part
QUICK = [
    ("knot", 480, {}),
    ("chain", 300, {}),
    ("needle_bed", 300, {}),
    ("knife", 300, {}),
    ("needle_shot", 200, {}),
    ("press_tight", 200, {}),
    ("press_shut", 100, {}),
    ("hole", 300, {}),
    ("coincident", 200, {}),
    ("rope", 200, {}),
    ("pile", 500, {"sheets": 5, "seconds": 0.6}),
    ("bullet", 100, {}),
    ("stack", 200, {"sheets": 3, "seconds": 2.0}),
]


def free_of_trouble(run, complaints):
    assert complaints == []
    assert len(run.audit) == len(run.referee) == len(run.reports) > 0
    assert max(run.audit) == max(run.referee) == 0


def check_case(name, *arguments, **options):
    run, complaints = perform(name, *arguments, **options)
    free_of_trouble(run, complaints)


@pytest.mark.parametrize("name, resolution, build", QUICK, ids=[q[0] for q in QUICK])
def test_small(name, resolution, build):
    check_case(name, 1, resolution, build=build)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(REPEATS))
@pytest.mark.parametrize("name", CASES)
def test_every_case(name, seed):
    check_case(name, seed)


@pytest.mark.parametrize("name", CASES)
def test_start_is_reproducible_and_jittered(name):
    first, again, other = (
        np.concatenate([c.vertices for c in CASES[name].build(200, seed).cloths]) for seed in (3, 3, 5)
    )
    assert np.array_equal(first, again)
    assert np.abs(first - other).max() > 1e-4


def test_sheets_at_distance_zero_are_refused():
    """E.4 10: every vertex of one sheet lies on one of the other; the error names both."""
    with pytest.raises(cama.CollisionError, match="intersections.*'lower'.*'upper'"):
        judge.run(scenes.touching(100), steps=0)


# The judges must be able to see.


def crossing():
    """Two sheets through each other, contact off."""
    scene = cama.Scene(gravity=(0, 0, 0), contact=False)
    mesh = shapes.sheet(0.2, 0.2, 50)
    scene.add_cloth(*mesh)
    scene.add_cloth(mesh[0] @ shapes.rotation((0, 1, 0), 1.2).T + [0.003, 0.004, 0.005], mesh[1])
    return scene


def test_judges_see_an_intersection():
    run = judge.run(crossing(), steps=1, stop=False)
    assert run.problems and run.referee[0] > 0 and run.audit[0] > 0


def test_judges_see_tunnelling():
    """A sheet thrown at the knife with nothing but forces against it is cut by it."""
    run = judge.run(scenes.knife(300), steps=10, bound=60.0, commit=False, max_impact_passes=0)
    assert max(run.audit) > 0 and max(run.referee) > 0


def test_order_is_seen_to_be_lost():
    scene = scenes.drape(300)
    run = judge.run(scene, steps=0)
    assert CASES["drape"].expect(run) == []
    first, last = run.simulation.cloth_ranges[0]
    upper = run.simulation.cloth_ranges[2]
    positions = run.simulation.positions[: run.simulation.cloth_vertex_count]
    positions[first:last, 2] += 1.0
    positions[upper[0] : upper[1], 2] -= 0.01
    run.simulation.set_state(positions, np.zeros_like(positions))
    assert CASES["drape"].expect(run)


# Measures against known values.


def test_linking_and_writhe_of_known_curves():
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.stack([np.cos(t), np.sin(t), 0 * t], 1)
    other = np.stack([1 + np.cos(t), 0 * t, np.sin(t)], 1)
    assert abs(shapes.linking(ring, other)) == pytest.approx(1, abs=1e-9)
    assert shapes.linking(ring, other + [3, 0, 0]) == pytest.approx(0, abs=1e-9)
    assert shapes.writhe(np.stack([t, 0 * t, 0 * t], 1)) == pytest.approx(0, abs=1e-9)
    assert (
        3 < abs(shapes.writhe(shapes.resample(shapes.overhand(), 300)[0])) < 3.5
    )  # ideal trefoil 3.4 (Katritch et al. 1996)


def test_heights_of_a_slope():
    vertices, faces = shapes.sheet(1, 1, 32)
    vertices[:, 2] = 0.5 + 0.3 * vertices[:, 0]
    found = shapes.heights(vertices, faces, [(0.21, 0.13), (2, 2)])
    assert found[0] == pytest.approx([0.563], abs=1e-12) and len(found[1]) == 0


# Contact that has nothing to do must do nothing.


def lost(run):
    return run.total("truncated"), run.total("lost_motion"), run.total("impacts")


def test_free_fall_is_not_held_up():
    scene = scenes.flight(400, 1, gravity=(0, 0, -9.81))
    run = judge.run(scene, bound=20.0, tolerance=1e-12)
    free_of_trouble(run, run.problems)
    n = len(run.reports)
    expected = run.start - [0, 0, fallen(run.simulation.options["integrator"], n, scene.time_step)]
    assert np.abs(run.positions - expected).max() < 1e-8  # of 12 m
    assert lost(run) == (0, 0, 0)


@pytest.mark.parametrize("speed", [1.0, 300.0])
def test_translation_is_not_held_up(speed):
    scene = scenes.flight(400, 2, velocity=(0.6 * speed, 0.0, -0.8 * speed))
    run = judge.run(scene, bound=2 * speed + 1)
    free_of_trouble(run, run.problems)
    moved = np.array([0.6, 0, -0.8]) * speed * scene.time_step * len(run.reports)
    assert np.abs(run.positions - run.start - moved).max() < 1e-9 * speed
    assert lost(run) == (0, 0, 0)


def turn(simulation, seconds):
    """Sets the sheet turning once a second about an axis in its plane; returns the angle, rad, and the angular momentum
    left, 1: all.
    """
    start, mass = simulation.positions, simulation.masses[:, None]
    middle = (mass * start).sum(0) / mass.sum()
    axis = start[1] - start[0]
    axis *= 2 * np.pi / np.linalg.norm(axis)
    simulation.set_state(start, np.cross(axis, start - middle))
    before = (mass * np.cross(start - middle, simulation.velocities)).sum(0)
    for _ in range(round(seconds / simulation.scene.time_step)):
        simulation.step()
        report = simulation.report
        assert (report["truncated"], report["lost_motion"], report["impacts"]) == (0, 0, 0)
    assert simulation.count_intersections() == 0
    end = simulation.positions
    assert np.abs((mass * end).sum(0) / mass.sum() - middle).max() < 1e-9
    after = (mass * np.cross(end - middle, simulation.velocities)).sum(0)
    normals = [np.cross(x[-1] - x[0], x[1] - x[0]) for x in (start, end)]
    angle = np.arctan2(np.dot(np.cross(*normals), axis) / np.linalg.norm(axis), np.dot(*normals))
    return angle, np.dot(after, before) / np.dot(before, before)


@pytest.mark.parametrize(
    "integrator, solves, order, most", [("backward_euler", 1, 1, 0.02), ("bdf2", 2, 2, 1e-5)], ids=["first", "second"]
)
def test_rotation_is_not_held_up(integrator, solves, order, most):
    """A quarter turn.

    Contact changes no bit; what is lost of the angular momentum is the integrator's, and goes with a power of the time
    step, its order: steps a fourth as long lose nearly a fourth, or a sixteenth.
    """
    left = []
    for step in (5e-3, 1.25e-3, 3.125e-4):
        scene = scenes.flight(100, 3)
        scene.time_step = step
        without = scene.copy()
        without._core.contact.enabled = False
        options = {"integrator": integrator, "newton_iterations": solves, "tolerance": 1e-9}
        simulations = [cama.Simulation(s, backend="cpu", threads=1, **options) for s in (scene, without)]
        (angle, momentum), _ = (turn(s, 0.25) for s in simulations)
        assert simulations[0].state_hash == simulations[1].state_hash
        left.append(1 - momentum)
    assert abs(angle) == pytest.approx(np.pi / 2, rel=0.02)
    assert left[0] > 3**order * left[1] > 9**order * left[2] and 0 <= left[2] < most


def speed_of_two(**options):
    """Mean speed of two sheets a micrometre apart, straight down, over g t after 15 steps, and across it.

    What they do to each other leaves it: BDF2 and backward Euler have g t exactly.
    """
    scene = scenes.coincident(300, 5)
    run = judge.run(scene, steps=15, **options)
    free_of_trouble(run, run.problems)
    n, mass = len(run.reports), run.simulation.masses
    count = len(mass)
    mean = (mass[:, None] * run.simulation.velocities[:count]).sum(0) / mass.sum()
    assert run.total("truncated") == 0
    across, down = np.linalg.norm(mean[:2]), -mean[2]
    return np.array([down, across]) / (GRAVITY * n * scene.time_step)


def test_sheets_a_micrometre_apart_fall_freely():
    assert speed_of_two(tolerance=1e-9) == pytest.approx([1, 0], abs=1e-3)


def test_sheets_a_micrometre_apart_fall_freely_by_default():
    """The penalty forces between them do not hide gravity from the default tolerance of the solve."""
    assert speed_of_two() == pytest.approx([1, 0], abs=0.02)


def test_stretched_cloth_recovers():
    free_of_trouble(*perform("teleport", 1, 100))


def test_a_pile_gains_no_energy():
    scene = scenes.pile(640, 0, sheets=20, seconds=0.5)
    simulation = cama.Simulation(scene, backend="cpu", threads=1)
    start = sum(simulation.energy().values())
    rises, last = 0.0, start
    for _ in range(scene.frames):
        simulation.step()
        now = sum(simulation.energy().values())
        rises, last = rises + max(0.0, now - last), now
    assert rises < 0.05 * start
