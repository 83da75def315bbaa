# SPDX-License-Identifier: Apache-2.0
"""Sewing patterns: curves and areas against closed forms, meshes, seams, and garments that are sewn on a body."""

import json
import math
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.sewing.curves import Arc, Bezier
from cama.sewing.meshing import edge_length_of, merge_map, mesh_pattern
from conftest import count_intersections

ROOT = Path(__file__).resolve().parents[2]
PATTERNS = ROOT / "scenes" / "patterns"
DATA = Path(os.environ.get("CAMA_TEST_DATA") or ROOT.parent / "shared" / "data") / "garments" / "garmentcode"
SHARED = sorted(DATA.glob("patterns/*.json")) + sorted(DATA.glob("*_specification.json"))


def one_panel(corners, curves=None, **more):
    panel = {"corners": corners, "curves": curves or {}}
    return cama.SewingPattern.parse({"panels": {"piece": panel}, **more})


def garmentcode(panels, stitches=(), **properties):
    """A specification as GarmentCode writes it."""
    known = {"curvature_coords": "relative", "normalize_panel_translation": False, "units_in_meter": 100}
    return {"pattern": {"panels": panels, "stitches": list(stitches)}, "properties": {**known, **properties}}


def square(size=1.0, **more):
    corners = [[0, 0], [size, 0], [size, size], [0, size]]
    edges = [{"endpoints": [k, (k + 1) % 4]} for k in range(4)]
    return {"vertices": corners, "edges": edges, "translation": [0, 0, 0], "rotation": [0, 0, 0], **more}


def areas(mesh):
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


# Curves.


@pytest.mark.parametrize("large, left", [(False, True), (False, False), (True, True), (True, False)])
def test_arc_is_on_its_circle(large, left):
    start, end, radius = np.array([0.2, 0.1]), np.array([1.1, 0.4]), 0.7
    arc = Arc(start, end, radius, large, left)
    points = arc.at(np.linspace(0, 1, 101))
    assert points[0] == pytest.approx(start) and points[-1] == pytest.approx(end)
    half = math.asin(np.linalg.norm(end - start) / 2 / radius)
    assert arc.length == pytest.approx(radius * (2 * math.pi - 2 * half if large else 2 * half))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps == pytest.approx(np.full(100, 2 * radius * math.sin(arc.length / radius / 200)))
    turns = np.diff(points[:-1], axis=0), np.diff(points[1:], axis=0)
    crossed = turns[0][:, 0] * turns[1][:, 1] - turns[0][:, 1] * turns[1][:, 0]
    assert np.all(crossed > 0) if left else np.all(crossed < 0)  # SVG's sweep flag, y up


def test_bezier_is_sampled_evenly_by_length():
    curve = Bezier(np.array([[0.0, 0], [1, 2], [2, 0]]))  # the parabola y = 2 x - x^2 from 0 to 2
    exact = math.sqrt(5) + 0.5 * math.asinh(2)
    assert curve.length == pytest.approx(exact, rel=1e-5)
    points = curve.at(np.linspace(0, 1, 33))
    assert points[:, 1] == pytest.approx(2 * points[:, 0] - points[:, 0] ** 2, abs=1e-12)
    reached = 2 * points[:, 0] - 2  # the length up to x is (F(2 x - 2) - F(-2)) / 2, F(u) = (u sqrt(1+u²) + asinh u)/2
    length = [0.25 * (u * math.hypot(1, u) + math.asinh(u)) + exact / 2 for u in reached]
    assert length == pytest.approx(np.linspace(0, 1, 33) * exact, abs=1e-5)


def test_areas_of_panels_are_those_of_closed_forms():
    rectangle = [[0, 0], [4, 0], [4, 1], [0, 1]]
    assert one_panel(rectangle).area == pytest.approx(4)
    bulge, half = 0.5, 2.0
    radius = (half**2 + bulge**2) / (2 * bulge)
    angle = 2 * math.asin(half / radius)
    segment = 0.5 * radius**2 * (angle - math.sin(angle))
    assert one_panel(rectangle, {"0": {"bulge": bulge}}).area == pytest.approx(4 + segment, rel=1e-5)
    assert one_panel(rectangle, {"0": {"bulge": -bulge}}).area == pytest.approx(4 - segment, rel=1e-5)
    parabola = 2 / 3 * 0.5 * 4 * 1  # of the triangle of its control points
    assert one_panel(rectangle, {"2": {"control": [[2, 2]]}}).area == pytest.approx(4 + parabola, rel=1e-5)
    disc = one_panel([[-1, 0], [1, 0]], {"0": {"bulge": 1}, "1": {"bulge": 1}})
    assert disc.area == pytest.approx(math.pi, rel=1e-4)
    assert disc.scaled(2, 3).area == pytest.approx(6 * math.pi, rel=1e-4)


