# SPDX-License-Identifier: Apache-2.0
"""Plastic bending and creases: what a strip keeps of a forced cylinder in closed form, meshes, backends and files."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cama

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import bending

LENGTH, STIFFNESS, YIELD = 0.1, 1e-4, 8.0  # m, N m, 1/m
DIRECTIONS = {"warp": (1.0, 0.0), "bias": (np.sqrt(0.5), np.sqrt(0.5))}


def fabric(yield_curvature=YIELD, hardening=0.0, poisson_ratio=0.0):
    material = cama.Material.isotropic(1e3, poisson_ratio, STIFFNESS, 0.2)
    material.yield_curvature, material.hardening, material.mass_damping = yield_curvature, hardening, 30.0
    return material


def cylinder(rest, curvature, direction=(1.0, 0.0)):
    """The strip bent to this curvature along a direction of its material space."""
    along, across = rest @ direction, rest @ (-direction[1], direction[0])
    return np.column_stack([np.sin(curvature * along) / curvature, across, (1 - np.cos(curvature * along)) / curvature])


def strip(kind="irregular", cells=32, material=None, **options):
    rest, faces = bending.mesh(kind, cells, cells // 2, LENGTH / cells)
    scene = cama.Scene(contact=False, gravity=(0, 0, 0))
    scene.add_cloth(
        np.column_stack([rest, 0 * rest[:, 0]]),
        faces,
        material=material or fabric(),
        material_vertices=rest,
        name="strip",
    )
    chosen = {"error": "", "time_step": 1 / 200, "backend": "cpu", **options}
    return rest, faces, cama.Simulation(scene, **chosen)


def bend(simulation, rest, curvature, direction=(1.0, 0.0), steps=10, start=0.0):
    """Holds the strip at curvatures from `start`, 1/m, to this one, and lets it come to rest."""
    everything = np.arange(len(rest))
    for k in range(steps):
        simulation.pin(everything, cylinder(rest, start + (curvature - start) * (k + 1) / steps, direction))
        simulation.step()
    simulation.step(2)


def let_go(simulation, rest, curvature, expected):
    """Unloads the strip to eleven tenths of the expected curvature and lets go of it.

    One that is let go all of a sudden is bent further by the wave that runs in from its ends (Audoly and Neukirch,
    Fragmentation of rods by cascading cracks, 2005), and keeps that.
    """
    bend(simulation, rest, 1.1 * expected, start=curvature)
    simulation.release(np.arange(len(rest)))
    simulation.step(200)
    return curvature_of(simulation.positions, rest)


def inside(rest, faces):
    """Triangles away from the free border, at which the moments vanish."""
    middle = rest[faces].mean(axis=1)
    size = rest.max(axis=0)
    return ((middle > 0.2 * size) & (middle < 0.8 * size)).all(axis=1)


def curvature_of(positions, rest):
    """1/m of a circle through the middle of the strip, seen along its width."""
    size = rest.max(axis=0)
    chosen = (np.abs(rest / size - 0.5) < 0.3).all(axis=1)
    (u, v), points = (rest[chosen] - size / 2).T, positions[chosen]
    width = np.linalg.lstsq(np.column_stack([v, np.ones(len(u)), u, u**2, u**3]), points, rcond=None)[0][0]
    width /= np.linalg.norm(width)
    one = np.cross(width, np.eye(3)[np.argmin(np.abs(width))])
    one /= np.linalg.norm(one)
    points = points - points.mean(axis=0)
    x, y = points @ one, points @ np.cross(width, one)
    a, b, c = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None)[0]
    return 1 / np.sqrt(c + a * a / 4 + b * b / 4)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
@pytest.mark.parametrize("hardening", [0.0, 0.4])
@pytest.mark.parametrize("curvature", [12.0, 24.0])
@pytest.mark.parametrize("kind", ["rising", "irregular", "equilateral"])
def test_a_strip_keeps_what_it_was_bent_beyond_yield(kind, curvature, hardening):
    """(1 - hardening) (curvature - yield curvature) along the strip, and no curvature across it: within 3 % of the
    forced curvature while it is held, and of the shape that it takes when it is let go."""
    rest, faces, simulation = strip(kind, material=fabric(hardening=hardening))
    bend(simulation, rest, curvature)
    expected = (1 - hardening) * (curvature - YIELD)
    kept = np.abs(simulation.plastic_curvature[inside(rest, faces)].mean(axis=0))
    np.testing.assert_allclose(kept, [expected, 0, 0], atol=0.03 * curvature)
    assert let_go(simulation, rest, curvature, expected) == pytest.approx(expected, abs=0.03 * curvature)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_what_a_strip_keeps_does_not_depend_on_the_size_of_the_cells():
    kept = []
    for cells in (16, 32, 48):
        rest, _, simulation = strip("irregular", cells)
        bend(simulation, rest, 24.0)
        kept.append(let_go(simulation, rest, 24.0, 16.0))
    assert kept == pytest.approx([16.0] * 3, rel=0.04)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_a_fold_on_the_bias_keeps_its_direction():
    """The plastic curvature is a tensor: along 45 degrees it is kept as (1/2, 1/2, 1)."""
    rest, faces, simulation = strip("rising", 32)
    bend(simulation, rest, 24.0, DIRECTIONS["bias"])
    kept = simulation.plastic_curvature[inside(rest, faces)].mean(axis=0)
    np.testing.assert_allclose(np.abs(kept), [8, 8, 16], atol=0.8)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_below_yield_a_strip_springs_back():
    rest, _, simulation = strip(material=fabric(poisson_ratio=0.3))
    bend(simulation, rest, 0.5 * YIELD)
    assert np.abs(simulation.plastic_curvature).max() == 0
    simulation.release(np.arange(len(rest)))
    simulation.step(200)
    assert simulation.energy()["bending"] < 1e-3 * STIFFNESS / 2 * (0.5 * YIELD) ** 2 * LENGTH**2 / 2


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
@pytest.mark.parametrize("hardening", [0.0, 0.4])
def test_bending_back_follows_kinematic_hardening(hardening):
    """Bent to 24 the strip has the plastic curvature (1 - h) 16 and the back curvature h 16; bent back to 0 it yields
    beyond the yield curvature on the other side, by 16 - 8, and keeps (1 - h) (16 - 8)."""
    rest, faces, simulation = strip("rising", material=fabric(hardening=hardening))
    bend(simulation, rest, 24.0)
    bend(simulation, rest, 1e-6, start=24.0)
    kept = np.abs(simulation.plastic_curvature[inside(rest, faces)].mean(axis=0))
    np.testing.assert_allclose(kept, [(1 - hardening) * 8, 0, 0], atol=0.6)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_energy_ends_at_yield():
    """D / 2 times the yield curvature squared, per area; the free border has less (test_bending.py)."""
    rest, _, simulation = strip(cells=48)
    bend(simulation, rest, 24.0, steps=4)
    simulation.step(20)  # held
    assert simulation.energy()["bending"] == pytest.approx(STIFFNESS / 2 * YIELD**2 * LENGTH**2 / 2, rel=0.08)


def folded(angle, kind="alternating", cells=16, line=None, **arguments):
    rest, faces = bending.mesh(kind, cells, cells // 2, LENGTH / cells)
    scene = cama.Scene(contact=False, gravity=(0, 0, 0))
    start = np.column_stack([rest, 0 * rest[:, 0]])
    sheet = scene.add_cloth(start, faces, material=fabric(0.0), material_vertices=rest, name="sheet")
    along = np.flatnonzero(np.abs(rest[:, 0] - LENGTH / 2) < 1e-9)
    if line:
        scene.crease(sheet, line=line, angle=angle)
    else:
        scene.crease(sheet, along[np.argsort(rest[along, 1])], angle=angle)
    return rest, faces, scene


@pytest.mark.parametrize("cells", [8, 16])
@pytest.mark.parametrize("kind", ["alternating", "rising"])
@pytest.mark.parametrize("angle", [90.0, -90.0, 20.0, 0.0])
def test_a_creased_sheet_comes_to_rest_at_its_angle(kind, cells, angle):
    """Between the normals of its halves; above 0 the crease is a ridge on the side of the normals."""
    rest, faces, scene = folded(angle, kind, cells)
    simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu")
    simulation.step(300)
    x = simulation.positions
    assert np.linalg.det([rest[faces[0, 1]] - rest[faces[0, 0]], rest[faces[0, 2]] - rest[faces[0, 0]]]) != 0
    corners = x[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    left = rest[faces].mean(axis=1)[:, 0] < LENGTH / 2
    one, other = (normals[chosen].sum(axis=0) for chosen in (left, ~left))
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    found = np.degrees(np.arccos(np.clip(one @ other, -1, 1)))
    assert found == pytest.approx(abs(angle), abs=max(0.02 * abs(angle), 0.1))
    ridge = x[np.abs(rest[:, 0] - LENGTH / 2) < 1e-9].mean(axis=0) - x.mean(axis=0)
    if angle:
        assert np.sign(ridge @ (one + other)) == np.sign(angle)


def test_a_crease_by_a_line_is_that_of_its_vertices():
    positions = []
    for line in (None, [(LENGTH / 2, 0, 0), (LENGTH / 2, LENGTH / 2, 0)]):
        _, _, scene = folded(60.0, line=line)
        simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu")
        simulation.step(5)
        positions.append(simulation.positions.copy())
    assert np.array_equal(*positions)
    assert np.ptp(positions[0][:, 2]) > 1e-4


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
def test_plastic_bending_has_the_same_bits_on_every_backend_and_number_of_threads(precision):
    states = []
    for backend, threads in (("cpu", 1), ("cpu", 2), ("opencl", 0)):
        rest, _, simulation = strip(cells=24, backend=backend, precision=precision, threads=threads)
        bend(simulation, rest, 24.0, steps=2)
        simulation.release(np.arange(len(rest)))
        simulation.step(2)
        states.append((simulation.positions.copy(), simulation.plastic_curvature))
    for other in states[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(states[0], other))
    assert np.abs(states[0][1]).max() > 10


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_a_checkpoint_holds_the_plastic_curvature(tmp_path):
    def run(break_at):
        rest, _, simulation = strip(cells=8)
        bend(simulation, rest, 24.0, steps=2)
        simulation.release(np.arange(len(rest)))
        if break_at:
            kept = simulation.plastic_curvature
            simulation.save_checkpoint(tmp_path / "c.h5")
            simulation = strip(cells=8)[2]
            simulation.load_checkpoint(tmp_path / "c.h5")
            assert np.array_equal(simulation.plastic_curvature, kept)
            assert np.abs(kept).max() > 10
        simulation.step(3)
        return simulation.positions.copy()

    assert np.array_equal(run(False), run(True))


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_earlier_checkpoints_have_no_plastic_curvature():
    rest, _, simulation = strip(cells=8)
    bend(simulation, rest, 24.0, steps=2)
    fields = simulation._core.checkpoint()
    del fields["vectors"]["plastic_curvature"]
    simulation._core.restore(fields)
    assert np.abs(simulation.plastic_curvature).max() == 0
    fields["vectors"]["plastic_curvature"] = np.zeros((3, 3))
    with pytest.raises(cama.SceneError, match="plastic_curvature has 3 rows"):
        simulation._core.restore(fields)


def test_yield_and_creases_are_in_scene_files(tmp_path):
    _, _, scene = folded(35.0)
    scene.save(tmp_path / "scene.json")
    again = cama.Scene.load(tmp_path / "scene.json")
    assert again.to_json() == scene.to_json()
    assert '"angle":35' in scene.to_json().replace(" ", "")
    text = (
        '{"cloth": [{"name": "sheet", "grid": {"size": [0.2, 0.2]}, "triangles": 200, '
        '"material": {"fabric": "cotton", "yield_curvature": 50, "hardening": 0.25}}]}'
    )
    material = cama.Scene.parse(text).cloths[0].material
    assert (material.yield_curvature, material.hardening) == (50, 0.25)


def test_bad_yield_and_creases_are_named():
    bad = (("yield_curvature", -1.0), ("yield_curvature", np.inf), ("hardening", 1.0), ("hardening", -0.1))
    for field, value in bad:
        material = fabric()
        setattr(material, field, value)
        with pytest.raises(cama.MaterialError, match=field):
            strip(cells=8, material=material)
    with pytest.raises(cama.MaterialError, match="yield_curvature needs the option bending = plate"):
        strip(cells=8, bending="hinge")
    rest, _, scene = folded(30.0)
    sheet = scene.cloths[0]
    with pytest.raises(cama.SceneError, match=r"creases\[1\]: the pair of vertices 0 and 40: .*not joined by an edge"):
        scene.crease(sheet, [0, 40], angle=30.0)
        cama.Simulation(scene)
    _, _, scene = folded(30.0)
    with pytest.raises(cama.SceneError, match=r"creases\[1\]: .*at the border"):
        scene.crease(scene.cloths[0], [0, 1], angle=30.0)
        cama.Simulation(scene)
    _, _, scene = folded(200.0)
    with pytest.raises(cama.SceneError, match=r"creases\[0\]\.angle"):
        cama.Simulation(scene)
    with pytest.raises(cama.SceneError, match="0 vertices on it"):
        folded(30.0, line=[(0, 0, 1), (0, 1, 1)])
    with pytest.raises(cama.SceneError, match="exactly one"):
        scene.crease(scene.cloths[0], angle=30.0)
    with pytest.raises(cama.ArrayError, match="crease: angle"):
        scene.crease(scene.cloths[0], [0, 1], angle=float("nan"))


def test_the_example_crumples_linen(tmp_path):
    """What it prints: linen that yields lies many times as high as linen that does not, and nothing is pierced."""
    example = Path(__file__).parents[2] / "examples" / "11_crumple.py"
    done = subprocess.run(
        [sys.executable, str(example), "--triangles", "1500"], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    claims = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    elastic, plastic = (float(part.split()[0]) for part in claims["height"].split(", "))
    assert plastic > 3 * elastic > 0
    assert claims["intersections"] == "0"
