# SPDX-License-Identifier: Apache-2.0
"""Coats and trousers: surfaces with the openings of the garment, clear of the body, at rest as they are worn."""

import numpy as np
import pytest
import trimesh

import cama
from cama import tailoring

OUTFIT = {
    "cloth": [
        {"name": "trousers", "garment": {"trousers": {}}, "material": "cotton"},
        {"name": "coat", "garment": {"coat": {"clearance": 0.03, "hem": 0.6}}, "material": "wool"},
    ],
    "resolution": 4000,
}
OPENINGS = {"coat": {"collar", "hem", "left cuff", "right cuff"}, "trousers": {"waist", "left cuff", "right cuff"}}


@pytest.mark.parametrize("kind", OPENINGS)
def test_it_is_one_surface_with_the_openings_of_the_garment(kind):
    made = tailoring.make(kind, {}, 2500)
    mesh = trimesh.Trimesh(made.vertices, made.faces, process=False)
    assert mesh.body_count == 1 and mesh.is_winding_consistent
    assert mesh.euler_number == 2 - len(OPENINGS[kind])  # a sphere's 2, less 1 for each hole
    assert set(made.rims) == OPENINGS[kind]
    edges = np.sort(mesh.edges, axis=1)
    single = np.unique(edges, axis=0)[np.unique(edges, axis=0, return_counts=True)[1] == 1]
    assert set(np.unique(single)) == set(np.concatenate(list(made.rims.values())))
    assert 0.85 * 2500 < len(made.faces) < 1.25 * 2500
    assert len(cama.collision.intersections(made.vertices, made.faces)) == 0
    away = np.einsum("ij,ij->i", mesh.vertex_normals, mesh.vertices * [1, 1, 0])
    assert (away > 0).mean() > 0.7  # outward


def test_rims_are_where_they_were_asked_for():
    made = tailoring.make("trousers", {"waist": 1.02, "hem": 0.2}, 2500)
    heights = {name: made.vertices[rim, 2] for name, rim in made.rims.items()}
    np.testing.assert_allclose(heights["waist"], 1.02, atol=2e-3)
    np.testing.assert_allclose(heights["left cuff"], 0.2, atol=2e-3)
    assert (made.vertices[made.rims["left cuff"], 0] > 0).all() and (
        made.vertices[made.rims["right cuff"], 0] < 0
    ).all()
    coat = tailoring.make("coat", {"hem": 0.7, "slit": 0.9}, 2500)
    np.testing.assert_allclose(coat.vertices[coat.rims["hem"], 2], 0.7, atol=2e-3)
    front = coat.vertices[coat.rims["front"]]
    assert front[:, 2].max() < 0.93 and (front[:, 1] < 0).all()
    # the slit has a slope of 1:5 to each side of its upper end
    np.testing.assert_allclose(np.abs(front[:, 0]), 0.2 * (0.9 - front[:, 2]), atol=0.02)


def test_rest_triangles_are_those_that_are_worn():
    made = tailoring.make("coat", {}, 2000)
    worn, rest = made.vertices[made.faces], made.material_vertices[made.material_faces]
    for k in range(3):
        np.testing.assert_allclose(
            np.linalg.norm(rest[:, k] - rest[:, k - 1], axis=1), np.linalg.norm(worn[:, k] - worn[:, k - 1], axis=1)
        )
    first, second = rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]
    assert (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0).all()  # not mirrored


def test_a_smaller_body_has_smaller_garments():
    adult, child = (tailoring.make("trousers", {"height": height}, 2000) for height in (1.7, 0.85))
    np.testing.assert_allclose(child.vertices, 0.5 * adult.vertices, rtol=1e-12)
    np.testing.assert_allclose(child.material_vertices, 0.5 * adult.material_vertices, rtol=1e-12)


