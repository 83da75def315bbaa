# SPDX-License-Identifier: Apache-2.0
"""Pictures and video of a recording, without a display."""

import colorsys
import os
import re
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress

import h5py
import numpy as np
import pytest

import conftest

pytest.importorskip("pyvista")
imageio = pytest.importorskip("imageio.v3")

from PIL import Image  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

import cama  # noqa: E402
from cama.cli.main import app  # noqa: E402
from cama.drum import Drum  # noqa: E402
from cama.io import render  # noqa: E402
from cama.io.recording import Part, Recording  # noqa: E402
from cama.io.rendering import camera, moments, surfaces  # noqa: E402
from cama.io.rendering.stage import Stage  # noqa: E402
from test_surfaces import point_triangles  # noqa: E402

SMALL = dict(size=(320, 180), quality="draft")
ABOVE = dict(azimuth=-90.0, elevation=89.0)


def grid(cells):
    """A sheet [0, 1] x [0, 1] at height 0."""
    vertices, faces = conftest.grid(cells)
    return vertices + [0.5, 0.5, 0], faces


def record(folder, times, cloths, obstacles=()):
    """Writes frames.h5 by hand: parts are (name, positions [frames, n, 3], faces)."""
    folder.mkdir(exist_ok=True)
    with h5py.File(folder / "frames.h5", "w") as f:
        parts = [*cloths, *obstacles]
        counts = [p.shape[1] for _, p, _ in parts]
        first = np.concatenate([[0], np.cumsum(counts)])
        f["positions"] = np.concatenate([p for _, p, _ in parts], axis=1)
        f["times"] = times
        f["faces"] = np.concatenate([faces + start for (_, _, faces), start in zip(parts, first)]).astype(np.int32)
        ranges = np.stack([first[:-1], first[1:]], axis=1)
        for kind, own in (("cloth", range(len(cloths))), ("obstacle", range(len(cloths), len(parts)))):
            f[f"{kind}_ranges"] = ranges[list(own)].reshape(-1, 2)
            f[f"{kind}_ranges"].attrs["names"] = np.array([parts[k][0] for k in own], dtype=h5py.string_dtype())
    return folder


@pytest.fixture
def recording(tmp_path):
    """A sheet that waves for half a second."""
    vertices, faces = grid(20)
    times = np.arange(26) / 50
    waves = np.stack([vertices + np.outer(0.1 * np.sin(8 * vertices[:, 0] + 9 * t), [0, 0, 1]) for t in times])
    return record(tmp_path, times, [("sheet", waves, faces)])


def still(folder, positions, faces, **others):
    """A recording of one frame of a cloth, and of obstacles, name=(positions, faces)."""
    return record(
        folder, [0.0], [("sheet", positions[None], faces)], [(name, p[None], f) for name, (p, f) in others.items()]
    )


def draw(folder, moment=0.0, **look):
    """A picture, [height, width, 3] int."""
    render.needs()
    with Recording(folder) as recording:
        stage = Stage(recording, recording.times, render.Look(**{**SMALL, **look}))
        picture = stage.draw(moment).astype(int)
        stage.close()
    return picture


def blue(picture):
    """Whether pixels are those of a blue cloth."""
    return picture[..., 2] > picture[..., 0] + 30


def test_draws_images_and_video(recording, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    result = render.render(recording, render.Look(size=(320, 180)), fps=10, speed=0.5)
    assert result.images == 11 and result.speed == 0.5
    pictures = [imageio.imread(p) for p in sorted((recording / "images").glob("*.png"))]
    assert len(pictures) == 11 and pictures[0].shape == (180, 320, 3)
    assert (pictures[0] != pictures[5]).mean() > 0.02
    assert 0.05 < blue(pictures[0].astype(int)).mean() < 0.7  # the sheet is in the picture, and not all of it
    assert imageio.imread(recording / "video.mp4").shape == (11, 180, 320, 3)
    assert not list(recording.rglob("*.partial*"))


def test_other_programs_read_what_is_written(recording):
    result = render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["webp"])
    with Image.open(recording / "video.webp") as film:
        assert (film.n_frames, film.size, film.info["loop"]) == (result.images, (320, 180), 0)
    assert result.files == [recording / "video.webp"] and not (recording / "images").exists()
    one = render.render(recording, render.Look(**SMALL), frame=-1)
    assert one.files == [recording / "frame_0025.png"]
    with Image.open(one.files[0]) as picture:
        assert picture.size == (320, 180)


