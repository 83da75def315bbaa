# SPDX-License-Identifier: Apache-2.0
"""Bones for the mesh of a body: those of the generated body are found again from its surface alone."""

import json

import numpy as np
import pytest
import trimesh

import cama
from cama import posing
from cama.rigging import rig

SHORT = {"triangles": 6000, "duration": 0.1, "samples_per_second": 10}


@pytest.fixture(scope="module")
def generated():
    return cama.Body(**SHORT)


@pytest.fixture(scope="module")
def found(generated):
    return rig(generated.vertices, generated.faces)


def test_the_bones_of_the_generated_body_are_found(found):
    """The truth is the skeleton that the body was made with. Skin of a joint is 40 mm wide."""
    for name, joint in posing.JOINTS.items():
        at = found.placed(found.skeleton.joints[name])
        assert np.linalg.norm(at - joint) < 0.055, name
    for end in ("_left", "_right"):
        for first, second in (("arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot")):
            own = found.skeleton.joints[second + end] - found.skeleton.joints[first + end]
            true = posing.JOINTS[second + end] - posing.JOINTS[first + end]
            cosine = own @ true / np.linalg.norm(own) / np.linalg.norm(true)
            assert np.degrees(np.arccos(cosine)) < 12, first + end


def test_skin_follows_the_bone_beside_it(generated, found):
    """Of vertices that follow one bone of the generated body alone nine of ten follow the same one here."""
    sure = generated.weights.max(axis=1) > 0.95
    same = generated.weights[sure].argmax(axis=1) == found.weights[sure].argmax(axis=1)
    assert same.mean() > 0.9
    assert found.weights.sum(axis=1) == pytest.approx(1)


def test_a_body_may_look_anywhere_and_have_any_size(generated, found):
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = 0.5 * generated.vertices @ turn.T + [3, -2, 1]
    other = rig(moved, generated.faces)
    assert other.scale == pytest.approx(0.5 * found.scale)
    for name, joint in found.skeleton.joints.items():
        expected = 0.5 * found.placed(joint) @ turn.T + [3, -2, 1]
        assert other.placed(other.skeleton.joints[name]) == pytest.approx(expected, abs=2e-3), name


def test_a_mesh_starts_as_it_is_and_dances_as_the_generated_body_does(generated):
    how = {"duration": 2.0, "samples_per_second": 10}
    own = cama.Body("dance", mesh=(generated.vertices, generated.faces), **how)
    true = cama.Body("dance", triangles=6000, **how)
    assert own.vertices == pytest.approx(generated.vertices, abs=1e-9)
    apart = np.linalg.norm(own.positions - true.positions, axis=2)
    assert apart.mean() < 0.02 and np.quantile(apart, 0.95) < 0.07  # that moves by up to 0.5 m
    assert np.linalg.norm(true.positions - true.vertices, axis=2).max() > 0.3
    lowest = own.positions[:, :, 2].min(axis=1)
    assert lowest.min() > -0.02 and lowest.max() < 0.02
    for vertices in own.positions[::4]:
        assert len(cama.collision.intersections(vertices, own.faces)) == 0


def test_scenes_take_the_file_of_a_body(generated, tmp_path):
    trimesh.Trimesh(generated.vertices, generated.faces, process=False).export(tmp_path / "figure.obj")
    entry = {"motion": "walk", "file": "figure.obj", "duration": 0.5, "samples_per_second": 10}
    scene = {"obstacles": [{"name": "body", "body": entry}]}
    obstacle = cama.Scene.parse(scene, folder=tmp_path).obstacles[0]
    assert obstacle.source == "figure.obj, walk"
    body = cama.Body("walk", mesh=tmp_path / "figure.obj", duration=0.5, samples_per_second=10)
    assert obstacle.vertices == pytest.approx(body.vertices)
    assert np.asarray(obstacle.motion.evaluate(0.5, obstacle.vertices)) == pytest.approx(body.positions[-1])
    entry["file"] = "nobody.obj"
    with pytest.raises(cama.FileError, match=r"obstacles\[0\].body.file: .*nobody.obj: no such file"):
        cama.Scene.parse(scene, folder=tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    with pytest.raises(cama.FileError, match=r"obstacles\[0\].body.file: .*nobody.obj: no such file"):
        cama.Scene.load(tmp_path)
    entry["file"] = 3
    with pytest.raises(cama.SceneError, match=r"obstacles\[0\].body.file: 3 is not the name"):
        cama.Scene.parse(scene, folder=tmp_path)


def test_what_is_no_body_is_named(generated):
    ball = trimesh.creation.icosphere(2)
    with pytest.raises(cama.MeshError, match="a head, two arms and two legs are not what sticks out"):
        cama.Body("walk", mesh=(ball.vertices, ball.faces))
    with pytest.raises(cama.MeshError, match="not a closed surface"):
        cama.Body("walk", mesh=(generated.vertices, generated.faces[1:]))
    lying = generated.vertices[:, [2, 1, 0]]
    with pytest.raises(cama.MeshError, match="stands upright along z"):
        cama.Body("walk", mesh=(lying, generated.faces[:, ::-1]))
    with pytest.raises(cama.SceneError, match="start: is for the generated body"):
        cama.Body("walk", mesh=(generated.vertices, generated.faces), start="T")
    with pytest.raises(cama.SceneError, match="clearance: must not be negative"):
        cama.Body("walk", mesh=(generated.vertices, generated.faces), clearance=-1)