def test_another_size_hangs_at_the_same_height():
    skirt = cama.SewingPattern.load("skirt")
    assert skirt.top == pytest.approx(1.06)  # the waist, in the file 106 cm
    assert skirt.scaled(1.1, 1.2).top == pytest.approx(1.2 * 1.06)
    larger = skirt.scaled(1.1, 1.2, top=skirt.top)
    assert larger.top == pytest.approx(1.06) and larger.area == pytest.approx(1.1 * 1.2 * skirt.area)
    with pytest.raises(cama.SceneError, match="top nan must be a height"):
        skirt.scaled(1.1, 1, top=float("nan"))


# Formats.


def test_units_axes_and_placement():
    panel = {"corners": [[0, 0], [10, 0], [10, 20], [0, 20]], "translate": [1, -30, 100], "rotate": [90, 0, 0]}
    pattern = cama.SewingPattern.parse({"units": "cm", "panels": {"front": panel}})
    placed = pattern.panels[0].place(np.array([[0.0, 0], [0.1, 0.2]]))
    assert placed == pytest.approx(np.array([[0.01, -0.3, 1.0], [0.11, -0.3, 1.2]]))
    panel["rotate"] = [90, 0, 180]  # the back: its right side faces +y
    back = cama.SewingPattern.parse({"units": "cm", "panels": {"back": panel}}).panels[0]
    assert back.place(np.array([[0.1, 0.2]])) == pytest.approx(np.array([[-0.09, -0.3, 1.2]]))
    assert back.rotation @ [0, 0, 1] == pytest.approx([0, 1, 0])


def test_garmentcode_is_read_with_y_up_in_centimetres():
    top = square(20.0, translation=[0, 100, 30])
    top["edges"][0]["curvature"] = {"type": "quadratic", "params": [[0.5, 0.25]]}
    top["edges"][1]["curvature"] = {"type": "circle", "params": [10.0, 0, 1]}
    top["edges"][2]["curvature"] = {"type": "cubic", "params": [[0.25, 0.0], [0.75, 0.0]]}
    low = square(20.0, rotation=[0, 90, 0])
    stitches = [[{"panel": "top", "edge": 0}, {"panel": "low", "edge": 2}]]
    stitches += [[{"panel": "top", "edge": 3}, {"panel": "low", "edge": 1}, "right_wrong"]]
    pattern = cama.SewingPattern.parse(garmentcode({"top": top, "low": low}, stitches))
    first, second = pattern.panels
    assert first.place(np.array([[0.0, 0.0]])) == pytest.approx(np.array([[0, -0.3, 1.0]]))
    assert second.place(np.array([[0.1, 0.0], [0.0, 0.1]])) == pytest.approx(np.array([[0, 0.1, 0], [0, 0, 0.1]]))
    assert first.edges[0].curve.at([0.5]) == pytest.approx(np.array([[0.1, 0.025]]), abs=1e-6)
    assert first.edges[1].length == pytest.approx(math.pi * 0.1)  # half a circle, to the outside
    assert first.edges[1].curve.at([0.5]) == pytest.approx(np.array([[0.3, 0.1]]))
    assert first.edges[2].length == pytest.approx(0.2)
    assert [seam.reversed for seam in pattern.seams] == [True, False]


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda d: d.pop("panels"), "is not a sewing pattern"),
        (lambda d: d.update(seam=[]), "unknown key 'seam'; did you mean 'seams'"),
        (lambda d: d.update(units="yard"), "units: 'yard' is none of"),
        (lambda d: d["seams"].append(["front.9", "back.0"]), "seam 3: panel 'front' has no edge '9'"),
        (lambda d: d["seams"].append(["fron.left", "back.0"]), "no panel 'fron'; did you mean 'front'"),
        (lambda d: d["seams"].append(["front.left", "back.waist", "flipped"]), "'flipped' must be"),
        (lambda d: d["seams"].append(["front.left", "front.waist"]), r"front, edge 1 \(left\) is sewn twice"),
        (lambda d: d["panels"]["front"].update(corners=[[0, 0], [1, "a"]]), "front': corners: .* finite"),
        (lambda d: d["panels"]["front"].update(corners=[[0, 0], [0, 0], [1, 1], [0, 1]]), "corners 0 and 1 are"),
        (lambda d: d["panels"]["front"].update(curves={"hem": {"radius": 1}}), "neither"),
        (lambda d: d["panels"]["front"].update(curves={"hemm": {"bulge": 1}}), "no edge 'hemm'; did you mean 'hem'"),
        (lambda d: d["panels"]["front"].update(rotate=[0, float("nan"), 0]), "rotate"),
        (lambda d: d.update(units="m"), "are the units right"),
    ],
)
def test_mistakes_in_a_pattern_are_named(change, words):
    data = json.loads((PATTERNS / "skirt.json").read_text())
    change(data)
    with pytest.raises(cama.SceneError, match=words):
        cama.SewingPattern.parse(data, "skirt")


