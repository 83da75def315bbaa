# SPDX-License-Identifier: Apache-2.0
"""What `cama export` writes, played back by Blender (the package bpy), is what was recorded.

bpy is looked for here, and in the interpreter that CAMA_BLENDER_PYTHON names: it needs one of its own Python version.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cama
from cama.cli.loop import run
from cama.io.exporting import export
from cama.io.recording import Recording

PYTHON = os.environ.get("CAMA_BLENDER_PYTHON") or (sys.executable if importlib.util.find_spec("bpy") else None)
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        PYTHON is None, reason="SKIPPED: neither bpy is installed nor CAMA_BLENDER_PYTHON names a Python"
    ),
]
OPEN_CACHE = Path(__file__).resolve().parents[2] / "examples" / "blender" / "open_cache.py"

# Opens a file and keeps, for every frame and mesh, the positions that modifiers and animation give, in the world.
PLAY = """
import runpy, sys
import bpy, numpy as np
script, source, target = sys.argv[1:4]
if source.endswith(".usdc"):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=source, set_frame_range=True)
elif source.endswith(".glb"):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 25
    bpy.ops.import_scene.gltf(filepath=source)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 0, 4
else:
    sys.argv = [script, source, *sys.argv[4:]]
    runpy.run_path(script, run_name="__main__")
scene, kept = bpy.context.scene, {}
for frame in range(scene.frame_start, scene.frame_end + 1):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    for mesh in [o for o in scene.objects if o.type == "MESH"]:
        seen = mesh.evaluated_get(graph)
        points = np.array([mesh.matrix_world @ v.co for v in seen.data.vertices])
        kept.setdefault(mesh.name, []).append(points)
        kept[mesh.name + " materials"] = np.array([m.name for m in mesh.data.materials], str)
        layer = mesh.data.uv_layers.active
        kept[mesh.name + " uv"] = np.array([d.uv[:] for d in layer.data] if layer else [])
kept["rate"] = scene.render.fps / scene.render.fps_base
np.savez(target, **kept)
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A sheet that falls on a moving box, 5 frames at 25 per second: folder, positions [frames, vertices, 3], cloth."""
    folder = tmp_path_factory.mktemp("blender")
    scene = cama.Scene(frame_time=0.04, frames=4)
    scene.add_cloth(shape={"grid": {"size": [0.4, 0.3], "cells": [6, 5]}}, translate=(0, 0, 0.02), name="sheet")
    scene.add_obstacle(
        shape={"box": {"size": [0.2, 0.2, 0.02], "triangles": 12}}, motion={"velocity": (0, 0, 0.1)}, name="box"
    )
    run(cama.Simulation(scene, accuracy="preview"), folder, 4)
    with Recording(folder) as recording:
        return folder, np.array([recording.frame(k) for k in range(5)]), recording.cloths[0]


def play(source, target, *options):
    command = [PYTHON, "-c", PLAY, str(OPEN_CACHE), str(source), str(target), *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return np.load(target)


def check(played, positions, cloth):
    assert np.allclose(played["sheet"], positions[:, :42], rtol=0, atol=2e-6)
    assert np.allclose(played["box"], positions[:, 42:], rtol=0, atol=2e-6)
    assert played["sheet materials"].tolist() == ["cotton"]
    assert np.allclose(played["sheet uv"].reshape(-1, 3, 2), cloth.uv[cloth.uv_faces], atol=1e-6)


def test_a_mesh_cache_plays_what_was_recorded(recorded, tmp_path):
    folder, positions, cloth = recorded
    export(folder, "mdd", tmp_path / "mdd")
    picture = tmp_path / "last.png"
    played = play(tmp_path / "mdd", tmp_path / "seen.npz", "--render", picture, "--save", tmp_path / "it.blend")
    check(played, positions, cloth)
    assert played["rate"] == pytest.approx(25)
    pixels = pytest.importorskip("imageio.v3").imread(picture)[..., :3].astype(int)
    assert pixels.shape == (480, 640, 3) and (tmp_path / "it.blend").stat().st_size > 10000
    blue = (pixels[..., 2] > pixels[..., 0] + 30).mean()
    assert 0.02 < blue < 0.6  # the cloth is in the picture, and not all of it


def test_usd_plays_what_was_recorded(recorded, tmp_path):
    folder, positions, cloth = recorded
    check(play(export(folder, "usd", tmp_path).files[0], tmp_path / "seen.npz"), positions, cloth)


def test_gltf_plays_what_was_recorded(recorded, tmp_path):
    folder, positions, cloth = recorded
    check(play(export(folder, "gltf", tmp_path).files[0], tmp_path / "seen.npz"), positions, cloth)
