# SPDX-License-Identifier: Apache-2.0
"""The generated body: a closed surface of human size that moves without jumps and without intersecting itself."""

import numpy as np
import pytest
import trimesh

import cama
from cama import posing
from cama.body import skinned

SHORT = {"triangles": 5000, "samples_per_second": 12}


@pytest.fixture(scope="module")
def bodies():
    """One round of every motion after the lead-in."""
    return {motion: cama.Body(motion, duration=1 + posing.periods[motion], **SHORT) for motion in posing.MOTIONS}


def test_the_surface_is_closed_and_of_human_size(bodies):
    body = bodies["stand"]
    mesh = trimesh.Trimesh(body.vertices, body.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
    assert mesh.euler_number == 2  # a sphere's: no handles
    assert 4500 <= len(body.faces) <= 5500
    assert np.ptp(body.vertices[:, 2]) == pytest.approx(1.7, abs=0.02)
    # Adults have about 1 kg/dm^3: 60 kg are 60 litres; Du Bois and Du Bois 1916: 0.007184 * 60^0.425 * 170^0.725 m^2.
    assert 0.05 < mesh.volume < 0.07
    assert mesh.area == pytest.approx(0.007184 * (1000 * mesh.volume) ** 0.425 * 170**0.725, rel=0.1)
    tall = cama.Body(height=1.9, duration=0.1, **SHORT)
    np.testing.assert_allclose(tall.vertices, body.vertices * 1.9 / 1.7, atol=1e-9)


def test_finer_bodies_have_the_triangles_asked_for():
    fine = cama.Body(triangles=30_000, duration=0.1)
    assert 0.8 * 30_000 < len(fine.faces) < 1.2 * 30_000
    assert trimesh.Trimesh(fine.vertices, fine.faces, process=False).is_watertight
    assert len(cama.collision.intersections(fine.vertices, fine.faces)) == 0


def test_it_does_not_intersect_itself(bodies):
    for motion, body in bodies.items():
        for time, vertices in zip(body.times, body.positions):
            assert len(cama.collision.intersections(vertices, body.faces)) == 0, (motion, time)


def test_feet_stand_on_the_ground(bodies):
    for motion, body in bodies.items():
        lowest = body.positions[:, :, 2].min(axis=1)
        assert lowest.min() > -0.005 and lowest.max() < 0.01, motion


def test_arms_stay_clear_of_the_trunk(bodies):
    """The distance of forearms and hands from all that follows the trunk and the thighs."""
    for motion, body in bodies.items():
        share = {name: body.weights[:, bone] for bone, name in enumerate(posing.BONES)}
        trunk = sum(share[name] for name in ("pelvis", "spine", "chest", "thigh_left", "thigh_right")) > 0.9
        for end in ("_left", "_right"):
            hand = share["hand" + end] + share["forearm" + end] > 0.9
            for vertices in body.positions:
                apart = np.linalg.norm(vertices[hand][:, None] - vertices[trunk][None, ::3], axis=2)
                assert apart.min() > 0.04, motion


def test_a_fall_ends_lying_without_a_jump():
    """From standing, 1.7 m high, to lying flat; the joints accelerate less than a muscle's 150 m/s^2."""
    body = cama.Body("fall", duration=1 + posing.periods["fall"], triangles=5000, samples_per_second=120)
    height = np.ptp(body.positions[:, :, 2], axis=1)
    assert height[0] == pytest.approx(1.7, abs=0.02) and height[-1] < 0.4
    assert np.ptp(body.positions[-1, :, 1]) > 1.5  # along the ground
    late = body.positions[body.times > 0.99 * body.times[-1]]
    assert np.abs(late - late[-1]).max() < 1e-3  # at rest
    acceleration = np.linalg.norm(np.diff(body.positions, n=2, axis=0), axis=2) * 120**2
    assert np.quantile(acceleration, 0.999) < 150


@pytest.mark.parametrize("motion", [motion for motion in posing.MOTIONS if motion not in posing.LYING])
def test_rounds_repeat_without_a_jump(motion):
    """Positions and velocities of the bones are the same one round later, and nothing accelerates beyond a muscle."""
    period = posing.periods[motion]
    times = np.linspace(0, 1 + 2 * period, 4000)
    rotations, translations = posing.pose(motion, times, 1.0, "A", period)
    points = np.stack([posing.JOINTS[name] for name in posing.BONES])
    moved = np.einsum("tbij,bj->tbi", rotations, points) + translations
    for first in (1.0, 1.0 + 0.37 * period):
        now, later = (np.argmin(np.abs(times - t)) for t in (first, first + period))
        np.testing.assert_allclose(moved[now], moved[later], atol=0.02)
    end = posing.pose(motion, np.array([1.2, 1.2 + period]), 1.0, "A", period)
    np.testing.assert_allclose(end[0][0], end[0][1], atol=1e-9)
    np.testing.assert_allclose(end[1][0], end[1][1], atol=1e-9)
    step = times[1] - times[0]
    velocity = np.diff(moved, axis=0) / step
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=2) / step
    assert np.linalg.norm(velocity[0], axis=1).max() < 0.01  # from rest
    assert acceleration.max() < 150  # m/s^2; a jump of the velocity by 0.1 m/s would be 200 and more here


