# SPDX-License-Identifier: Apache-2.0
"""Pictures and video of a recording, without a display."""

import h5py
import numpy as np
import pytest

from conftest import grid

pytest.importorskip("pyvista")
imageio = pytest.importorskip("imageio.v3")

import cama  # noqa: E402
from cama.io import render  # noqa: E402


@pytest.fixture
def recording(tmp_path):
    """A sheet that waves for half a second, written by hand."""
    vertices, faces = grid(20)
    times = np.arange(26) / 50
    with h5py.File(tmp_path / "frames.h5", "w") as f:
        f["positions"] = np.stack(
            [vertices + np.outer(0.1 * np.sin(8 * vertices[:, 0] + 9 * t), [0, 0, 1]) for t in times]
        )
        f["times"], f["faces"] = times, faces.astype(np.int32)
        for kind, ranges, names in (
            ("cloth", [[0, len(vertices)]], ["sheet"]),
            ("obstacle", np.zeros((0, 2), int), []),
        ):
            f[f"{kind}_ranges"] = np.asarray(ranges)
            f[f"{kind}_ranges"].attrs["names"] = np.array(names, dtype=h5py.string_dtype())
    return tmp_path


def test_draws_images_and_video(recording, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    result = render.render(recording, fps=10, speed=0.5, size=(320, 180))
    assert result.images == 11 and result.speed == 0.5
    pictures = [imageio.imread(p) for p in sorted((recording / "images").glob("*.png"))]
    assert len(pictures) == 11 and pictures[0].shape == (180, 320, 3)
    assert (pictures[0] != pictures[5]).mean() > 0.02
    blue = pictures[0].astype(int)
    assert 0.05 < (blue[..., 2] > blue[..., 0] + 40).mean() < 0.7  # the sheet is in the picture, and not all of it
    assert imageio.imread(recording / "video.mp4").shape == (11, 180, 320, 3)
    assert not list(recording.glob("*.partial*"))


def test_what_cannot_be_written_is_a_named_error_and_nothing_half_written_stays(recording):
    (recording / "video.mp4").mkdir()
    with pytest.raises(cama.FileError, match="writing failed"):
        render.render(recording, fps=10, speed=1, size=(64, 48), images=False)
    assert not list(recording.glob("*.partial*"))


def test_speed_slows_down_short_clips():
    assert render.choose_speed(10.0, 0.005, 30) == 1
    assert render.choose_speed(0.5, 0.001, 30) == 0.125
    assert render.choose_speed(0.5, 0.02, 30) == 0.5  # images would only repeat
    times = np.arange(101) * 0.01
    frames = render.choose_frames(times, 25, 1.0)
    assert frames[0] == 0 and frames[-1] == 100 and (np.diff(frames) == 4).all()


def test_names_what_it_cannot_read(tmp_path):
    (tmp_path / "frames.h5").write_bytes(b"not HDF5")
    with pytest.raises(cama.FileError, match="frames.h5"):
        render.render(tmp_path)


def test_camera_sees_all_points():
    points = np.random.default_rng(0).normal(size=(500, 3)) * [3, 1, 0.5]
    eye, focus, up = render.frame_camera(points, -60, 22, 16 / 9)
    forward = (focus - eye) / np.linalg.norm(focus - eye)
    right = np.cross(forward, up)
    depth = (points - eye) @ forward
    half = np.tan(np.radians(render.VIEW_ANGLE / 2))
    assert (depth > 0).all()
    assert (np.abs((points - eye) @ up) <= half * depth).all()
    assert (np.abs((points - eye) @ right) <= half * 16 / 9 * depth).all()