def test_mistakes_in_garmentcode_are_named():
    open_ = square()
    open_["edges"].pop()
    with pytest.raises(cama.SceneError, match="panel 'a': the edges do not close"):
        cama.SewingPattern.parse(garmentcode({"a": open_}))
    with pytest.raises(cama.SceneError, match="stitch 0: there is no panel 'b'"):
        cama.SewingPattern.parse(garmentcode({"a": square()}, [[{"panel": "b", "edge": 0}, {"panel": "a", "edge": 0}]]))
    spline = square()
    spline["edges"][2]["curvature"] = {"type": "spline", "params": []}
    with pytest.raises(cama.SceneError, match="edge 2: curvature 'spline'"):
        cama.SewingPattern.parse(garmentcode({"a": spline}))


def test_shipped_patterns_have_names():
    for file in PATTERNS.glob("*.json"):
        assert cama.SewingPattern.load(file.stem).area == cama.SewingPattern.load(file).area > 0


def test_files_that_are_no_patterns(tmp_path):
    with pytest.raises(cama.FileError, match="nowhere"):
        cama.SewingPattern.load(tmp_path / "nowhere.json")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(cama.FileError, match="not JSON"):
        cama.SewingPattern.load(tmp_path / "broken.json")


# Meshes.


def check_mesh(mesh):
    """Triangles fill the panels, each edge of whose boundary has one triangle; seams pair vertices one to one."""
    for index, panel in enumerate(mesh.pattern.panels):
        faces = mesh.faces[mesh.panel_of_face == index]
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        _, counts = np.unique(edges, axis=0, return_counts=True)
        used = np.unique(faces)
        assert counts.max() == 2 and len(used) == np.count_nonzero(mesh.panel_of_vertex == index)
        assert len(used) - len(counts) + len(faces) == 1  # Euler: a disc
        signed = areas(mesh)[mesh.panel_of_face == index]
        assert np.all(np.sign(signed) == np.sign(panel.area))
        assert signed.sum() == pytest.approx(panel.area, rel=0.03)  # chords of curved edges
    uv = mesh.material[mesh.faces]
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    assert np.all(first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0])  # seen from the right side
    ranges = [mesh.material[mesh.panel_of_vertex == k, 0] for k in range(len(mesh.pattern.panels))]
    assert all(left.max() < right.min() for left, right in zip(ranges, ranges[1:]))  # side by side
    for seam, pairs in zip(mesh.pattern.seams, mesh.seam_pairs):
        assert len(set(pairs[:, 0])) == len(set(pairs[:, 1])) == len(pairs)
        for side, column in ((seam.first, 0), (seam.second, 1)):
            points = mesh.points[pairs[:, column]]
            points = points[::-1] if column and seam.reversed else points
            assert mesh.pattern.edge(side).curve.at([0, 1]) == pytest.approx(points[[0, -1]])


