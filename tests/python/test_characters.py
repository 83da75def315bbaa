# SPDX-License-Identifier: Apache-2.0
"""Animated characters as obstacles: a small glTF file that the test writes, and those of the shared test data."""

import base64
import json
import os
from pathlib import Path

import numpy as np
import pytest

import cama

DATA = Path(os.environ.get("CAMA_TEST_DATA", Path(__file__).resolve().parents[2] / ".." / "shared" / "data"))
CHARACTERS = DATA / "characters"
needs_data = pytest.mark.skipif(not CHARACTERS.is_dir(), reason=f"SKIPPED: no test data {CHARACTERS}")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)  # y is up in glTF


def write_gltf(path, animated=True):
    """A tetrahedron on one bone. Its clip "rise" moves the bone from 0 to 4 m along y within 2 s."""
    arrays = [
        (CORNERS, "VEC3", 5126),
        (np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], np.uint16), "SCALAR", 5123),
        (np.zeros((4, 4), np.uint8), "VEC4", 5121),  # every vertex follows bone 0
        (np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1)), "VEC4", 5126),
        (np.array([0, 2], np.float32), "SCALAR", 5126),
        (np.array([[0, 0, 0], [0, 4, 0]], np.float32), "VEC3", 5126),
        (np.eye(4, dtype=np.float32)[None], "MAT4", 5126),  # of bind pose; assimp needs it, glTF itself does not
    ]
    data, views, accessors = b"", [], []
    for number, (array, kind, component) in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes() + b"\0" * (-array.nbytes % 4)
        rows = array.reshape(len(array), -1)
        accessors.append(
            {
                "bufferView": number,
                "componentType": component,
                "count": len(array),
                "type": kind,
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
    clip = {
        "name": "rise",
        "samplers": [{"input": 4, "output": 5}],
        "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
    }
    attributes = {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}
    file = {
        "asset": {"version": "2.0"},
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 1}]}],
        "skins": [{"joints": [1], "inverseBindMatrices": 6}],
        "nodes": [{"name": "body", "mesh": 0, "skin": 0}, {"name": "bone"}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
        **({"animations": [clip]} if animated else {}),
    }
    path.write_text(json.dumps(file))
    return path


def sorted_rows(points):
    return np.array(sorted(map(tuple, np.round(points, 6))))


def test_a_character_loads_and_moves_as_its_clip_says(tmp_path):
    file = write_gltf(tmp_path / "rising.gltf")
    body = cama.Scene().add_obstacle(file, name="body")
    upright = CORNERS[:, [0, 2, 1]] * [1, -1, 1]  # z up: (x, y, z) becomes (x, -z, y)
    np.testing.assert_allclose(sorted_rows(body.vertices), sorted_rows(upright), atol=1e-6)
    for time, height in ((0.5, 1.0), (2.0, 4.0), (5.0, 4.0)):
        moved = np.asarray(body.motion.evaluate(time, body.vertices))
        np.testing.assert_allclose(sorted_rows(moved), sorted_rows(upright + [0, 0, height]), atol=1e-6)


def test_clips_are_chosen_by_name_and_from_other_files(tmp_path):
    file, still = write_gltf(tmp_path / "rising.gltf"), write_gltf(tmp_path / "still.gltf", animated=False)
    scene = cama.Scene()

    def rise(*mesh, **how):
        body = scene.add_obstacle(*mesh, **how)
        return float((np.asarray(body.motion.evaluate(1.0, body.vertices)) - body.vertices)[:, 2].mean())

    assert rise(str(file), clip="rise") == pytest.approx(2, abs=1e-6)
    assert rise(file, clip=0, lead_in=1.0) == pytest.approx(0, abs=1e-6)
    assert rise(still, animation=file) == pytest.approx(2, abs=1e-6)
    assert rise(file, clip="bind") == 0
    assert rise(still) == 0
    with pytest.raises(cama.FileError, match="rise"):
        scene.add_obstacle(file, clip="dance")
    with pytest.raises(cama.FileError, match="still.gltf"):
        scene.add_obstacle(still, clip="rise")
    with pytest.raises(cama.FileError, match="nothing.glb"):
        scene.add_obstacle(tmp_path / "nothing.glb")


def test_cloth_is_simulated_on_a_moving_character(tmp_path):
    """The bone lifts the tetrahedron, whose tip is at z = 2, into a sheet at z = 2.02 without gravity."""
    scene = cama.Scene(gravity=(0, 0, 0), frame_time=0.02)
    sheet = scene.add_cloth(shape={"grid": {"size": [1, 1], "cells": [4, 4]}}, translate=(0, 0, 2.02))
    scene.add_obstacle(write_gltf(tmp_path / "rising.gltf"))
    simulation = cama.Simulation(scene, accuracy="preview")
    last = list(simulation.frames(5))[-1]  # at 0.1 s the tip is at 2.2 m
    assert last.intersections == 0
    assert last.positions[: len(sheet.vertices), 2].max() > 2.2


@needs_data
@pytest.mark.parametrize(
    ("file", "moves", "keywords"),
    [
        ("CesiumMan.glb", True, {}),
        ("makehuman_body.glb", True, {}),
        ("raylib_greenman.glb", False, {}),  # its first clip is a pose
        ("raylib_greenman.glb", True, {"clip": "2_move"}),
        ("ozz_arnaud.fbx", False, {}),
        ("ozz_arnaud.fbx", True, {"animation": CHARACTERS / "ozz_pab_walk.fbx", "scale": 0.01}),
        ("ozz_arnaud.fbx", True, {"animation": CHARACTERS / "ozz_pab_run.fbx", "scale": 0.01}),
    ],
)
def test_characters_of_the_shared_data_load(file, moves, keywords):
    body = cama.Scene().add_obstacle(CHARACTERS / file, samples_per_second=10, **keywords)
    assert len(body.faces) > 100
    away = np.abs(np.asarray(body.motion.evaluate(0.5, body.vertices)) - body.vertices).max()
    assert (away > 1e-3) == moves


