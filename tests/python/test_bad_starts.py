# SPDX-License-Identifier: Apache-2.0
"""Starts that intersect: report, mesh, command and untangling, judged by ipctk; garments where the test data is."""

import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama import _core
from cama.cli import app
from conftest import count_intersections, grid

GARMENTS = Path(os.environ.get("CAMA_TEST_DATA") or Path(__file__).parents[2].parent / "shared" / "data") / "garments"


def judged(scene):
    """Intersections of the start by ipctk."""
    parts = [*scene.cloths, *scene.obstacles]
    start = np.cumsum([0] + [len(p.vertices) for p in parts])
    vertices = np.concatenate([p.vertices for p in parts])
    faces = np.concatenate([p.faces + first for p, first in zip(parts, start)])
    return count_intersections(vertices, faces, start[len(scene.cloths)])


def crossing(seed=0):
    """A sheet cuts into a ball, and a second one into the first."""
    random = np.random.default_rng(seed)
    vertices, faces = grid(16, 0.4)
    scene = cama.Scene()
    scene.add_cloth(vertices + random.uniform(-1e-3, 1e-3, vertices.shape) + [0, 0, 0.13], faces, name="sheet")
    upright = np.stack([vertices[:, 2] + 0.1, vertices[:, 1] * 0.4, vertices[:, 0] + 0.315], 1)
    scene.add_cloth(upright + random.uniform(-1e-3, 1e-3, vertices.shape), faces, name="upright")
    scene.add_obstacle(shape={"sphere": {"radius": 0.15, "triangles": 720}}, name="ball")
    return scene


def test_report_names_objects_primitives_and_places():
    scene = crossing()
    found = scene.intersections()
    assert {(p.first_name, p.second_name) for p in found} == {
        ("cloth 'sheet'", "cloth 'upright'"),
        ("cloth 'sheet'", "obstacle 'ball'"),
    }
    assert sum(p.count for p in found) == judged(scene) > 0
    parts = [*scene.cloths, *scene.obstacles]
    for pair in found:
        assert pair.edge.shape == (pair.count, 2) and pair.place.shape == (pair.count, 3)
        for e_object, edge, f_object, face, place in zip(
            pair.edge_object, pair.edge, pair.face_object, pair.face, pair.place
        ):
            p, q = parts[e_object].vertices[edge]
            a, b, c = parts[f_object].vertices[parts[f_object].faces[face]]
            assert np.linalg.norm(np.cross(q - p, place - p)) < 1e-12  # on the edge
            assert abs(np.dot(np.cross(b - a, c - a), place - a)) < 1e-12  # in the face's plane
        assert (pair.bounds[0] <= pair.mean).all() and (pair.mean <= pair.bounds[1]).all()


@pytest.mark.parametrize("seed", range(5))
def test_untangled_start_is_clean_for_ipctk(seed):
    scene = crossing(seed)
    before = judged(scene)
    starts = [c.vertices for c in scene.cloths]
    report = scene.untangle()
    assert report.clean and report.before == before and report.after == 0 and 0 < report.smallest_gap <= 1e-4
    assert judged(scene) == 0 and scene.intersections() == []
    moves = np.concatenate([np.linalg.norm(c.vertices - v, axis=1) for c, v in zip(scene.cloths, starts)])
    assert report.moved == (moves > 0).sum() < len(moves)
    assert report.largest_move == pytest.approx(moves.max()) and moves.max() < 5 * 0.4 / 16


def test_policies():
    scene = crossing()
    with pytest.raises(
        cama.CollisionError, match="cloth 'sheet' with obstacle 'ball'.*cama check SCENE --mesh.*untangle"
    ):
        cama.Simulation(scene)
    assert cama.Simulation(scene, intersections="exempt").count_intersections() == judged(scene)
    simulation = cama.Simulation(scene, intersections="untangle", threads=1)
    assert simulation.untangled.clean and simulation.count_intersections() == 0
    assert all(frame.intersections == 0 for frame in simulation.frames(10))
    assert (scene.cloths[0].vertices == crossing().cloths[0].vertices).all()  # the caller's scene stays
    with pytest.raises(cama.SceneError, match="reject, exempt or untangle"):
        cama.Simulation(scene, intersections="ignore")


def test_meshes_have_a_group_per_pair(tmp_path):
    import pyvista

    scene = crossing()
    scene.save_intersections(tmp_path / "guilty.ply")
    scene.save_intersections(tmp_path / "guilty.obj")
    text = (tmp_path / "guilty.obj").read_text()
    assert text.count("\ng ") == 2
    mesh = pyvista.read(tmp_path / "guilty.ply")
    assert mesh.n_cells == text.count("\nf ") > 0
    with pytest.raises(cama.FileError, match="stl"):
        scene.save_intersections(tmp_path / "guilty.stl")


def test_check_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    crossing().save("scene.json")
    result = CliRunner().invoke(app, ["check", "scene.json", "--mesh", "guilty.ply"])
    assert result.exit_code == 1, result.output
    assert "cloth 'sheet' with obstacle 'ball'" in result.output and (tmp_path / "guilty.ply").stat().st_size > 1000
    run = CliRunner().invoke(app, ["run", "scene.json", "--frames", "1", "--intersections", "untangle", "-o", "out"])
    assert run.exit_code == 0 and "start untangled" in run.output, run.output


def garment(name):
    scene = cama.Scene()
    if name == "dress_knife":
        folder = GARMENTS / "codim"
        if not (folder / "dress_knife_stage.obj").exists():
            pytest.skip(f"no test data in {folder}")
        stage, drape = (
            _core.load_mesh(folder / f"dress_knife_{part}.obj", 1.0, part == "stage", 1.0)
            for part in ("stage", "drape_with_body")
        )
        scene.add_cloth(
            drape.vertices[: len(stage.vertices)],
            stage.faces,
            material_vertices=stage.material_vertices,
            material_faces=stage.material_faces,
            name="garment",
        )
        return scene
    folder = GARMENTS / "garmentcode"
    if not (folder / f"{name}_m.obj").exists():
        pytest.skip(f"no test data in {folder}")
    scene.add_cloth(folder / f"{name}_m.obj", rest="uv", name="garment")
    scene.add_obstacle(folder / "mean_all.obj", name="body")
    return scene


@pytest.mark.long
@pytest.mark.parametrize("name, least", [("shirt_mean", 400), ("dress_pencil", 80), ("dress_knife", 500)])
def test_garments(name, least):
    scene = garment(name)
    assert judged(scene) >= least
    report = scene.untangle()
    assert report.clean and report.before >= least
    assert judged(scene) == 0
