# SPDX-License-Identifier: Apache-2.0
"""Pictures and video of a recording, without a display."""

import re
import sys

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
    assert render.choose_speed(0.5, 0.02, 30) == 0.5  # there is nothing more to see


def test_images_are_equally_spaced_moments():
    times = np.arange(101) * 0.01
    np.testing.assert_allclose(render.moments_of(times, 25, 1.0), np.arange(26) * 0.04, atol=1e-12)
    assert [render.place_of(times, m) for m in (0.0, 0.04, 1.0)] == [(0, 0), (4, 0), (100, 0)]
    assert render.place_of(times, 0.123) == (12, pytest.approx(0.3))
    assert render.place_of(np.array([0.5]), 0.5) == (0, 0)
    assert render.place_of(np.array([0, 0.1, 0.4]), 0.3) == (1, pytest.approx(2 / 3))


def test_the_film_moves_evenly(recording):
    """A sheet that moves at 1 m/s, recorded every 25 ms, at 30 images a second and half speed: 1/60 s an image."""
    vertices, _ = grid(20)
    times = np.arange(25) * 0.025
    with h5py.File(recording / "frames.h5", "r+") as f:
        del f["positions"], f["times"]
        f["times"] = times
        f["positions"] = np.stack([vertices + [t, 0, 0] for t in times])
    result = render.render(recording, fps=30, speed=0.5, size=(480, 270), azimuth=-90, elevation=60)
    assert result.images == 37
    middles = []
    for path in sorted((recording / "images").glob("*.png")):
        picture = imageio.imread(path).astype(int)
        middles.append(np.nonzero(picture[..., 2] > picture[..., 0] + 40)[1].mean())
    steps = np.diff(middles)
    assert steps.mean() > 1  # pixels
    assert np.abs(steps - steps.mean()).max() < 0.4 * steps.mean()


@pytest.mark.parametrize("program", ["/nowhere/ffmpeg", "/bin/ls"])
def test_a_wrong_ffmpeg_is_said_before_anything_is_drawn(recording, monkeypatch, program):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    with pytest.raises(cama.BackendError, match="IMAGEIO_FFMPEG_EXE names") as seen:
        render.render(recording, fps=10, speed=1, size=(64, 48))
    assert "disk" not in str(seen.value) and not (recording / "images").exists()


def test_what_is_missing_for_drawing_is_said_with_the_way_to_install_it(recording, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(cama.BackendError, match=f"{re.escape(sys.executable)} -m pip install pyvista`$"):
        render.render(recording)


def test_render_says_which_command_records(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(cama.FileError, match="`cama run drape` records the scene in out/drape"):
        render.render("drape")
    with pytest.raises(cama.FileError, match="`cama run SCENE -o mine` writes one"):
        render.render("mine")
    (tmp_path / "out" / "drape").mkdir(parents=True)
    (tmp_path / "out" / "drape" / "frames.h5").touch()
    with pytest.raises(cama.FileError, match="in another folder: `cama render out/drape`"):
        render.render("drape")


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