def durations(path):
    """How long the images of a film are shown, s."""
    with Image.open(path) as film:
        result = []
        for number in range(film.n_frames):
            film.seek(number)
            film.load()
            result.append(film.info["duration"] / 1000)
    return result


def test_a_film_for_a_web_page(recording):
    """400 x 300, 15 images a second, at half speed as half a second is short; it holds its end for a second."""
    said = CliRunner().invoke(app, ["render", str(recording), "--film", "--quality", "draft", "--speed", "0.5"])
    assert said.exit_code == 0, said.output
    with Image.open(recording / "video.webp") as film:
        assert film.size == (400, 300) and film.info["loop"] == 0
    shown = durations(recording / "video.webp")
    assert np.allclose(shown[:-1], 1 / 15, atol=0.002) and 1 <= shown[-1] < 1.1
    assert sum(shown) == pytest.approx(16 / 15 + 1, abs=0.02)
    assert [file.name for file in recording.iterdir() if file.name != "frames.h5"] == ["video.webp"]


def test_options_of_a_film_are_those_given(recording):
    words = ["--film", "--width", 160, "--height", 120, "--fps", 10, "--speed", 1, "--to", "webp", "--to", "mp4"]
    said = CliRunner().invoke(app, ["render", str(recording), "--quality", "draft", *map(str, words)])
    assert said.exit_code == 0 and "real time" in said.output
    assert imageio.imread(recording / "video.mp4").shape == (16, 120, 160, 3)  # the last one for a second
    assert np.allclose(durations(recording / "video.webp")[:-1], 0.1)


def test_a_film_of_a_single_frame_needs_a_turntable(recording):
    said = CliRunner().invoke(app, ["render", str(recording), "--film", "--frame", "3"])
    assert said.exit_code == 2 and "--turntable 45" in said.output


def test_a_file_has_the_size_that_is_asked_for(recording):
    """The quality goes down, then the size of the picture; each limit is kept and most of it used."""
    look = render.Look(size=(320, 240), quality="draft")
    how = dict(look=look, fps=10, speed=0.5, formats=["webp", "mp4"])
    render.render(recording, **how)
    free = {kind: (recording / f"video.{kind}").stat().st_size / 1000 for kind in ("webp", "mp4")}
    widths = {}
    for share in (0.9, 0.5, 0.25):
        limit = share * min(free.values())
        result = render.render(recording, limit=limit, **how)
        assert all(0.3 * limit < file.stat().st_size / 1000 <= limit for file in result.files)
        with Image.open(recording / "video.webp") as film:
            assert film.n_frames == result.images == 11
            widths[share] = film.width
        assert all(f"{widths[share]} x " in note for file, note in result.notes.items() if file.suffix == ".webp")
    assert widths[0.9] == 320 and widths[0.25] < 320
    assert not list(recording.rglob("*.partial*"))


def test_a_size_that_cannot_be_had_is_said_and_the_film_of_before_stays(recording):
    before = render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["webp"]).files[0].read_bytes()
    with pytest.raises(cama.SceneError, match="limit 1 KB: the webp has [1-9][0-9]* KB at the lowest quality"):
        render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["webp"], limit=1)
    assert (recording / "video.webp").read_bytes() == before and not list(recording.rglob("*.partial*"))
    with pytest.raises(cama.SceneError, match="limit: is for films"):
        render.render(recording, limit=100, formats=["png"])
    with pytest.raises(cama.SceneError, match="limit: is for films"):
        render.render(recording, limit=100, frame=3)
    with pytest.raises(cama.SceneError, match="limit -2: is not"):
        render.render(recording, limit=-2)


