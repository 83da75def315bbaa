# SPDX-License-Identifier: Apache-2.0
"""Blender's add-on: the process that simulates what it has written, and, with the package bpy, the add-on itself.

bpy is looked for as in test_blender.py.
"""

import ast
import json
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama import blender, options
from cama.blender import job
from cama.cli import app
from conftest import grid
from test_blender import PYTHON as BLENDER

ADDON = Path(blender.__file__).parent / "addon"
IN_BLENDER = Path(__file__).with_name("blender_addon.py")
needs_blender = pytest.mark.skipif(
    BLENDER is None, reason="SKIPPED: neither bpy is installed nor CAMA_BLENDER_PYTHON names a Python"
)
G = 9.81


def constant(name):
    """The value of a name in the add-on, which can be imported in Blender alone."""
    for line in ast.parse((ADDON / blender.MAIN).read_text(encoding="utf-8")).body:
        if isinstance(line, ast.Assign) and line.targets[0].id == name:
            return ast.literal_eval(line.value)
    raise AssertionError(name)


def test_the_addon_offers_what_there_is():
    assert set(constant("FABRICS")) == set(cama.fabrics())
    assert [*constant("LEVELS"), "paper"] == cama.accuracy_levels()
    assert set(constant("STARTS")) == set(options.words("intersections"))
    assert set(constant("PINCHES")) == set(options.words("pinch"))
    assert ".".join(map(str, constant("bl_info")["version"])) == cama.__version__


def test_the_command_writes_an_addon_that_knows_its_python(tmp_path):
    done = CliRunner().invoke(app, ["blender", "-o", str(tmp_path / "new" / "cama_cloth.zip")])
    assert done.exit_code == 0 and "Install from Disk" in done.output
    with zipfile.ZipFile(tmp_path / "new" / "cama_cloth.zip") as archive:
        files = {name: archive.read(name).decode() for name in archive.namelist()}
    assert sorted(files) == [f"cama_cloth/{name}.py" for name in ("__init__", "running", "sampling")]
    assert f"PYTHON = {json.dumps(sys.executable)}\n" in files["cama_cloth/running.py"]
    refused = CliRunner().invoke(app, ["blender", "-o", str(tmp_path)])
    assert refused.exit_code == 2 and "FileError" in refused.output


