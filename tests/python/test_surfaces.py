# SPDX-License-Identifier: Apache-2.0
"""Exact obstacles from Python: distances in NumPy, recording, and what is drawn of them."""

import numpy as np
import pytest

import cama
from cama.io.recording import Recorder, Recording
from cama.io.tessellation import tessellate
from conftest import grid


def point_segments(p, a, b):
    """Distances of a point from segments [n, 3]."""
    u = b - a
    s = np.clip(((p - a) * u).sum(1) / (u * u).sum(1), 0, 1)
    return np.linalg.norm(p - a - s[:, None] * u, axis=1)


def point_triangles(p, x):
    """Distances of a point from triangles [n, 3, 3]."""
    a, b, c = x[:, 0], x[:, 1], x[:, 2]
    n = np.cross(b - a, c - a)
    inside = np.all([(np.cross(e1 - e0, p - e0) * n).sum(1) > 0 for e0, e1 in ((a, b), (b, c), (c, a))], axis=0)
    border = np.min([point_segments(p, *e) for e in ((a, b), (b, c), (c, a))], axis=0)
    return np.where(inside, np.abs(((p - a) * n).sum(1)) / np.linalg.norm(n, axis=1), border)


def segment_triangles(p, q, x, samples=201):
    """Distances of points along a segment from triangles: an upper bound of the segment's, close to it."""
    return np.min([point_triangles(p + s * (q - p), x) for s in np.linspace(0, 1, samples)], axis=0)


@pytest.fixture
def scene():
    """A sheet over all four, one of them moving."""
    scene = cama.Scene(thickness=2e-3, time_step=0.005)
    scene.add_cloth(*grid(16, 0.5, z=0.26), name="sheet")
    scene.add_obstacle(
        shape={"shape": {"sphere": {"radius": 0.05}}},
        translate=(-0.1, 0.1, 0.2),
        scale=1.1,
        name="ball",
        motion={"velocity": (0.3, 0, 0.2)},
    )
    scene.add_obstacle(
        shape={"shape": {"capsule": {"radius": 0.04, "length": 0.2}}},
        translate=(0.1, 0.0, 0.2),
        rotate=(2**-0.5, 2**-0.5, 0, 0),
        name="rod",
    )
    scene.add_obstacle(shape={"shape": {"box": {"size": [0.1, 0.1, 0.1]}}}, translate=(-0.1, -0.12, 0.19), name="block")
    scene.add_obstacle(
        shape={"shape": {"plane": {}}},
        friction=0.3,
        static_friction=0.5,
        thickness=3e-3,
        contact_stiffness=2e6,
        name="ground",
    )
    return scene


def test_cloth_stays_out_of_smooth_shapes(scene):
    ball, rod, block, ground = scene.obstacles
    assert [o.shape for o in scene.obstacles] == ["sphere", "capsule", "box", "plane"]
    assert ball.radius == pytest.approx(0.055) and rod.radius == 0.04 and ground.radius == 0
    assert (ground.friction, ground.static_friction) == (0.3, 0.5)
    assert np.allclose(np.sort(rod.vertices[:, 1]), [-0.1, 0.1]) and len(block.faces) == 12
    simulation = cama.Simulation(scene, backend="cpu", threads=1)
    cloth = simulation.faces[: scene.triangle_count]
    assert len(simulation.faces) == len(cloth) + 12
    touched = np.zeros(3, bool)
    for _ in range(70):
        simulation.step()
        x = simulation.positions
        ends = [x[first:last] for first, last in simulation.obstacle_ranges]
        gaps = [
            point_triangles(ends[0][0], x[cloth]).min() - ball.radius,
            segment_triangles(*ends[1], x[cloth]).min() - rod.radius,
            x[: scene.vertex_count, 2].min(),
        ]
        assert min(gaps) > 0
        touched |= np.array(gaps) < 2.5e-3
    assert simulation.count_intersections() == 0
    assert touched[0] and touched[1]


def test_a_transform_must_keep_the_form():
    scene = cama.Scene()
    with pytest.raises(cama.SceneError, match="ball: transform"):
        scene.add_obstacle(shape={"shape": {"sphere": {"radius": 1}}}, transform=np.diag([1, 2, 1, 1]), name="ball")


def test_a_recording_knows_exact_obstacles(scene, tmp_path):
    simulation = cama.Simulation(scene, backend="cpu", threads=1)
    with Recorder(tmp_path / "frames.h5", simulation) as recorder:
        recorder.add(0.0, simulation.positions, 0, 0)
    with Recording(tmp_path) as recording:
        assert [(p.shape, p.radius) for p in recording.obstacles] == [
            ("sphere", pytest.approx(0.055)),
            ("capsule", 0.04),
            ("box", 0),
            ("plane", 0),
        ]
        assert [p.shape for p in recording.cloths] == ["mesh"]


@pytest.mark.parametrize("surface", ["sphere", "capsule"])
def test_what_is_drawn_lies_on_the_surface_and_faces_outward(surface):
    points = np.array([[0.1, 0.2, 0.3], [0.4, -0.2, 0.5]])[: 1 if surface == "sphere" else 2]
    vertices, faces = tessellate(surface, 0.2, points)
    ends = np.repeat(points, 2, axis=0) if len(points) == 1 else points
    nearest = [
        ends[0]
        + np.clip((v - ends[0]) @ (ends[1] - ends[0]) / max((ends[1] - ends[0]) @ (ends[1] - ends[0]), 1e-300), 0, 1)
        * (ends[1] - ends[0])
        for v in vertices
    ]
    assert np.allclose(np.linalg.norm(vertices - nearest, axis=1), 0.2)
    x = vertices[faces]
    volume = (x[:, 0] * np.cross(x[:, 1], x[:, 2])).sum() / 6
    exact = np.pi * 0.2**2 * (4 / 3 * 0.2 + np.linalg.norm(ends[1] - ends[0]))
    assert volume == pytest.approx(exact, rel=0.02)


def test_what_is_drawn_of_a_plane_lies_in_it():
    points = np.array([[1.0, 2, 3], [2, 2, 3.5], [1, 3, 3]])
    vertices, faces = tessellate("plane", 0, points, seen=((5, -3, 2), 4.0))
    assert np.allclose(
        np.cross(vertices.mean(axis=0) - [5, -3, 2], np.cross(points[1] - points[0], points[2] - points[0])), 0
    )
    assert np.allclose(np.linalg.norm(vertices[1] - vertices[0]), 8)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    assert np.allclose((vertices - points[0]) @ normal, 0)
    assert (
        np.cross(vertices[faces][:, 1] - vertices[faces][:, 0], vertices[faces][:, 2] - vertices[faces][:, 0]) @ normal
        > 0
    ).all()
