# SPDX-License-Identifier: Apache-2.0
"""Limbs that pass through the body are kept apart: a sphere with a bar that swings into it, and CesiumMan."""

import ipctk
import numpy as np
import pytest
import trimesh

import cama
from cama import clearance
from test_characters import CHARACTERS, needs_data, write_gltf

RADIUS, GAP = 0.3, 0.02


def trunk_with_arm():
    """A ball of radius 0.3 m with two arms that leave it at the top and hang beside it, 0.25 m away from it."""

    def distance(x):
        ball = np.linalg.norm(x, axis=-1) - RADIUS
        mirrored = np.abs(x[..., :1]) * [1, 0, 0] + x * [0, 1, 1]
        arm = np.minimum.reduce([segment(mirrored, a, b) for a, b in zip(ELBOWS, ELBOWS[1:])]) - 0.05
        return np.minimum(ball, arm)

    axis = np.arange(-0.805, 0.83, 0.04)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    return contour(distance(grid), axis)


ELBOWS = [np.array(p, float) for p in ((0, 0, 0.3), (0, 0, 0.6), (0.6, 0, 0.6), (0.6, 0, -0.2))]


def segment(x, a, b):
    t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(x - a - t[..., None] * (b - a), axis=-1)


def contour(values, axis):
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    image = vtkImageData()
    image.SetDimensions(*values.shape)
    image.SetOrigin(axis[0], axis[0], axis[0])
    image.SetSpacing(*[axis[1] - axis[0]] * 3)
    image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(order="F"), deep=True))
    filter_ = vtkFlyingEdges3D()
    filter_.SetInputData(image)
    filter_.SetValue(0, 0.0)
    filter_.Update()
    made = filter_.GetOutput()
    faces = vtk_to_numpy(made.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    mesh = trimesh.Trimesh(vtk_to_numpy(made.GetPoints().GetData()), faces, process=True)
    mesh.fix_normals()
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)


@pytest.fixture(scope="module")
def swung():
    """The forearm moves into the ball by up to 5 cm and out again within 2 s."""
    bind, faces = trunk_with_arm()
    times = np.linspace(0, 2, 41)
    depth = 0.25 + 0.05  # the forearm is 0.25 m away from the ball
    part = np.clip((bind[:, 0] - 0.05) / 0.5, 0, 1) * (np.linalg.norm(bind, axis=1) > RADIUS + 0.04)
    swing = np.sin(np.pi * times / 2) ** 2
    positions = bind - depth * swing[:, None, None] * part[:, None] * np.array([1.0, 0, 0])
    return bind, faces, times, positions, part


def forearm_gap(vertices, part):
    """The least distance of the forearm's vertices from the ball, by its radius, m."""
    return np.linalg.norm(vertices[part > 0.95], axis=1).min() - RADIUS


def test_an_arm_that_swings_into_a_ball_keeps_the_gap(swung):
    bind, faces, times, positions, part = swung
    assert min(forearm_gap(x, part) for x in positions) < -0.03
    cleared = clearance.clear(bind, faces, times, positions, GAP)
    assert min(forearm_gap(x, part) for x in cleared.positions) > 0.5 * GAP
    moved = np.linalg.norm(cleared.positions - positions, axis=2)
    ball = np.linalg.norm(bind, axis=1) < RADIUS + 0.01
    assert moved[:, ball].max() == 0
    assert moved[0].max() < 1e-6
    assert 0.05 < cleared.largest < 0.16 and cleared.largest == pytest.approx(moved.max())
    assert cleared.vertices == (moved.max(axis=0) > 1e-4).sum()
    speed = np.linalg.norm(np.diff(cleared.positions - positions, axis=0), axis=2).max() / (times[1] - times[0])
    assert speed < 2 * cleared.largest / clearance.SETTLE  # no jump: at most the width of the filter


def test_a_motion_with_room_is_not_touched(swung):
    bind, faces, times, positions, _ = swung
    halfway = bind + 0.5 * (positions - bind)
    cleared = clearance.clear(bind, faces, times, halfway, GAP)
    assert cleared.positions is halfway and (cleared.vertices, cleared.largest) == (0, 0.0)


@needs_data
def test_cesium_man_keeps_his_hands_out_of_his_hips():
    """ipctk sees intersections of hands and hips in the clip as it is, and none after it was read."""

    def intersect(time, **how):
        body = cama.Scene().add_obstacle(CHARACTERS / "CesiumMan.glb", lead_in=1.0, samples_per_second=30, **how)
        bind = body.vertices
        hands, hips = np.abs(bind[:, 0]) > 0.4, (np.abs(bind[:, 0]) < 0.2) & (bind[:, 2] < 0.9) & (bind[:, 2] > 0.4)
        faces = body.faces[(hands[body.faces].all(axis=1)) | (hips[body.faces].all(axis=1))]
        used, faces = np.unique(faces, return_inverse=True)
        faces = faces.reshape(-1, 3).astype(np.int32)
        moved = np.asfortranarray(np.asarray(body.motion.evaluate(time, bind))[used])
        mesh = ipctk.CollisionMesh(moved, ipctk.edges(faces), faces)
        return ipctk.has_intersections(mesh, moved), body.source

    for time in (1.45, 1.5, 1.55):
        there, source = intersect(time, clearance=0)
        assert there and "limbs" not in source
        there, source = intersect(time)
        assert not there and "so that its limbs keep apart" in source


def test_clearance_is_checked(tmp_path):
    file = write_gltf(tmp_path / "rising.gltf")
    with pytest.raises(cama.SceneError, match="clearance"):
        cama.Scene().add_obstacle(file, clearance=-1)
    with pytest.raises(cama.SceneError, match="needs a character"):
        cama.Scene().add_obstacle(shape={"sphere": {"radius": 1}}, clearance=0.01)
    for wrong in (-0.1, "wide", True):
        with pytest.raises(cama.SceneError, match=r"obstacles\[0\].character.clearance: must be a distance"):
            cama.Scene.parse({"obstacles": [{"character": {"file": str(file), "clearance": wrong}}]})
    for given in ({}, {"clearance": 0}, {"clearance": 0.02}):
        scene = cama.Scene.parse({"obstacles": [{"character": {"file": str(file), **given}}]})
        assert scene.obstacles[0].source == f"character {file}"


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_body_that_is_a_point_has_no_limbs():
    positions = np.zeros((2, 4, 3))
    assert clearance.clear(positions[0], np.array([[0, 1, 2], [1, 3, 2]]), np.arange(2.0), positions).vertices == 0