def turned(axis, angle):
    """The matrix [3, 3] of Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def placed(matrix, shift=(0, 0, 0)):
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = matrix, shift
    return made


@pytest.mark.parametrize("axis, angle", [((1, 2, 3), 0.4), ((1, 0, 0), np.pi), ((0, 1, 0.1), 3.1), ((0, 0, 1), -2.0)])
def test_rotations_are_found_in_matrices(axis, angle):
    quaternion, scale = job.rotation_of(2.5 * turned(axis, angle))
    expected = [np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis) / np.linalg.norm(axis))]
    assert scale == pytest.approx(2.5)
    assert min(np.abs(np.subtract(quaternion, s * np.array(expected))).max() for s in (1, -1)) < 1e-9
    assert job.rotation_of(np.diag([1, 1, 2])) is None and job.rotation_of(np.diag([1, 1, -1])) is None


def test_colliders_move_as_they_are_sampled():
    """Rigid ones on arcs between the samples, as a body turns; others on straight lines."""
    corners = np.array([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]])
    times = np.array([0.0, 1.0])
    first = placed(turned((0, 1, 0), 0.3), (0, 0, 5))
    rigid = np.stack([first, placed(turned((0, 0, 1), 1.0), (2, 0, 0)) @ first])
    start, given = job.motion_of(times, corners, rigid)
    motion = cama.Motion(**given)
    for k in range(2):
        expected = corners[0] @ rigid[k, :3, :3].T + rigid[k, :3, 3]
        np.testing.assert_allclose(motion.evaluate(times[k], start), expected, atol=1e-12)
    halfway = motion.evaluate(0.5, start)
    sides = [np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) for points in (start, halfway)]
    np.testing.assert_allclose(*sides, rtol=1e-12)
    assert job.motion_of(times, corners, np.stack([first, first]))[1] is None
    flattened = np.stack([np.eye(4), placed(np.diag([1, 1, 0.5]))])
    start, given = job.motion_of(times, corners, flattened)
    np.testing.assert_allclose(cama.Motion(**given).evaluate(0.5, start), corners[0] * [1, 1, 0.75], atol=1e-12)


def write_job(folder, frames=4, colliders=(), pins=(), targets=None, **settings):
    """Writes the job of a sheet of 25 vertices, 1 m across, whose object lies at x = 3."""
    vertices, faces = grid(4)
    common = {
        "name": "sheet", "frames": frames, "fps": 25.0, "gravity": [0, 0, -G], "fabric": "cotton", "level": "preview",
        "self_contact": True, "thickness": 0, "friction": 0.3, "intersections": "reject", "pinch": "stop",
        "colliders": [name for name, *_ in colliders],
    }  # fmt: skip
    (folder / "job.json").write_text(json.dumps({**common, **settings}))
    arrays = {"vertices": vertices, "faces": faces, "pins": np.array(pins, int)}
    arrays["to_object"] = np.tile(placed(np.eye(3), (-3, 0, 0)), (frames + 1, 1, 1))
    arrays["pin_positions"] = np.zeros((1, len(pins), 3)) if targets is None else targets
    for index, (_, *parts) in enumerate(colliders):
        arrays.update({f"collider_{index}_{key}": value for key, value in zip(("local", "faces", "matrices"), parts)})
    np.savez(folder / "job.npz", **arrays)
    return vertices


def cache_of(folder):
    """Positions [frames, vertices, 3] of a PC2 file, read by its description alone."""
    content = (folder / "cloth.pc2").read_bytes()
    signature, version, vertices, _, _, frames = struct.unpack("<12siiffi", content[:32])
    assert (signature, version) == (b"POINTCACHE2\0", 1)
    return np.frombuffer(content[32:], "<f4").reshape(frames, vertices, 3)


def run(folder, capsys):
    code = job.main(str(folder))
    return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_the_process_writes_frames_in_the_space_of_the_object(tmp_path, capsys):
    """Free fall, and vertices that are carried at 1 m/s."""
    times = np.arange(5) / 25
    carried = grid(4)[0][[0, 4]] + times[:, None, None] * [0, 0, 1.0]
    vertices = write_job(tmp_path, pins=[0, 4], targets=carried)
    code, said = run(tmp_path, capsys)
    assert code == 0 and [row.get("frame") for row in said] == [0, 1, 2, 3, 4, None]
    assert said[-1] == {"done": True, "intersections": 0}
    frames = cache_of(tmp_path)
    np.testing.assert_allclose(frames[0], vertices - [3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(frames[:, [0, 4]], carried - [3, 0, 0], atol=1e-6)
    write_job(tmp_path)
    run(tmp_path, capsys)
    fallen = cache_of(tmp_path)[:, :, 2].mean(axis=1) - vertices[0, 2]
    assert fallen[-1] == pytest.approx(-G / 2 * times[-1] ** 2, rel=0.15)  # of the level's large steps


def test_the_process_says_what_is_wrong(tmp_path, capsys):
    """An error keeps the cache of before; a warning does not stop it."""
    write_job(tmp_path)
    run(tmp_path, capsys)
    upright = grid(4)[0][:, [0, 2, 1]] - [0, 0, 0.5]
    through = ("wall", upright[None] + [0, 0.5, 0], grid(4)[1], np.tile(np.eye(4), (5, 1, 1)))
    write_job(tmp_path, colliders=[through])
    code, said = run(tmp_path, capsys)
    assert code == 2 and said[-1]["error"].startswith("CollisionError: ") and "wall" in said[-1]["error"]
    assert len(cache_of(tmp_path)) == 5
    write_job(tmp_path, fabric="cardboard")
    assert "MaterialError: " in run(tmp_path, capsys)[1][-1]["error"]
    code, said = run(tmp_path / "absent", capsys)
    assert code == 2 and "absent" in said[-1]["error"]


# In Blender.


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What blender_addon.py has found, by the name of its function."""
    folder = tmp_path_factory.mktemp("addon")
    blender.write_addon(folder / "cama_cloth.zip")
    own = {"BLENDER_USER_RESOURCES": str(folder / "user"), "OMP_NUM_THREADS": "2"}
    paths = os.pathsep.join([str(Path(cama.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [BLENDER, str(IN_BLENDER), str(folder), paths],
        capture_output=True, text=True, timeout=600, env={**os.environ, **own},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads((folder / "seen.json").read_text()), folder


@pytest.mark.long
@needs_blender
def test_the_modifier_plays_the_frames(seen):
    """In a rotated and scaled object, below a subdivision and above one more, its pins carried by animations."""
    found, folder = seen[0]["plays"], seen[1]
    cache, matrices = cache_of(folder / "plays"), np.array(found["matrices"])
    assert found["result"] == ["FINISHED"] and len(cache) == 9 and found["modifiers"] == ["first", "cama", "after"]
    for frame in range(9):
        world = cache[frame] @ matrices[frame, :3, :3].T + matrices[frame, :3, 3]
        np.testing.assert_allclose(found["world"][frame], world, atol=2e-6)
    pinned = found["pinned"]
    assert len(pinned) >= 3
    np.testing.assert_allclose(np.array(found["world"])[:, pinned], found["pin_path"], atol=2e-6)
    middle = np.array(found["world"])[:, :, 2].mean(axis=1)
    assert middle[-1] < middle[0] - 0.05  # the rest falls


@pytest.mark.long
@needs_blender
def test_colliders_that_move_and_deform_carry_the_cloth(seen):
    found = seen[0]["carries"]
    assert found["result"] == ["FINISHED"]
    assert 0.3 < found["lowest"] < 0.32  # the plate rises by 0.3 m, by a shape key
    assert found["top"] > 0.45  # the ball on it by its own animation, to 0.45 m
    assert found["unit"] == pytest.approx(-G / 2 * 0.16**2, rel=0.1)  # centimetres as the unit of the scene


@pytest.mark.long
@needs_blender
def test_errors_are_reports(seen):
    found = seen[0]["errors"]
    for key, words in {
        "intersecting": "CollisionError: ",
        "no group": "no vertex group nothing",
        "no map": "has no UV map",
        "levels": "modifier both differs between viewport and render",
        "python": "name the Python that has cama",
        "no cama": "does not have cama",
        "hidden": "collider wall is hidden",
        "unsaved": "save it first",
    }.items():
        assert words in found[key], key
    assert found["mode"] and found["state"] == "after"


@pytest.mark.long
@needs_blender
def test_a_simulation_can_be_cancelled_and_taken_away(seen):
    found = seen[0]["cancels"]
    assert found["ended"] and 2 <= found["frames"] <= found["cached"] <= found["frames"] + 1 < 2000
    assert found["removed"] == [] and found["files"] == []
    assert found["slowest"] < 1.0  # s that Blender waits for a single poll


@pytest.mark.long
@needs_blender
def test_the_addon_leaves_nothing_behind(seen):
    assert seen[0]["leaves"] == {"property": False, "handlers": 0, "operators": [], "again": True}


@pytest.mark.long
@needs_blender
def test_a_picture_of_the_cloth(seen):
    pixels = pytest.importorskip("imageio.v3").imread(seen[1] / "picture.png")[..., :3].astype(int)
    blue = (pixels[..., 2] > pixels[..., 0] + 30).mean()
    assert pixels.shape == (360, 480, 3) and 0.05 < blue < 0.7