def test_pictures_of_a_film_leave_no_traces(recording):
    """Each is stored whole: lossy differences to the one before would leave traces of what moved on."""
    render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["webp"], limit=1000)
    data, at, sides = (recording / "video.webp").read_bytes(), 12, []
    while at < len(data):
        kind, length = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        if kind == b"ANMF":  # x, y, width - 1, height - 1 of three bytes each
            sides.append([int.from_bytes(data[at + 8 + k : at + 11 + k], "little") for k in (0, 3, 6, 9)])
        at += 8 + length + length % 2
    assert sides == [[0, 0, 319, 179]] * 6


def test_webp_that_pillow_does_not_write_is_said_before_anything_is_drawn(recording, monkeypatch):
    monkeypatch.setattr("PIL.features.check", lambda name: False)
    with pytest.raises(cama.BackendError, match="Pillow that was built with WebP"):
        render.render(recording, fps=10, speed=1, formats=["webp"], limit=100)
    assert [file.name for file in recording.iterdir()] == ["frames.h5"]


def test_processes_draw_the_same_film(recording, monkeypatch):
    monkeypatch.setattr(render, "MANY", 2)
    films = []
    for processes in (1, 2):
        render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["png"], processes=processes)
        films.append([imageio.imread(p) for p in sorted((recording / "images").glob("*.png"))])
    assert len(films[0]) == 6
    np.testing.assert_array_equal(*films)


def test_a_process_that_is_stopped_is_an_error_and_no_half_of_a_film_stays(recording, monkeypatch):
    """As the system stops processes for lack of memory."""
    monkeypatch.setattr(render, "MANY", 2)
    started = ProcessPoolExecutor.submit

    def submit(pool, *task):
        future = started(pool, *task)
        for process in pool._processes.values():
            with suppress(ProcessLookupError):  # killed by the task before
                os.kill(process.pid, signal.SIGKILL)
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit)
    with pytest.raises(cama.BackendError, match="a process that draws images was stopped"):
        render.render(recording, render.Look(**SMALL), fps=10, speed=1, processes=2)
    assert [file.name for file in recording.rglob("*") if file.is_file()] == ["frames.h5"]


def test_a_turntable_goes_once_around_a_frame(recording):
    look = render.Look(size=(64, 48), quality="draft", turntable=60)
    result = render.render(recording, look, fps=2, formats=["png"], frame=3)
    assert result.images == 12 and result.seconds == 6  # 360 degrees at 60 degrees per second
    pictures = [imageio.imread(p).astype(int) for p in sorted((recording / "images").glob("*.png"))]
    assert all(np.abs(a - b).mean() > 0.5 for a, b in zip(pictures, pictures[1:]))


def test_what_cannot_be_written_is_a_named_error_and_nothing_half_written_stays(recording):
    (recording / "video.mp4").mkdir()
    with pytest.raises(cama.FileError, match="writing failed"):
        render.render(recording, render.Look(size=(64, 48)), fps=10, speed=1, formats=["mp4"])
    (recording / "frame_0003.png").mkdir()
    with pytest.raises(cama.FileError, match="writing failed"):
        render.render(recording, render.Look(size=(64, 48), quality="draft"), frame=3)
    assert not list(recording.glob("*.partial*"))


def test_an_interrupt_leaves_no_half_film(recording, monkeypatch):
    drawn = Stage.draw

    def stop(stage, moment, *more):
        if moment > 0.15:
            raise KeyboardInterrupt
        return drawn(stage, moment, *more)

    monkeypatch.setattr(Stage, "draw", stop)
    with pytest.raises(KeyboardInterrupt):
        render.render(recording, render.Look(**SMALL), fps=10, speed=1, formats=["mp4", "png"])
    assert not list(recording.rglob("*.partial*")) and not (recording / "video.mp4").exists()


