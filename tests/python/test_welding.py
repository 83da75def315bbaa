# SPDX-License-Identifier: Apache-2.0
"""Meshes whose triangles share no vertices are welded; judged by trimesh and by counting."""

import json

import numpy as np
import pytest
import trimesh

import cama
from conftest import grid
from test_plausibility import apart
from test_rest_shape import from_json, from_python, obj


def add(vertices, faces, weld=True, **more):
    made = cama.Scene()
    return made.add_cloth(vertices, faces, weld=weld, name="sheet", **more)


def test_triangles_apart_become_the_sheet_they_were_cut_from():
    vertices, faces = grid(8)
    cloth = add(*apart(vertices, faces))
    assert cloth.vertices.shape == (81, 3)
    assert (cloth.vertices[cloth.faces] == vertices[faces]).all()  # every triangle where it was
    judge = trimesh.Trimesh(*apart(vertices, faces), process=False)
    judge.merge_vertices()
    assert len(judge.vertices) == len(cloth.vertices)
    assert cama.Simulation(cloth._scene, backend="cpu", threads=1).count_intersections() == 0


def test_vertices_are_in_the_order_of_their_first():
    vertices, faces = apart(*grid(2))
    expected = list(dict.fromkeys(map(tuple, vertices)))
    assert [tuple(v) for v in add(vertices, faces).vertices] == expected


def test_without_weld_nothing_changes():
    for weld in (False, None):
        assert len(add(*apart(*grid(4)), weld=weld).vertices) == 96


def test_rounding_is_welded_and_more_is_not():
    vertices, faces = apart(*grid(4))
    random = np.random.default_rng(3)
    direction = random.normal(size=vertices.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    assert len(add(vertices + 4e-7 * direction, faces).vertices) == 25  # pairs within 0.8 of a millionth
    assert len(add(vertices + 1e-4 * direction, faces).vertices) == 96
    assert len(add(vertices + 1e-4 * direction, faces, weld=3e-4).vertices) == 25
    assert len(add(vertices, faces, weld=0.0).vertices) == 25


def test_the_distance_is_in_metres_after_scale():
    vertices, faces = apart(*grid(4))
    shifted = vertices + np.linspace(0, 1e-4, len(vertices))[:, None]
    assert len(add(shifted, faces, weld=2e-3, scale=10).vertices) == 25
    assert len(add(shifted, faces, weld=1e-6, scale=10).vertices) == 96


def test_triangles_that_collapse_are_left_out():
    vertices, faces = grid(2)
    vertices = np.concatenate([vertices, vertices[:1] + [0, -1e-9, 0]])
    faces = np.concatenate([faces, [[0, 9, 3]]])
    cloth = add(vertices, faces)
    assert cloth.vertices.shape == (9, 3) and cloth.faces.shape == (8, 3)


def test_material_coordinates_stay():
    vertices, faces = grid(4)
    flat, own = apart(vertices, faces)
    cloth = add(flat, own, material_vertices=flat[:, :2])
    assert len(cloth.vertices) == 25
    np.testing.assert_array_equal(cloth.material_vertices[cloth.material_faces], vertices[faces][:, :, :2])
    assert cloth.rest_area == pytest.approx(1.0)


def test_a_file_and_its_stitches(tmp_path):
    """Two squares that share an edge but no vertex; two stitches sew the edge, one sews corners that are apart."""
    corners = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (2, 0), (2, 1), (1, 1)]
    lines = [f"v {x} {y} 0" for x, y in corners] + ["f 1 2 3", "f 1 3 4", "f 5 6 7", "f 5 7 8"]
    lines += ["stitch 1 4 4 0", "stitch 2 7 7 0", "stitch 0 5 5 0"]
    path = tmp_path / "squares.obj"
    path.write_text("\n".join(lines) + "\n")
    plain, joined = cama.Scene(), cama.Scene()
    assert len(plain.add_cloth(path).vertices) == 8 and plain.stitch_count == 3
    assert len(joined.add_cloth(path, weld=True).vertices) == 6 and joined.stitch_count == 1
    joined.validate()


def test_obstacles():
    vertices, faces = apart(*grid(4))
    made = cama.Scene()
    assert len(made.add_obstacle(vertices, faces, weld=True, motion={"velocity": (1, 0, 0)}).vertices) == 25
    assert len(made.add_obstacle(vertices, faces).vertices) == 96
    samples = {"times": [0, 1], "positions": [vertices, vertices + 1]}
    with pytest.raises(cama.SceneError, match="body: weld: its motion"):
        made.add_obstacle(vertices, faces, weld=True, motion=samples, name="body")
    with pytest.raises(cama.SceneError, match="ball: weld: a generated shape"):
        made.add_obstacle(shape={"sphere": {"radius": 1}}, weld=True, name="ball")


@pytest.mark.parametrize("weld, word", [(-1e-3, "-0.001"), (0.5, "0.1 m"), (np.nan, "finite"), ("all", "number")])
def test_a_wrong_distance_is_refused(weld, word):
    with pytest.raises(cama.ArrayError, match=f"sheet: weld: .*{word}"):
        add(*grid(4), weld=weld)