def test_scenes_take_them_beside_other_cloth():
    pinned = {"pins": [{"cloth": "trousers", "edge": "waist"}]}
    scene = cama.Scene.parse({**OUTFIT, **pinned})
    assert 0.8 * 4000 < scene.triangle_count < 1.3 * 4000
    waist = scene.cloths[0].vertices[scene.pins[0]["vertices"]]
    np.testing.assert_allclose(waist[:, 2], 1.05, atol=2e-3)
    assert not scene.intersections()
    sheet = {"name": "sheet", "grid": {"size": [2, 2]}}
    mixed = cama.Scene.parse({"cloth": [OUTFIT["cloth"][1], sheet], "resolution": 6000})
    coat, beside = mixed.cloths
    assert coat.rest_area / beside.rest_area == pytest.approx(len(coat.faces) / len(beside.faces), rel=0.25)
    assert 0.8 * 6000 < mixed.triangle_count < 1.2 * 6000
    finer = cama.Scene.parse({"cloth": [OUTFIT["cloth"][1], sheet], "resolution": 6000}, resolution=9000)
    assert 0.8 * 9000 < finer.triangle_count < 1.2 * 9000


@pytest.mark.parametrize(
    "garment, text",
    [
        ({"coat": {"sleve": 0.5}}, "cloth[0].garment.coat.sleve: not known; there are .*sleeve"),
        ({"coat": {"hem": -1}}, "cloth[0].garment.coat.hem: must be greater than 0"),
        ({"coat": {"hem": 1.6}}, "leave nothing of the garment"),
        ({"trousers": {"waist": "high"}}, "cloth[0].garment.trousers.waist"),
        ({"coat": {}, "trousers": {}}, "more than one"),
        ({"coat": 3}, "cloth[0].garment.coat: must be an object"),
    ],
)
def test_wrong_garments_are_errors_that_name_the_key(garment, text):
    with pytest.raises(cama.Error, match=text.replace("[0]", r"\[0\]")):
        cama.Scene.parse({"cloth": [{"garment": garment}]})


def test_an_edge_that_is_not_there_is_an_error():
    with pytest.raises(cama.SceneError, match=r"pins\[0\].edge: 'hem'; there are waist, left cuff, right cuff"):
        cama.Scene.parse({**OUTFIT, "pins": [{"cloth": "trousers", "edge": "hem"}]})


def test_the_drum_is_closed_and_turns_as_it_says():
    drum = {"radius": 0.5, "depth": 0.8, "paddles": 3, "paddle": 0.1, "rate": 2.0, "ease": 0.5, "triangles": 4000}
    scene = cama.Scene.parse({"frames": 100, "frame_time": 0.02, "obstacles": [{"name": "drum", "drum": drum}]})
    mesh = trimesh.Trimesh(scene.obstacles[0].vertices, scene.obstacles[0].faces, process=False)
    assert mesh.is_watertight and mesh.euler_number == 2 and mesh.volume < 0  # normals point inward
    assert 0.8 * 4000 < len(mesh.faces) < 1.2 * 4000
    assert np.pi * 0.4**2 * 0.8 < -mesh.volume < np.pi * 0.5**2 * 0.8
    start = scene.obstacles[0].vertices
    middle = np.abs(start[:, 1]) < 0.4
    assert np.hypot(*start[middle][:, [0, 2]].T).min() == pytest.approx(0.4, abs=2e-3)  # the tip of a paddle
    # from rest with a smooth start, whose mean rate is half of the last: 2 rad/s (1.5 s + 0.5 s / 2) at 2 s
    moved, angle = scene.obstacles[0].motion.evaluate(2.0, start), 2.0 * 1.75
    np.testing.assert_allclose(moved[:, 0], np.cos(angle) * start[:, 0] + np.sin(angle) * start[:, 2], atol=1e-6)
    np.testing.assert_allclose(moved[:, 1], start[:, 1], atol=1e-12)


@pytest.mark.parametrize(
    "drum, text",
    [({"paddle": 0.4}, "drum.paddle"), ({"radius": 0}, "drum.radius"), ({"depht": 1}, "drum.depht: not known")],
)
def test_wrong_drums_are_errors_that_name_the_key(drum, text):
    with pytest.raises(cama.SceneError, match=rf"obstacles\[0\]\.{text}"):
        cama.Scene.parse({"obstacles": [{"drum": drum}]})