def test_the_shadow_lies_on_the_ground_away_from_the_light(tmp_path):
    """A level sheet above the ground, seen from above; the key light comes from the left of the picture."""
    vertices, faces = grid(4)
    floor = np.array([[-9, -9, -1], [11, -9, -1], [11, 11, -1], [-9, 11, -1]], float)
    look = dict(size=(400, 400), distance=9.0, **ABOVE)
    picture = draw(still(tmp_path, vertices, faces, floor=(floor, np.array([[0, 1, 2], [0, 2, 3]]))), **look)
    sheet = blue(picture)
    rows, columns = np.nonzero(sheet)
    dark = ~sheet & (picture.sum(axis=2) < picture[0, 0].sum() - 60)
    assert dark.sum() > 0.2 * sheet.sum()
    assert np.nonzero(dark)[1].mean() > columns.max() - 0.1 * np.ptp(columns)
    assert not dark[:, : columns.min()].any()
    lit = ~sheet & (picture.sum(axis=2) > picture[0, 0].sum() - 9)
    assert (lit | dark | sheet).mean() > 0.8 and lit[:, : columns.min() - 3].mean() > 0.99  # no rim of the ground


def test_bodies_stand_whole_in_the_picture(tmp_path):
    """A skirt on a body twice as tall: every vertex of both, projected by hand, lies within the picture."""
    skirt, faces = grid(10)
    body = np.array([[x, y, z] for x in (0.3, 0.7) for y in (0.3, 0.7) for z in (-1.0, 1.2)])
    folder = still(tmp_path, skirt, faces, body=(body, np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]])))
    with Recording(folder) as recording:
        stage = Stage(recording, [0.0], render.Look(size=(320, 180), quality="draft"))
        eye, focus, up = stage._orbit.at(0, 0.0)
        stage.close()
    forward = (focus - eye) / np.linalg.norm(focus - eye)
    for point in np.concatenate([skirt, body]) - eye:
        half = np.tan(np.radians(15)) * (point @ forward)
        assert half > 0 and abs(point @ up) < half and abs(point @ np.cross(forward, up)) < half * 320 / 180


def test_the_camera_follows_the_cloth(tmp_path):
    """A sheet that goes 5 m along x past a ball that stays: it stays in the middle of the picture, and is large."""
    vertices, faces = grid(10)
    times = np.arange(21) / 20
    way = np.stack([vertices + [5 * t, 0, 0] for t in times])
    ball = np.repeat([[[6, 2, 0], [6.2, 2, 0], [6, 2, 0.2]]], len(times), axis=0)
    folder = record(tmp_path, times, [("sheet", way, faces)], [("ball", ball, np.array([[0, 1, 2]]))])
    middles, areas = {}, {}
    for follow in (False, True):
        drawn = [blue(draw(folder, moment=m, follow=follow, **{**ABOVE, "elevation": 60.0})) for m in (0.0, 0.5, 1.0)]
        middles[follow] = [np.nonzero(picture)[1].mean() for picture in drawn]
        areas[follow] = np.mean([picture.mean() for picture in drawn])
    assert np.ptp(middles[False]) > 150 and np.ptp(middles[True]) < 3
    assert areas[True] > 3 * areas[False]


def test_a_camera_that_follows_does_not_shake():
    """The way goes through both ends and without what is quick; a straight one is kept."""
    moments = np.linspace(2, 4, 101)
    straight = np.stack([moments, 3 * moments, 0 * moments], axis=1)
    way = camera.Way(moments, straight)
    np.testing.assert_allclose([way.at(m) for m in moments], straight - straight[0], atol=1e-12)
    shaken = straight + np.outer((-1.0) ** np.arange(101), [0.1, 0, 0])
    shaken[[0, -1]] = straight[[0, -1]]
    shifts = np.array([camera.Way(moments, shaken).at(m) for m in moments])
    assert np.abs(np.diff(shifts[:, 0], 2)).max() < 0.002
    for few in (1, 2, 3):
        ends = camera.Way(moments[:few], straight[:few])
        np.testing.assert_allclose(ends.at(moments[few - 1]), straight[few - 1] - straight[0], atol=1e-12)