@pytest.mark.parametrize("name", ["skirt", "top"])
@pytest.mark.parametrize("triangles", [100, 1500])
def test_panels_are_meshed(name, triangles):
    pattern = cama.SewingPattern.load(PATTERNS / f"{name}.json")
    mesh = mesh_pattern(pattern, edge_length_of(pattern, triangles))
    check_mesh(mesh)
    assert len(mesh.faces) == pytest.approx(triangles, rel=0.3)
    assert mesh.min_angle() > 15


def test_a_straight_panel_is_filled_exactly():
    pattern = one_panel([[0, 0], [0.5, 0], [0.5, 0.3], [0.26, 0.3], [0.25, 0.1], [0.24, 0.3], [0, 0.3]])
    mesh = mesh_pattern(pattern, 0.02)
    assert areas(mesh).sum() == pytest.approx(0.5 * 0.3 - 0.5 * 0.02 * 0.2, rel=1e-9)  # a dart of 2 by 20 cm less
    check_mesh(mesh)


def test_seams_of_unequal_length_are_gathered_evenly():
    panels = {"long": {"corners": [[0, 0], [0.9, 0], [0.9, 0.2], [0, 0.2]]}}
    panels["short"] = {"corners": [[0, 0.3], [0.5, 0.3], [0.5, 0.5], [0, 0.5]]}
    mesh = mesh_pattern(cama.SewingPattern.parse({"panels": panels, "seams": [["long.2", "short.0"]]}), 0.05)
    check_mesh(mesh)
    long, short = mesh.points[mesh.seam_pairs[0][:, 0]], mesh.points[mesh.seam_pairs[0][:, 1]]
    assert long[:, 0] / 0.9 == pytest.approx(short[:, 0] / 0.5) and len(long) == 19
    joined, where = np.unique(mesh.merged(), return_index=True)
    sewn = trimesh.Trimesh(mesh.positions[where], mesh.merged()[mesh.faces], process=False)
    assert len(joined) == len(mesh.points) - 19
    assert sewn.is_winding_consistent and sewn.body_count == 1


def test_an_outline_that_crosses_itself_is_named():
    with pytest.raises(cama.MeshError, match="panel 'piece' cannot be meshed"):
        mesh_pattern(one_panel([[0, 0], [1, 0.5], [1, 0], [0, 0.6]]), 0.1)


def test_merged_vertices_are_components():
    assert merge_map(5, np.array([[0, 3], [3, 4]])).tolist() == [0, 1, 2, 0, 0]


@pytest.mark.skipif(not SHARED, reason=f"no patterns of GarmentCode in {DATA} (CAMA_TEST_DATA)")
def test_patterns_of_garmentcode_are_meshed():
    for file in SHARED:
        pattern = cama.SewingPattern.load(file)
        check_mesh(mesh_pattern(pattern, edge_length_of(pattern, 1500)))


# Garments.


@pytest.fixture(scope="module")
def skirt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("skirt")
    lines = []
    made = cama.dress(PATTERNS / "skirt.json", {"walker": {}}, triangles=300, output=folder, say=lines.append)
    return made, folder, lines


def test_a_skirt_is_sewn_and_comes_to_rest(skirt):
    made, _, lines = skirt
    verdict = made.verdict
    assert verdict.good and verdict.problems == [] and str(verdict).startswith("good")
    assert verdict.seam_gap == 0 and verdict.joined_gap <= 1e-3 and verdict.speed < 3e-3
    body = made.scene.obstacles[0]
    vertices = np.concatenate([made.positions, body.vertices])
    faces = np.concatenate([made.faces, body.faces + len(made.positions)])
    assert count_intersections(vertices, faces, len(made.positions)) == verdict.intersections == 0
    sewn = trimesh.Trimesh(made.positions, made.faces, process=False)
    assert sewn.is_winding_consistent and sewn.body_count == 1
    assert sewn.euler_number == 0  # an annulus: waist and hem
    assert 0.95 < made.positions[:, 2].max() < 1.15 and made.positions[:, 2].min() > 0.4  # it hangs on the hips
    outward = np.einsum("ij,ij->i", sewn.face_normals, sewn.triangles_center * [1, 1, 0])
    assert np.mean(outward > 0) > 0.95  # right side out
    assert made.scene.cloths[0].rest_area == pytest.approx(made.mesh.pattern.area, rel=0.02)
    assert made.scene.cloths[0].start_strain[0] > -0.3 and verdict.max_strain < 0.3
    assert sum(line.startswith("sewing") for line in lines) == made.sewing_phases