def test_a_rigid_motion_is_skinned_exactly():
    """With all bones alike every vertex follows R x + t, also where weights are blended."""
    rng = np.random.default_rng(5)
    vertices, weights = rng.normal(size=(50, 3)), rng.dirichlet(np.ones(17), 50)
    axis, angle, shift = np.array([2, -1, 2]) / 3, 1.1, np.array([0.3, -0.2, 0.7])
    cross = np.cross(np.eye(3), axis)
    rotation = np.eye(3) + np.sin(angle) * cross.T + (1 - np.cos(angle)) * cross.T @ cross.T
    if not np.allclose(rotation @ axis, axis) or np.linalg.det(rotation) < 0:
        raise AssertionError("Rodrigues' formula")
    moved = skinned(vertices, weights, np.tile(rotation, (17, 1, 1)), np.tile(shift, (17, 1)))
    np.testing.assert_allclose(moved, vertices @ rotation.T + shift, atol=1e-12)


def test_a_bent_joint_keeps_its_distance():
    """Halfway between a bone at rest and one turned by 90 degrees about z through the origin a vertex is turned by 45:
    linear blending would bring it nearer to the axis by a factor cos 45."""
    weights = np.zeros((1, 17))
    weights[0, :2] = 0.5
    rotations, translations = np.tile(np.eye(3), (17, 1, 1)), np.zeros((17, 3))
    rotations[1] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    moved = skinned(np.array([[2.0, 0, 1]]), weights, rotations, translations)
    np.testing.assert_allclose(moved[0], [2 * np.sqrt(0.5), 2 * np.sqrt(0.5), 1], atol=1e-12)


def test_it_is_the_same_every_time_and_starts_in_the_pose_asked_for():
    first, second = (cama.Body("dance", duration=0.2, **SHORT) for _ in range(2))
    assert (first.positions == second.positions).all() and (first.faces == second.faces).all()
    level = cama.Body("dance", duration=0.2, start="T", **SHORT)
    hands = level.weights[:, posing.BONES.index("hand_left")] > 0.9
    assert abs(level.vertices[hands, 2].mean() - posing.JOINTS["arm_left"][2]) < 0.12
    assert first.vertices[hands, 2].mean() < posing.JOINTS["arm_left"][2] - 0.25


def test_scenes_take_bodies():
    given = {"motion": "kick", "triangles": 5000, "samples_per_second": 10, "duration": 1.5}
    parsed = cama.Scene.parse(
        {"obstacles": [{"name": "body", "body": given, "transform": {"translate": [1, 2, 3], "scale": 2}}]}
    ).obstacles[0]
    scene = cama.Scene()
    added = scene.add_obstacle(cama.Body(**given), translate=(1, 2, 3), scale=2)
    assert parsed.source == added.source == "generated body, kick"
    np.testing.assert_allclose(parsed.vertices, added.vertices, atol=1e-9)
    body = cama.Body(**given)
    np.testing.assert_allclose(parsed.vertices, 2 * body.vertices + [1, 2, 3], atol=1e-9)
    for obstacle in (parsed, added):
        moved = np.asarray(obstacle.motion.evaluate(1.5, obstacle.vertices))
        np.testing.assert_allclose(moved, 2 * body.positions[-1] + [1, 2, 3], atol=1e-9)


def test_wrong_arguments_are_named():
    for wrong, said in (
        ({"motion": "danse"}, "did you mean 'dance'"),
        ({"triangles": 100}, "from 5,000 to 50,000"),
        ({"start": "B"}, "neither"),
        ({"height": 0}, "height"),
        ({"lead_in": -1}, "lead_in"),
        ({"period": -1}, "period"),
        ({"motion": ["walk"]}, "motion"),
    ):
        with pytest.raises(cama.SceneError, match=said):
            cama.Body(**wrong)
        with pytest.raises(cama.SceneError, match=rf"obstacles\[0\]\.body.*{said}"):
            cama.Scene.parse({"obstacles": [{"body": wrong}]})
    with pytest.raises(cama.SceneError, match=r"obstacles\[0\]\.body\.hight: not known.*did you mean 'height'"):
        cama.Scene.parse({"obstacles": [{"body": {"hight": 1.7}}]})
    with pytest.raises(cama.ArrayError, match="height"):
        cama.Body(height="tall")


def test_a_skirt_and_a_top_dance():
    """The shipped scene at small size: the body has moved out of its pose, and nothing intersects."""
    scene = cama.Scene.load("dance", 2500)
    assert [cloth.name for cloth in scene.cloths] == ["skirt", "top"]
    simulation = cama.Simulation(scene, accuracy="preview")
    assert [frame.intersections for frame in simulation.frames(60)] == [0] * 60
    assert simulation.max_strain < 0.5