def test_one_looks_into_what_is_closed_around_the_cloth(tmp_path):
    """A drum's faces point inwards: its near wall is not drawn and its far wall is solid, so that there is no haze."""
    vertices, faces = grid(10)
    drum = Drum(radius=1.0, depth=2.0, paddles=0, triangles=2000).mesh()
    sheet = 0.8 * (vertices - [0.5, 0.5, 0])
    part = Part("drum", slice(0, len(drum[0])), drum[1])
    assert surfaces.is_hollow(part, drum[0])
    for other in (drum[1][:, ::-1], drum[1][1:]):  # from outside, and open
        assert not surfaces.is_hollow(Part("drum", slice(0, len(drum[0])), other), drum[0])
    inside, outside, alone = (
        draw(
            still(tmp_path / name, sheet, faces, **walls), azimuth=-80.0, elevation=30.0, distance=9.0, target=(0, 0, 0)
        )
        for name, walls in (("in", {"drum": drum}), ("out", {"drum": (drum[0], drum[1][:, ::-1])}), ("alone", {}))
    )
    assert blue(inside).sum() > 0.9 * blue(alone).sum() > 0
    middle = slice(60, 120), slice(130, 190)
    seen = inside[middle][blue(inside[middle])].mean(axis=0) - alone[middle][blue(alone[middle])].mean(axis=0)
    hazy = outside[middle].mean(axis=0).mean(axis=0) - inside[middle].mean(axis=0).mean(axis=0)
    assert np.abs(seen).max() < 40 and np.abs(hazy).max() > 15


def test_back_faces_are_paler_than_front_faces(tmp_path):
    vertices, faces = grid(4)
    upright = vertices[:, [0, 2, 1]]
    colors = []
    for number, side in enumerate((faces, faces[:, ::-1])):
        picture = draw(still(tmp_path / str(number), upright, side), elevation=0.0, azimuth=-90.0)
        assert blue(picture).mean() > 0.1
        colors.append(np.median(picture[blue(picture)], axis=0) / 255)
    saturation = [colorsys.rgb_to_hsv(*color)[1] for color in colors]
    assert abs(saturation[0] - saturation[1]) > 0.1


def test_colors_and_opacity_are_the_users(tmp_path):
    vertices, faces = grid(4)
    wall = vertices[:, [0, 2, 1]] - [0, 0.5, 0.5]
    folder = still(tmp_path, vertices, faces, wall=(wall, faces))
    front = dict(azimuth=-90.0, elevation=20.0, background="white")

    def red(**look):
        picture = draw(folder, **front, **look)
        return ((picture[..., 0] > 1.5 * picture[..., 1]) & (picture[..., 0] > 60)).sum()

    solid, unseen = red(colors=("sheet=red",), obstacle_opacity=1.0), red(colors=("#ff0000",), obstacle_opacity=0.0)
    assert 0 <= solid < 0.5 * unseen and red(obstacle_opacity=0.0) == 0
    assert red(colors=("red",)) > 0.9 * unseen  # what hides more than half of the cloth is drawn clear by itself
    assert (draw(folder, **front)[2, 2] >= 254).all()


def test_obstacles_that_are_left_out_change_no_light(tmp_path):
    """A low sheet on the ground within four unseen walls: the ground around it has the colour of the background."""
    vertices, faces = grid(8)
    wall = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 1], [-1, 0, 1]]) * 3
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    floor = np.array([[-9, -9, 0], [11, -9, 0], [11, 11, 0], [-9, 11, 0]], float)
    walls = {f"wall {k}": (wall[:, [k % 2, 1 - k % 2, 2]] + shift, quad) for k, shift in enumerate((1.2, -0.2))}
    folder = still(tmp_path, vertices + [0, 0, 0.02], faces, floor=(floor, quad), **walls)
    picture = draw(folder, obstacle_opacity=0.0, elevation=40.0, distance=3.5, target=(0.5, 0.5, 0))
    lit = picture.sum(axis=2) > picture[0, 0].sum() - 6
    assert lit[~blue(picture)].mean() > 0.95 and blue(picture).mean() > 0.05