def test_what_is_written_can_be_run_and_viewed(skirt, tmp_path):
    made, folder, _ = skirt
    scene = cama.Scene.load(folder / "scene.json")
    assert scene.cloths[0].vertices == pytest.approx(made.positions, abs=1e-6)
    assert scene.cloths[0].material.density == cama.Material.fabric("cotton").density
    assert scene.cloths[0].material.mass_damping == 0
    simulation = cama.Simulation(scene, accuracy="preview", threads=1)
    assert all(frame.intersections == 0 for frame in simulation.frames(2))
    text = (folder / "garment.obj").read_text()
    assert [line for line in text.splitlines() if line.startswith("g ")] == ["g front", "g back"]
    fields = json.loads((folder / "summary.json").read_text())
    assert fields["good"] and fields["triangles"] == len(made.faces)
    with h5py.File(folder / "frames.h5") as file:
        positions, faces = file["positions"][:], file["faces"][:]
        assert len(positions) == 1 + made.sewing_phases + made.draping_phases
        assert not file["intersections"][:].any()
    assert np.array_equal(faces[: len(made.faces)], made.mesh.faces)
    count = len(made.mesh.points)
    assert positions[0, :count] == pytest.approx(made.mesh.positions, abs=1e-6)
    assert positions[-1, :count] == pytest.approx(made.positions[made.vertex_of], abs=1e-6)
    apart = np.linalg.norm(np.diff(positions[-1][made.mesh.pairs], axis=1), axis=2)
    assert apart.max() == 0


def test_a_skirt_that_is_too_small_is_a_failed_verdict_that_names_the_seam():
    pattern = cama.SewingPattern.load(PATTERNS / "skirt.json").scaled(0.7, 1)
    made = cama.dress(pattern, {"walker": {}}, triangles=60, fabric="denim", seconds=0.5)
    assert not made.verdict.good and made.verdict.seam_gap > 1e-3
    assert "did not close; seam" in str(made.verdict) and "front, edge" in str(made.verdict)


def test_bodies_of_other_units_and_without_a_body_size(tmp_path):
    from cama.sewing.wearer import _of_file

    vertices = [[0.0, 0, 0], [50, 0, 0], [0, 170, 0]]
    text = "".join("v {} {} {}\n".format(*v) for v in vertices) + "f 1 2 3\n"
    (tmp_path / "body.obj").write_text(text)
    assert _of_file(tmp_path / "body.obj", None, "y")["units"] == "cm"
    assert _of_file(tmp_path / "body.obj", "mm", "y")["units"] == "mm"
    (tmp_path / "body.obj").write_text(text.replace("170", "7"))
    with pytest.raises(cama.SceneError, match="7 units high"):
        _of_file(tmp_path / "body.obj", None, "y")


# Bodies that move once they are dressed.


@pytest.fixture(scope="module")
def figure():
    """The generated body as a mesh: vertices and faces."""
    body = cama.Body(triangles=6000, duration=0.1, samples_per_second=10)
    return body.vertices, body.faces


def moves_dressed(scene, frames):
    """Simulates a dressed body; returns how far the cloth came from the body's middle, m, and its largest strain."""
    simulation = cama.Simulation(scene, accuracy="interactive", threads=1)
    cloth, start = simulation.cloth_vertex_count, simulation.positions.copy()
    for frame in simulation.frames(frames):
        assert frame.intersections == 0
    x = simulation.positions
    assert count_intersections(x, simulation.faces, cloth) == 0
    assert np.linalg.norm(x[cloth:] - start[cloth:], axis=1).max() > 0.1  # the body has moved
    return x[:cloth], simulation.max_strain


def test_a_skirt_dances(tmp_path):
    body = cama.Body("dance", triangles=6000, lead_in=0.3)
    made = cama.dress("skirt", body, triangles=200, output=tmp_path, threads=1)
    assert made.verdict.good, str(made.verdict)
    scene = cama.Scene.load(tmp_path / "scene.json")
    assert scene.frames * scene.frame_time == made.scene.frames * made.scene.frame_time == pytest.approx(5)
    for each in (scene, made.scene):
        obstacle = each.obstacles[0]
        assert obstacle.vertices == pytest.approx(body.vertices, abs=1e-6)
        assert np.asarray(obstacle.motion.evaluate(1.0, obstacle.vertices)) == pytest.approx(
            cama.Body("dance", triangles=6000, lead_in=0.3, duration=1).positions[-1], abs=1e-3
        )
    cloth, strain = moves_dressed(scene, 40)
    assert 0.9 < cloth[:, 2].max() < 1.15 and strain < 0.3  # it stays on the hips, and is not torn


