# SPDX-License-Identifier: Apache-2.0
"""Continuous collision on public query sets with known truth; skipped where the data is absent (CAMA_TEST_DATA, else ../shared/data)."""

import csv
import importlib.util
import os
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cama import collision

DATA = Path(os.environ.get("CAMA_TEST_DATA", Path(__file__).resolve().parents[2] / ".." / "shared" / "data")) / "ccd"
needs_data = pytest.mark.skipif(not (DATA / "sample-queries").exists(), reason=f"SKIPPED: no test data {DATA}")
SCENES = ["cloth-ball", "cloth-funnel"]
FOLDERS = [
    "erleben-cube-internal-edges",
    "erleben-sliding-spike",
    "erleben-spike-hole",
    "erleben-spikes",
    "erleben-wedges",
    "unit-tests",
]


def reader(name):
    spec = importlib.util.spec_from_file_location(name, DATA / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def answer(points, edges, method):
    """points: [n, 8, 3], edges: [n] bool. Returns hit [n], time [n]."""
    hit, time = np.zeros(len(points), bool), np.ones(len(points))
    for wanted, query in ((True, collision.edge_edge_ccd), (False, collision.vertex_face_ccd)):
        rows = edges == wanted
        hit[rows], time[rows] = query(points[rows, :4], points[rows, 4:], method=method)
    return hit, time


@lru_cache
def samples():
    """Per folder: points [n, 8, 3], edges [n], truth [n], first time [n] (nan: none, or none known)."""
    with open(DATA / "sample-queries" / "toi_ours.csv") as file:
        first = {(r["file"], int(r["index"])): float(r["toi"] or "nan") for r in csv.DictReader(file)}
    sets = {}
    for q in reader("read_ccd_queries").sample_queries(str(DATA / "sample-queries")):
        assert q.exact
        sets.setdefault(q.scene, []).append((q.V, q.is_edge_edge, q.truth, first[q.file, q.index]))
    return {name: tuple(np.array(column) for column in zip(*rows)) for name, rows in sets.items()}


@lru_cache
def listed(scene):
    """As `samples`, of all listed pairs of two frames."""
    start, end, _ = reader("scalable_frames").load(scene)
    truth = np.load(DATA / "scalable" / scene / "truth_ours.npz")
    rows = np.concatenate([truth["ee_verts"], truth["vf_verts"]])
    edges = np.arange(len(rows)) < len(truth["ee_verts"])
    collide = np.concatenate([truth["ee_truth"], truth["vf_truth"]])
    first = np.concatenate([truth["ee_toi"], truth["vf_toi"]])
    return np.concatenate([start[rows], end[rows]], 1), edges, collide, np.where(collide, first, np.nan)


@needs_data
def test_all_folders_are_there():
    sets = samples()
    assert sorted(sets) == FOLDERS
    assert sum(len(s[0]) for s in sets.values()) == 4779
    assert sum(s[2].sum() for s in sets.values()) == 301


@needs_data
@pytest.mark.parametrize("folder", FOLDERS)
def test_sample_queries_additive(folder):
    points, edges, truth, first = samples()[folder]
    hit, time = answer(points, edges, "additive")
    assert not (truth & ~hit).any()
    assert (hit & ~truth).sum() < 0.005 * len(truth)
    assert not (time > first).any()  # never late


@needs_data
@pytest.mark.parametrize("folder", FOLDERS)
def test_sample_queries_cubic(folder):
    points, edges, truth, first = samples()[folder]
    hit, time = answer(points, edges, "cubic")
    assert not (truth & ~hit).any()
    # What the bound cannot tell from contact passes within 1e-13 of the extent; one vertex does so 0.78 before it touches.
    extent = np.ptp(points, axis=1).max(axis=1)
    extra = hit & ~truth
    middle = points[:, :4] + time[:, None, None] * (points[:, 4:] - points[:, :4])
    distance = np.where(edges, collision.edge_edge_distance(middle), collision.vertex_face_distance(middle))
    assert (distance[extra] <= 1e-13 * extent[extra]).all()
    assert (np.abs(time - first)[truth] > 1e-6).sum() <= (folder == "erleben-cube-internal-edges")


@needs_data
@pytest.mark.parametrize("scene", SCENES)
def test_whole_meshes(scene):
    points, edges, truth, first = listed(scene)
    hit, time = answer(points, edges, "additive")
    assert (hit == truth).all()
    assert not (time > first).any()
    hit, time = answer(points, edges, "cubic")
    assert (hit == truth).all()
    assert np.abs(time - first)[truth].max() < 1e-6


@needs_data
@pytest.mark.parametrize(
    "scene, edge_first, face_first",
    [("cloth-ball", 7.492069186824336e-06, 1.4768157568140283e-04), ("cloth-funnel", None, 0.0452323)],
)
def test_first_contacts(scene, edge_first, face_first):
    points, edges, _, _ = listed(scene)
    for method in ("additive", "cubic"):
        hit, time = answer(points, edges, method)
        for rows, expected in ((edges, edge_first), (~edges, face_first)):
            if expected is None:
                continue
            found = time[rows & hit].min()
            assert found == pytest.approx(
                expected, rel=1e-3 if method == "additive" else 3e-6
            )  # the funnel's is stated to six digits
            assert method == "cubic" or found <= expected