def test_obstacles_without_triangles_are_not_drawn(tmp_path):
    vertices, faces = grid(8)
    points = (np.eye(3) / 2, np.zeros((0, 3), int))
    with_points = draw(still(tmp_path / "points", vertices, faces, points=points))
    assert blue(with_points).mean() > 0.05


def test_finer_shading_leaves_the_surface_where_it_is():
    """Points between the vertices lie on the triangles unless a smooth surface is asked for."""
    vertices, faces = grid(6)
    vertices[:, 2] = np.random.default_rng(1).normal(scale=0.05, size=len(vertices))
    part = Part("sheet", slice(0, len(vertices)), faces)
    for smooth in (False, True):
        shape = surfaces.Cloth(part, vertices, smooth=smooth).surface
        assert shape.n_cells == 16 * len(faces)
        np.testing.assert_allclose(shape.points[: len(vertices)], vertices, atol=1e-6)
        away = max(point_triangles(point, vertices[faces]).min() for point in shape.points)
        assert away > 0.005 if smooth else away < 1e-6


def test_strain_is_that_of_the_deformation():
    """Stretched by 10 % one way and 3 % the other, and sheared: against the singular values of the deformation."""
    vertices, faces = grid(6)
    for gradient in (np.diag([1.1, 1.03, 1]), np.array([[1.0, 0.4, 0], [0, 1.0, 0], [0.2, 0, 1]])):
        most = np.linalg.svd(gradient[:, :2])[1][0] - 1
        np.testing.assert_allclose(surfaces.strain(vertices, vertices @ gradient.T, faces), most, rtol=1e-9)