def test_a_mesh_that_is_dressed_walks(figure, tmp_path):
    made = cama.dress("top", figure, motion="walk", lead_in=0.3, triangles=200, output=tmp_path, threads=1)
    assert made.verdict.good, str(made.verdict)
    entry = json.loads((tmp_path / "scene.json").read_text())["obstacles"][0]
    assert entry["body"] == {"motion": "walk", "lead_in": 0.3, "file": "body.obj"}
    scene = cama.Scene.load(tmp_path / "scene.json")
    assert scene.obstacles[0].vertices == pytest.approx(figure[0], abs=1e-6)
    cloth, strain = moves_dressed(scene, 25)
    assert cloth[:, 2].max() > 1.3 and strain < 0.5  # it hangs from the shoulders


def meets(points, ways, corners):
    """Whether rays from points [n, 3] meet a triangle of corners [m, 3, 3] (Möller and Trumbore 1997)."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(ways[:, None], v)
    size = (across * u).sum(axis=2)
    from_a = points[:, None] - a
    first = (from_a * across).sum(axis=2) / size
    other = np.cross(from_a, u)
    second = (other * ways[:, None]).sum(axis=2) / size
    return ((first >= 0) & (second >= 0) & (first + second <= 1) & ((other * v).sum(axis=2) / size > 0)).any(axis=1)


def test_an_outfit_has_its_layers_in_order(tmp_path):
    """A wider skirt over a skirt: the wider one is outside."""
    under = cama.SewingPattern.load("skirt")
    made = cama.dress(
        [under, under.scaled(1.1, 1)], {"walker": {}}, fabric=["wool", "silk"], triangles=200, output=tmp_path
    )
    assert made.verdict.good, str(made.verdict)
    assert [cloth.name for cloth in made.scene.cloths] == ["skirt 1", "skirt 2"]
    assert [garment.name for garment in made.under] == ["skirt 1"] and made.name == "skirt 2"
    scene = cama.Scene.load(tmp_path / "scene.json")
    densities = [cloth.material.density for cloth in scene.cloths]
    assert densities == [cama.Material.fabric(name).density for name in ("wool", "silk")]
    inner, outer = scene.cloths
    assert inner.vertices == pytest.approx(made.under[0].positions, abs=1e-6)
    assert outer.vertices == pytest.approx(made.positions, abs=1e-6)
    low, high = outer.vertices[:, 2].min() + 0.1, outer.vertices[:, 2].max() - 0.1
    share = []
    for cloth, other in ((inner, outer), (outer, inner)):
        x = cloth.vertices[(cloth.vertices[:, 2] > low) & (cloth.vertices[:, 2] < high)]
        assert len(x) > 30
        outwards = x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None]
        share.append(meets(x, outwards, other.vertices[other.faces]).mean())
    assert share[0] > 0.98 and share[1] < 0.1  # the outer one is on the way out of the body, but for folds


def test_outfits_that_cannot_be_made():
    with pytest.raises(cama.SceneError, match="2 patterns and 3 fabrics"):
        cama.dress(["skirt", "top"], {"walker": {}}, fabric=["wool"] * 3)
    with pytest.raises(cama.SceneError, match="0 patterns"):
        cama.dress([], {"walker": {}})
    with pytest.raises(cama.SceneError, match="the body has its own"):
        cama.dress("skirt", cama.Body(triangles=6000, duration=0.1, samples_per_second=10), motion="walk")
    with pytest.raises(cama.SceneError, match="did you mean 'dance'"):
        cama.dress("skirt", {"walker": {}}, motion="danse")


def test_pairs_that_cannot_be_joined_stay_open_and_the_rest_is_joined(monkeypatch):
    """Untangling is made to fail while a middle pair is joined, as where an arm is in the seam."""
    from cama.sewing.wearer import Wearer
    from cama.sewing.work import Dressing

    strip = {"corners": [[0, 0], [0.5, 0], [0.5, 0.1], [0, 0.1]]}
    panels = {"low": strip, "high": {**strip, "translate": [0, 0.104, 0]}}
    pattern = cama.SewingPattern.parse({"panels": panels, "seams": [["low.2", "high.0"]]})
    wearer = Wearer(np.array([[0, 0, -9.0], [1, 0, -9], [0, 1, -9]]), np.array([[0, 1, 2]]), {}, {}, None)
    work = Dressing("garment", mesh_pattern(pattern, 0.025), wearer, cama.Material.fabric("cotton"), [], {}, None)
    along = work.positions[work.pairs[:, 0], 0]
    caught = work.pairs[np.argmin(np.abs(along - 0.25))]
    untangle = work._untangle

    def refuse(scene, *words):
        if work.vertex_of[caught[0]] == work.vertex_of[caught[1]]:
            raise cama.CollisionError("an arm is in the way")
        untangle(scene, *words)

    monkeypatch.setattr(work, "_untangle", refuse)
    monkeypatch.setattr(work, "_tangled", lambda scene: work.vertex_of[caught])
    assert work._join(1e-3) == 0 and work.open().all()  # they are 4 mm apart
    assert work._join(0.01) == len(work.pairs) - 1
    assert work.pairs[work.open()].tolist() == [caught.tolist()]
    assert work.gaps[~work.open()] == pytest.approx(0.004) and work.gaps[work.open()] == 0


def test_bands_close_after_they_are_sewn_to_what_holds_them():
    """Two cuffs of a sleeve: the ends of the cuffs, and no other seam."""
    from cama.sewing.order import ends_of_bands

    sleeve, cuff = [[0, 0.5], [0.4, 0.5], [0.4, 1], [0, 1]], [[0, 0], [0.2, 0], [0.2, 0.05], [0, 0.05]]
    panels = {name: {"corners": sleeve, "rotate": [90, 0, 0]} for name in ("front", "back")}
    panels.update({name: {"corners": cuff, "rotate": [90, 0, 0]} for name in ("cuff", "cuff back")})
    seams = [["front.1", "back.3"], ["front.0", "cuff.2"], ["back.0", "cuff back.2"], ["cuff.1", "cuff back.3"]]
    pattern = cama.SewingPattern.parse({"panels": panels, "seams": seams})
    mesh = mesh_pattern(pattern, 0.05)
    ends = {tuple(pair) for pair in np.sort(mesh.seam_pairs[3], axis=1)}
    assert {tuple(pair) for pair in mesh.pairs[ends_of_bands(mesh)]} == ends


def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    pattern = str(PATTERNS / "skirt.json")
    result = CliRunner().invoke(app, ["dress", pattern, "--body", "nobody.obj"])
    assert result.exit_code == 2 and "nobody.obj: there is no such file" in result.output
    result = CliRunner().invoke(app, ["dress", pattern, "--body", "walker", "--fabric", "silk", "--fabric", "wool"])
    assert result.exit_code == 2 and "1 pattern and 2 fabrics" in result.output
    result = CliRunner().invoke(app, ["dress", pattern, "--body", "walker", "--fabric", "coton"])
    assert result.exit_code == 2 and "did you mean 'cotton'" in result.output
    assert not Path("out").exists()
    arguments = ["dress", pattern, "--body", "walker", "--resolution", "200", "--seconds", "0.5", "-o", "skirt"]
    result = CliRunner().invoke(app, arguments)
    summary = json.loads(Path("skirt/summary.json").read_text())
    assert result.exit_code == (0 if summary["good"] else 1), result.output
    assert ("verdict" in result.output) and ("good" in result.output or "not at rest" in result.output)


@pytest.mark.long
@pytest.mark.skipif(not SHARED, reason=f"no patterns of GarmentCode in {DATA} (CAMA_TEST_DATA)")
@pytest.mark.parametrize("name", ["p04", "p16", "p18"])
def test_patterns_of_garmentcode_are_sewn(name):
    body = DATA / ("mean_all_apart.obj" if name == "p18" else "mean_all.obj")
    made = cama.dress(DATA / "patterns" / f"{name}_specification.json", body, triangles=2000)
    assert made.verdict.good, str(made.verdict)