def test_groups_are_those_of_all_pairs():
    """Random points at four distances, against every pair and a flood fill."""
    points = np.random.default_rng(5).uniform(size=(300, 3))
    far = np.array([[9.0, 9, 9], [10, 9, 9], [9, 10, 9]])  # of a triangle that makes it a mesh
    mesh = cama._core.Mesh(
        np.concatenate([points, far]),
        np.array([[300, 301, 302]], np.int32),
        np.zeros((0, 2)),
        np.zeros((0, 3), np.int32),
    )
    for distance in (0.01, 0.05, 0.08, 0.2):
        near = np.linalg.norm(points[:, None] - points[None], axis=2) <= distance
        label = -np.ones(len(points), int)
        for seed in range(len(points)):
            if label[seed] < 0:
                label[seed], front = seed, [seed]
                while front:
                    new = np.flatnonzero(near[front].any(axis=0) & (label < 0))
                    label[new] = seed
                    front = list(new)
        welded, index = cama._core.weld(mesh, distance)
        first, expected = np.unique(label, return_inverse=True)
        assert (index[:300] == expected).all() and len(welded.vertices) == len(first) + 3
        assert (welded.vertices[index[:300]] == points[label]).all()


def seamed(path):
    """Two squares of 4 x 4 cells with a vertex of their own at each corner of a triangle, texture coordinates that are
    apart, two stitches of which one sews what welding joins, and a vertex that is off by 0.4 mm.
    """
    vertices, faces = grid(4)
    twice = np.concatenate([vertices, vertices + [1, 0, 0]])
    soup, own = apart(twice, np.concatenate([faces, faces + len(vertices)]))
    soup[7] += [0, 0, 4e-4]
    texture = soup[:, :2] + np.where(np.arange(len(soup)) < len(soup) // 2, 0, 3)[:, None] * [1, 0]

    def at(place):
        return np.flatnonzero((soup == place).all(axis=1))

    left, right, border = at(vertices[0]), at(vertices[-1] + [1, 0, 0]), at(vertices[-1])
    stitches = [f"stitch {left[0]} {right[0]} {border[-1]} 0.25", f"stitch {border[0]} {border[1]} {left[0]} 0"]
    return obj(path, soup, own, texture, stitches)


@pytest.mark.parametrize(
    ("weld", "vertices", "stitches"), [(True, 46, 1), (1e-3, 45, 1), (0.0, 46, 1), (False, 192, 2)]
)
@pytest.mark.parametrize("rest", ["start", "uv"])
def test_weld_of_a_scene_file_is_that_of_python(tmp_path, weld, vertices, stitches, rest):
    """There are 5 x 9 places, and the vertex that is off."""
    path = seamed(tmp_path / "soup.obj")
    place = {"translate": [0.25, 0, 2]}
    there = from_json(tmp_path, {"path": path.name, "rest": rest, "weld": weld}, transform=place)
    here = from_python(path, rest=rest, weld=weld, translate=place["translate"])
    one, other = here.cloths[0], there.cloths[0]
    for part in ("vertices", "faces", "material_vertices", "material_faces"):
        np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
    assert json.loads(here.to_json()).get("stitches") == json.loads(there.to_json()).get("stitches")
    assert (len(one.vertices), here.stitch_count) == (vertices, stitches)


def test_obstacles_and_written_out_meshes_of_a_scene_file_are_welded(tmp_path):
    soup, own = apart(*grid(4))
    obj(tmp_path / "soup.obj", soup, own)
    mesh = {"position": soup.tolist(), "face": own.tolist(), "weld": True}
    sampled = {"time": [0, 1], "position": [soup.tolist(), (soup + 1).tolist()]}
    scene = cama.Scene.parse(
        {
            "obstacles": [{"file": {"path": "soup.obj", "weld": True}}, {"mesh": mesh}, {"file": "soup.obj"}],
            "cloth": [{"mesh": mesh}],
        },
        tmp_path,
    )
    assert [len(part.vertices) for part in (*scene.obstacles, *scene.cloths)] == [25, 25, 96, 25]
    with pytest.raises(cama.SceneError, match=r"obstacles\[0\].mesh.weld: its motion gives positions of every vertex"):
        cama.Scene.parse({"obstacles": [{"mesh": mesh, "motion": {"sampled": sampled}}]})


@pytest.mark.parametrize(
    ("weld", "text"),
    [
        (0.2, "0.2 is not a distance from 0 to 0.1 m"),
        (-1, "-1 is not a distance"),
        ("all", 'expected true, false or a distance in m, got "all"'),
    ],
)
def test_a_scene_file_names_a_wrong_distance(tmp_path, weld, text):
    obj(tmp_path / "sheet.obj", *grid(2))
    with pytest.raises(cama.SceneError, match=rf"cloth\[0\].file.weld: {text}"):
        from_json(tmp_path, {"path": "sheet.obj", "weld": weld})