@needs_data
def test_every_file_of_the_shared_characters_is_tried():
    """A new file gets a row above; the two of pure animation have none of their own."""
    there = {p.name for p in CHARACTERS.iterdir() if p.suffix in (".glb", ".gltf", ".fbx", ".dae")}
    named = {"CesiumMan.glb", "makehuman_body.glb", "raylib_greenman.glb", "ozz_arnaud.fbx"}
    assert there == named | {"ozz_pab_run.fbx", "ozz_pab_walk.fbx"}


def test_limbs_are_left_out_by_the_names_of_joints(tmp_path):
    file = write_gltf(tmp_path / "rising.gltf")
    with pytest.raises(cama.FileError, match='no joint "arm"; there are: .*"bone"'):
        cama.Scene().add_obstacle(file, leave_out=["arm"])
    with pytest.raises(cama.FileError, match="leaves no triangles"):
        cama.Scene().add_obstacle(file, leave_out=["bone"])
    with pytest.raises(cama.SceneError, match="list of names"):
        cama.Scene().add_obstacle(file, leave_out="bone")
    with pytest.raises(cama.SceneError, match="None is not a list of names of joints"):
        cama.Scene().add_obstacle(file, leave_out=None)
    with pytest.raises(cama.SceneError, match="needs a character"):
        cama.Scene().add_obstacle(shape={"sphere": {"radius": 1}}, leave_out=["bone"])
    assert len(cama.Scene().add_obstacle(file, leave_out=[]).faces) == 4
    with pytest.raises(cama.SceneError, match=r"leave_out\[0\]"):
        cama.Scene.parse({"obstacles": [{"name": "body", "character": {"file": str(file), "leave_out": [1]}}]})


def dressed(file, waist, hip, length, **character):
    """A character with a generated skirt of 2,000 triangles, which eight belt loops hold at the waist."""
    garment = {"body": "body", "waist": waist, "hip": hip, "length": length, "panels": 8, "flare": 0.12}
    scene = cama.Scene.parse(
        {
            "frame_time": 0.02,
            "resolution": 2000,
            "contact": {"thickness": 1e-3, "friction": 0.3},
            "obstacles": [{"name": "body", "character": {"file": str(CHARACTERS / file), **character}}],
            "cloth": [{"name": "skirt", "garment": {"skirt": garment}, "material": "wool"}],
        }
    )
    skirt, body = scene.cloths[0], scene.obstacles[0]
    ring = np.flatnonzero(skirt.vertices[:, 2] > skirt.vertices[:, 2].max() - 1e-6)
    scene.attach(skirt, ring[:: len(ring) // 8], body)
    return scene, ring


@needs_data
@pytest.mark.parametrize(
    ("file", "waist", "hip", "length", "keywords"),
    [
        ("CesiumMan.glb", 0.80, 0.72, 0.34, {"lead_in": 1.0}),
        ("makehuman_body.glb", 1.0, 0.92, 0.4, {"samples_per_second": 20}),
        ("raylib_greenman.glb", 0.9, 0.8, 0.4, {"clip": "2_move", "lead_in": 1.0}),
        (
            "ozz_arnaud.fbx",
            1.1,
            1.02,
            0.42,
            {"animation_file": str(CHARACTERS / "ozz_pab_walk.fbx"), "scale": 0.01, "lead_in": 1.0},
        ),
        (
            "ozz_arnaud.fbx",
            1.1,
            1.02,
            0.42,
            {"animation_file": str(CHARACTERS / "ozz_pab_run.fbx"), "scale": 0.01, "lead_in": 1.0},
        ),
    ],
)
def test_every_character_wears_a_skirt(file, waist, hip, length, keywords):
    scene, _ = dressed(file, waist, hip, length, **keywords)
    simulation = cama.Simulation(scene, accuracy="interactive")
    assert [frame.intersections for frame in simulation.frames(15)] == [0] * 15
    assert simulation.max_strain < 0.3


@needs_data
def test_a_skirt_walks_with_cesium_man():
    """His hand goes through his hip in the file, and is kept apart from it. From the bind pose through the whole walk
    nothing intersects, nothing is pinched, and the skirt stays at the waist."""
    scene, ring = dressed("CesiumMan.glb", 0.80, 0.72, 0.34, lead_in=1.0)
    assert "so that its limbs keep apart" in scene.obstacles[0].source
    assert scene.triangle_count >= 1500
    simulation = cama.Simulation(scene, accuracy="interactive")
    first = simulation.cloth_vertex_count
    start = simulation.positions
    trunk = first + np.flatnonzero((np.abs(start[first:, 2] - 0.80) < 0.06) & (np.abs(start[first:, 0]) < 0.2))
    for frame in simulation.frames(150):
        assert frame.intersections == 0, frame.time
        assert simulation.max_strain < 0.3, frame.time
        apart = frame.positions[ring].mean(axis=0) - frame.positions[trunk].mean(axis=0)
        assert np.linalg.norm(apart - (start[ring].mean(axis=0) - start[trunk].mean(axis=0))) < 0.04, frame.time
    assert simulation.time == pytest.approx(3.0)
    assert simulation.count_intersections() == 0


@needs_data
def test_a_hand_through_the_hip_pinches_cloth_and_says_so():
    scene, _ = dressed("CesiumMan.glb", 0.86, 0.78, 0.35, lead_in=1.0, clearance=0)
    with pytest.raises(cama.CollisionError, match="leave_out"):
        cama.Simulation(scene, accuracy="interactive").step(750)
