# SPDX-License-Identifier: Apache-2.0
"""What the Python tests share: small scenes, and a judge of intersections that is not ours."""

import json
import os
import signal

os.environ.setdefault("CAMA_BACKEND", "cpu")  # what the tests call `auto`, also where there is a GPU

import ipctk  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

import cama  # noqa: E402
from cama.io.recording import Recording  # noqa: E402

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # in a background job; programs that tests interrupt inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Free fall: by backward Euler the error after a window w is g dt w / 2 exactly, whatever the mesh.
FALL = {
    "name": "fall",
    "time_step": 0.005,
    "frames": 40,
    "contact": {"enabled": False},
    "cloth": [{"name": "sheet", "grid": {"size": [0.3, 0.3], "cells": [2, 2]}, "material": "cotton"}],
}
EULER = {"integrator": ["backward_euler"], "newton_iterations": [1]}  # in plans


def grid(cells=8, size=1.0, z=0.0):
    """Square sheet: vertices [n, 3], faces [m, 3]."""
    line = np.linspace(-size / 2, size / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], 1), faces


def edges_of(faces):
    """Unique undirected edges [k, 2]."""
    return np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)


def count_intersections(vertices, faces, first_obstacle_vertex):
    """Edges through faces by ipctk, obstacle against obstacle left out, shared vertices too."""
    faces = np.ascontiguousarray(faces, np.int32)
    edges = edges_of(faces).astype(np.int32)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    tree = ipctk.LBVH()
    tree.build(
        np.asfortranarray(vertices),
        np.asfortranarray(edges),
        np.asfortranarray(faces),
        1e-9 * np.linalg.norm(high - low),
    )
    found = 0
    for pair in tree.detect_edge_face_candidates():
        e, f = edges[pair.edge_id], faces[pair.face_id]
        if set(e) & set(f) or (min(e) >= first_obstacle_vertex and min(f) >= first_obstacle_vertex):
            continue
        found += ipctk.is_edge_intersecting_triangle(*vertices[e], *vertices[f])
    return found


def judge(path, every=1):
    """Intersections over the recorded frames of a folder, cloth against cloth and cloth against obstacles."""
    with Recording(path) as recording:
        first = recording.obstacles[0].vertices.start if recording.obstacles else recording.positions.shape[1]
        return sum(
            count_intersections(recording.frame(i), recording.faces, first) for i in range(0, len(recording), every)
        )


@pytest.fixture
def sheet():
    """Vertices and faces of a small sheet."""
    return grid()


@pytest.fixture
def fall(tmp_path):
    """The scene file of FALL."""
    path = tmp_path / "fall.json"
    path.write_text(json.dumps(FALL))
    return path


@pytest.fixture
def falling():
    """A small sheet over a sphere."""
    scene = cama.Scene(time_step=0.005, frames=5)
    scene.add_cloth(*grid(8, z=0.27), name="sheet")
    scene.add_obstacle(shape={"sphere": {"radius": 0.25, "triangles": 320}}, name="ball")
    return scene
