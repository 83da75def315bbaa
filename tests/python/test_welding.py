# SPDX-License-Identifier: Apache-2.0
"""Meshes whose triangles share no vertices are welded; judged by trimesh and by counting."""

import numpy as np
import pytest
import trimesh

import cama
from conftest import grid
from test_plausibility import apart


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
    from cama.welding import groups

    points = np.random.default_rng(5).uniform(size=(300, 3))
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
        index, first = groups(points, distance)
        assert (first[index] == label).all()