def test_strain_has_the_colors_of_the_map(tmp_path):
    """Half of a sheet is stretched by 20 %, half not at all: the two ends of viridis, but for the light."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    vertices, faces = grid(30)
    stretched = vertices + np.outer(0.2 * np.maximum(vertices[:, 0] - 0.5, 0), [1, 0, 0])
    folder = record(tmp_path, [0.0, 1.0], [("sheet", np.stack([vertices, stretched]), faces)])
    picture = draw(folder, moment=1.0, show="strain", **ABOVE)
    for column, value in ((120, 0.0), (210, 1.0)):
        seen, map_ = picture[80, column], 255 * np.array(pyplot.get_cmap("viridis")(value)[:3])
        np.testing.assert_allclose(seen / np.linalg.norm(seen), map_ / np.linalg.norm(map_), atol=0.06)


def test_a_texture_lies_by_its_coordinates(tmp_path):
    """An image whose left half is red and right half green, u along x, with a seam in the middle."""
    vertices, faces = grid(8)
    folder = still(tmp_path, vertices, faces)
    Image.fromarray(np.repeat([[[255, 0, 0]] * 8 + [[0, 160, 0]] * 8], 16, axis=0).astype(np.uint8)).save(
        tmp_path / "halves.png"
    )
    look = render.Look(**SMALL, **ABOVE, texture=tmp_path / "halves.png")
    with pytest.raises(cama.SceneError, match="no cloth of the recording has texture coordinates"):
        render.render(folder, look)
    with Recording(folder) as recording:
        part = recording.cloths[0]
        part.uv, part.uv_faces = np.tile(vertices[:, :2], (2, 1)), faces + len(vertices) * (faces[:, :1] % 2)
        stage = Stage(recording, [0.0], look)
        picture = stage.draw(0.0).astype(int)
        stage.close()
    red, green = (np.nonzero(picture[..., k] > 2 * picture[..., 1 - k])[1] for k in (0, 1))
    assert len(red) > 1000 and len(green) > 1000 and np.percentile(red, 98) <= np.percentile(green, 2)


def test_wireframe_shows_edges(recording):
    plain, edges = (draw(recording, wireframe=on, size=(640, 360)) for on in (False, True))
    assert (edges.sum(axis=2) < 150).sum() > (plain.sum(axis=2) < 150).sum() + 1000


@pytest.mark.parametrize(
    "look, text",
    [
        (dict(colors=("blu",)), "color 'blu'.*did you mean 'blue'"),
        (dict(colors=("shet=red",)), "no cloth 'shet'; there are: sheet.*did you mean 'sheet'"),
        (dict(background="#12"), "color '#12'"),
        (dict(show="stran"), "did you mean 'strain'"),
        (dict(quality="finest"), "draft, good, best"),
        (dict(distance=-1.0), "distance -1"),
        (dict(target=(0, float("nan"), 0)), "target"),
        (dict(elevation=90.0), "elevation 90"),
        (dict(texture="nowhere.png"), "nowhere.png: no such file"),
    ],
)
def test_what_cannot_be_drawn_is_said_before_any_work(recording, look, text):
    with pytest.raises(cama.Error, match=text):
        render.render(recording, render.Look(**look))
    assert [p.name for p in recording.iterdir()] == ["frames.h5"]


def test_a_frame_or_format_that_is_not_there_is_said(recording):
    with pytest.raises(cama.SceneError, match="frames 0 to 25"):
        render.render(recording, frame=26)
    with pytest.raises(cama.SceneError, match="did you mean 'mp4'"):
        render.render(recording, formats=["mp3"])


def test_speed_slows_down_short_clips():
    assert moments.choose_speed(10.0, 0.005, 30) == 1
    assert moments.choose_speed(0.5, 0.001, 30) == 0.125
    assert moments.choose_speed(0.5, 0.02, 30) == 0.5  # there is nothing more to see


def test_images_are_equally_spaced_moments():
    times = np.arange(101) * 0.01
    np.testing.assert_allclose(moments.moments_of(times, 25, 1.0), np.arange(26) * 0.04, atol=1e-12)
    assert [moments.place_of(times, m) for m in (0.0, 0.04, 1.0)] == [(0, 0), (4, 0), (100, 0)]
    assert moments.place_of(times, 0.123) == (12, pytest.approx(0.3))
    assert moments.place_of(np.array([0.5]), 0.5) == (0, 0)
    assert moments.place_of(np.array([0, 0.1, 0.4]), 0.3) == (1, pytest.approx(2 / 3))


def test_the_film_moves_evenly(tmp_path):
    """A sheet that moves at 1 m/s, recorded every 25 ms, at 30 images a second and half speed: 1/60 s an image."""
    vertices, faces = grid(20)
    times = np.arange(25) * 0.025
    folder = record(tmp_path, times, [("sheet", np.stack([vertices + [t, 0, 0] for t in times]), faces)])
    look = render.Look(size=(480, 270), azimuth=-90, elevation=60, quality="draft")
    result = render.render(folder, look, fps=30, speed=0.5, formats=["png"])
    assert result.images == 37
    middles = []
    for path in sorted((folder / "images").glob("*.png")):
        middles.append(np.nonzero(blue(imageio.imread(path).astype(int)))[1].mean())
    steps = np.diff(middles)
    assert steps.mean() > 1  # pixels
    assert np.abs(steps - steps.mean()).max() < 0.4 * steps.mean()


@pytest.mark.parametrize("program", ["/nowhere/ffmpeg", "/bin/ls"])
def test_a_wrong_ffmpeg_is_said_before_anything_is_drawn(recording, monkeypatch, program):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    with pytest.raises(cama.BackendError, match="IMAGEIO_FFMPEG_EXE names") as seen:
        render.render(recording, fps=10, speed=1)
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
    eye, focus, up = camera.frame_camera(points, -60, 22, 16 / 9)
    forward = (focus - eye) / np.linalg.norm(focus - eye)
    right = np.cross(forward, up)
    depth = (points - eye) @ forward
    half = np.tan(np.radians(camera.VIEW_ANGLE / 2))
    assert (depth > 0).all()
    assert (np.abs((points - eye) @ up) <= half * depth).all()
    assert (np.abs((points - eye) @ right) <= half * 16 / 9 * depth).all()
    near, focus, _ = camera.frame_camera(points, -60, 22, 16 / 9, target=(1, 2, 3), distance=0.5)
    assert np.linalg.norm(near - [1, 2, 3]) == pytest.approx(0.5) and tuple(focus) == (1, 2, 3)
