# SPDX-License-Identifier: Apache-2.0
"""The shipped scenes: valid by the published schema, free of intersections as ipctk sees it."""

import json

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama import shipped
from cama.cli import app
from conftest import count_intersections, judge

OUTFITS = {"andy": 3000, "bishop": 2500, "falling": 1500, "dryer": 4500}  # whose garments have a least size: triangles
SCENES = [*OUTFITS, "dance", "drape", "flag", "funnel", "garment", "pile", "sphere", "twisting"]


def test_all_are_there():
    assert set(SCENES) <= set(cama.scenes())


@pytest.mark.parametrize("name", SCENES)
def test_agrees_with_the_schema(name):
    schema = json.loads((shipped.folder() / "schema.json").read_text())
    jsonschema.validators.validator_for(schema).check_schema(schema)
    jsonschema.validate(json.loads((shipped.folder() / name / "scene.json").read_text()), schema)


@pytest.mark.parametrize("name", SCENES)
def test_has_the_size_asked_for(name):
    asked = OUTFITS.get(name, 1500)
    scene = cama.Scene.load(name, asked)
    scene.validate()
    assert scene.name == name and scene.description
    assert 0.6 * asked < scene.triangle_count < 1.6 * asked


def run(name, resolution, frames, folder):
    words = ["run", name, "--resolution", str(resolution), "-o", str(folder)] + (
        ["--frames", str(frames)] if frames else []
    )
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize("name", [name for name in SCENES if name not in OUTFITS])
def test_starts_without_intersections_and_keeps_so(name, tmp_path):
    summary = run(name, 800, 40, tmp_path)
    assert judge(tmp_path, every=4) == 0
    assert summary["intersections"] == 0


BACKENDS = [row["name"] for row in cama.backends() if row["available"] and row["name"] != "cuda"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", OUTFITS)
def test_outfits_start_without_intersections_and_keep_so(name, backend):
    """The paper's scenes with garments, at the default level, judged in every frame by the audit and by ipctk."""
    scene = cama.Scene.load(name, OUTFITS[name])
    simulation = cama.Simulation(scene, backend=backend)
    start = simulation.positions
    for frame in simulation.frames(5):
        assert frame.intersections == 0, frame.index
        assert count_intersections(frame.positions, simulation.faces, simulation.cloth_vertex_count) == 0, frame.index
    assert np.abs(simulation.positions - start)[: simulation.cloth_vertex_count].max() > 5e-3, "it moves"


@pytest.mark.long
@pytest.mark.parametrize(
    "name, resolution",
    [
        *OUTFITS.items(),
        ("sphere", 20000),
        ("drape", 20000),
        ("funnel", 5000),
        ("twisting", 5000),
        ("garment", 8000),
        ("flag", 4000),
    ],
)
def test_keeps_free_of_intersections_for_its_whole_length(name, resolution, tmp_path):
    summary = run(name, resolution, 0, tmp_path)
    assert judge(tmp_path, every=5) == 0
    assert summary["intersections"] == 0


def azimuths(simulation):
    x = simulation.positions
    return np.arctan2(x[:, 1], x[:, 0])


def winding(simulation, turned):
    """Degrees by which the ring around a layer's middle has turned against its rim, for each layer.

    turned: of every vertex about the z axis, rad. Means over the vertices of ring and rim; the rim of a strip is its
    two ends.
    """
    degrees = []
    for cloth, (first, end) in zip(simulation.scene.cloths, simulation.cloth_ranges):
        rest = cloth.material_vertices - cloth.material_vertices.mean(axis=0)
        from_middle, far = np.hypot(*rest.T), np.abs(rest).max(axis=1)
        ring = (from_middle > 0.01) & (from_middle < 0.12)
        rim = far > far.max() - 1e-6
        part = turned[first:end]
        degrees.append(np.degrees(part[ring].mean() - part[rim].mean()))
    return degrees


@pytest.mark.parametrize(
    "resolution, level, strain",
    [
        (1500, "interactive", 0.8),  # long steps stretch single triangles
        pytest.param(1500, "production", 0.35, marks=pytest.mark.long),
        pytest.param(1500, "paper", 1, marks=pytest.mark.long),
        pytest.param(5000, "interactive", 1, marks=pytest.mark.long),
        pytest.param(5000, "production", 0.3, marks=pytest.mark.long),
        pytest.param(5000, "paper", 1, marks=pytest.mark.long),
        pytest.param(20000, "interactive", 0.7, marks=pytest.mark.long),
    ],
)
def test_twisting_winds_every_layer_by_more_than_two_turns(resolution, level, strain):
    scene = cama.Scene.load("twisting", resolution)
    simulation = cama.Simulation(scene, accuracy=level, threads=1)
    turned, before, most = 0, azimuths(simulation), 0
    for frame in simulation.frames(scene.frames, audit=False):
        now = azimuths(simulation)
        turned = turned + (now - before + np.pi) % (2 * np.pi) - np.pi
        before = now
        most = max(most, simulation.max_strain)
        assert simulation.count_intersections() == 0, f"frame {frame.index}"
    assert simulation.time == pytest.approx(3)
    assert min(winding(simulation, turned)) > 720, winding(simulation, turned)
    assert most < strain
    middles = [
        simulation.positions[np.asarray(pin["vertices"]) + simulation.cloth_ranges[pin["cloth"]][0]]
        for pin in scene.pins[:3]
    ]
    assert middles[0][:, 2].max() < middles[1][:, 2].min() < middles[1][:, 2].max() < middles[2][:, 2].min()


@pytest.mark.parametrize("resolution", [2052, *(pytest.param(n, marks=pytest.mark.long) for n in (5000, 20000))])
def test_funnel_lets_the_cloth_through(resolution):
    scene = cama.Scene.load("funnel", resolution)
    simulation = cama.Simulation(scene, accuracy="interactive", threads=1)
    end_of_tube = scene.obstacles[0].vertices[:, 2].min()
    assert end_of_tube < -0.3
    cloth = slice(0, simulation.cloth_vertex_count)
    assert simulation.positions[cloth, 2].min() > 0.6, "it starts above the funnel"
    for _ in simulation.frames(scene.frames, audit=False):
        if simulation.positions[cloth, 2].max() < end_of_tube:
            break
    assert simulation.positions[cloth, 2].max() < end_of_tube, "it all comes out below"
    assert simulation.count_intersections() == 0
