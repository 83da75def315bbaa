# SPDX-License-Identifier: Apache-2.0
"""Pictures and video of a recording, drawn by VTK without a display."""

import contextlib
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from ..errors import BackendError, FileError
from ..hints import require
from .progress import Bar
from .reading import check_hdf5
from .recording import NAME, Recording

CLOTHS = ["#3f74b5", "#e08a3c", "#4f9d69", "#b8485f", "#8366b0", "#c9a227", "#3a9aa3", "#8a6a52"]
BODY, FLOOR, SKY = "#cfc8bf", "#e9e9ec", "#f6f7f9"
SHORTEST = 4.0  # s of video below which the automatic speed slows down
VIEW_ANGLE = 30.0  # vertical, degrees


@dataclass
class Rendered:
    """What `render` wrote."""

    images: int
    seconds: float
    speed: float
    video: Path


def speed_text(speed):
    """For people: "real time", "1/4 speed"."""
    if speed == 1:
        return "real time"
    return (
        f"1/{round(1 / speed)} speed"
        if speed < 1 and abs(1 / speed - round(1 / speed)) < 1e-9
        else f"{speed:g} x speed"
    )


def choose_speed(duration, interval, fps):
    """Real time, or the first of 1/2, 1/4, ... that makes the video long enough, while images still differ."""
    speed = 1.0
    while duration / speed < SHORTEST and speed / fps > interval:
        speed /= 2
    return speed


def moments_of(times, fps, speed):
    """The moments of the images of a video, s: equally spaced from the first recorded frame on."""
    count = max(1, int(np.floor((times[-1] - times[0]) / speed * fps + 1e-9)) + 1)
    return times[0] + np.arange(count) * speed / fps


def place_of(times, moment):
    """(index, part): a moment lies this part of the way from recorded frame `index` to the next; 0: on the frame."""
    index = int(np.clip(np.searchsorted(times, moment, side="right") - 1, 0, max(0, len(times) - 2)))
    if len(times) == 1:
        return 0, 0.0
    part = float(np.clip((moment - times[index]) / (times[index + 1] - times[index]), 0, 1))
    return (index, 0.0) if part < 1e-6 else (index + 1, 0.0) if part > 1 - 1e-6 else (index, part)


def positions_at(recording, moment):
    """Positions [vertices, 3] at a moment, m: those of a recorded frame, or on the line between two."""
    index, part = place_of(recording.times, moment)
    if part == 0:
        return recording.frame(index)
    return (1 - part) * recording.frame(index) + part * recording.frame(index + 1)


def smooth_normals(vertices, faces):
    """Unit vertex normals [n, 3], area-weighted."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack([np.bincount(faces.ravel(), np.repeat(normals[:, k], 3), len(vertices)) for k in range(3)], axis=1)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return sums / np.where(length > 0, length, 1)


def tessellate(surface, radius, points, around=48, seen=((0, 0, 0), 1.0)):
    """Triangles to draw an exact obstacle by: vertices [n, 3], faces [m, 3]; their number depends on `surface` alone.

    points: its defining points, [1, 3] of a sphere, [2, 3] of a capsule, [3, 3] of a plane.
    seen: a point and a length, m; of a plane a square is drawn, twice as wide as that, around the foot of the point.
    """
    if surface == "plane":
        u, w = points[1] - points[0], points[2] - points[0]
        u = u / np.linalg.norm(u)
        w = w - (w @ u) * u
        w = w / np.linalg.norm(w)
        center, extent = seen
        off = np.asarray(center) - points[0]
        return points[0] + (off @ u) * u + (off @ w) * w + extent * np.array([-u - w, u - w, u + w, w - u]), np.array(
            [[0, 1, 2], [0, 2, 3]]
        )
    low, high = points[0], points[-1]
    axis = high - low
    length = np.linalg.norm(axis)
    axis = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    u /= np.linalg.norm(u)
    w = np.cross(axis, u)
    half = around // 4
    latitudes = np.concatenate([np.linspace(-np.pi / 2, 0, half + 1), np.linspace(0, np.pi / 2, half + 1)])
    ends = np.repeat([low, high], half + 1, axis=0)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * w
    vertices = (
        ends[:, None] + radius * (np.cos(latitudes)[:, None, None] * ring + np.sin(latitudes)[:, None, None] * axis)
    ).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(latitudes) - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    return vertices, np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])


def drawn(part, positions, seen=((0, 0, 0), 1.0)):
    """Vertices [n, 3] and faces [m, 3] that show a part of a frame; `seen` as for `tessellate`."""
    points = positions[part.vertices]
    if part.shape in ("mesh", "box"):
        return points, part.faces
    return tessellate(part.shape, part.radius, points, seen=seen)


def frame_camera(points, azimuth, elevation, aspect):
    """Position, focal point and up vector of a camera that sees all points."""
    a, e = np.radians([azimuth, elevation])
    back = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.cross(back, right)
    x, y, z = points @ right, points @ up, points @ back
    tangent = np.tan(np.radians(VIEW_ANGLE / 2)) / 1.12  # margin
    focus = right * (x.min() + x.max()) / 2 + up * (y.min() + y.max()) / 2 + back * (z.min() + z.max()) / 2
    x, y, z = x - focus @ right, y - focus @ up, z - focus @ back
    distance = max((np.abs(x) / (tangent * aspect) + z).max(), (np.abs(y) / tangent + z).max(), 1e-3)
    return focus + back * distance, focus, up


class Shade:
    """A soft shadow on the floor: how much hangs above each place, blurred, and less the higher it is."""

    SIZE = 256

    def __init__(self, center, width, floor):
        self.center, self.width, self.floor = np.asarray(center), width, floor
        frequency = np.fft.fftfreq(self.SIZE)[:, None] ** 2 + np.fft.rfftfreq(self.SIZE)[None] ** 2
        self._blur = [np.exp(-2 * (np.pi * sigma) ** 2 * frequency) for sigma in (2.5, 9.0)]
        radius = np.hypot(*np.meshgrid(*[np.linspace(-1, 1, self.SIZE)] * 2))
        fade = np.clip((1 - radius) / 0.45, 0, 1)
        self._fade = (fade * fade * (3 - 2 * fade))[..., None]

    def image(self, points, areas, floor_color, sky_color):
        """[SIZE, SIZE, 3] uint8 for points [n, 3] that stand for these areas [n]; fades to the sky at its rim."""
        height = np.maximum(points[:, 2] - self.floor, 0) / self.width
        place = (points[:, :2] - self.center) / self.width + 0.5
        cells = np.zeros((self.SIZE, self.SIZE))
        for blur, near in zip(self._blur, (True, False)):
            weight = areas * np.exp(-height / (0.03 if near else 0.16))
            grid = np.histogram2d(place[:, 1], place[:, 0], bins=self.SIZE, range=[[0, 1], [0, 1]], weights=weight)[0]
            cells += np.fft.irfft2(np.fft.rfft2(grid) * blur, s=grid.shape) * (0.6 if near else 0.9)
        cover = np.maximum(cells, 0) / (self.width / self.SIZE) ** 2
        light = 1 - 0.30 * (1 - np.exp(-0.8 * cover))
        shaded = light[..., None] * floor_color
        return (255 * (self._fade * shaded + (1 - self._fade) * sky_color)).clip(0, 255).astype(np.uint8)


class Stage:
    """Cloths, obstacles, floor, lights and camera in one off-screen window."""

    def __init__(self, recording, moments, size, azimuth, elevation):
        import pyvista

        self._pyvista, self._recording = pyvista, recording
        self._plotter = pyvista.Plotter(off_screen=True, window_size=size, lighting="none")
        self._plotter.set_background(SKY)
        self._plotter.enable_anti_aliasing("msaa", multi_samples=8)
        self._parts = []
        start, seen = positions_at(recording, moments[0]), self._sample(moments)
        low, high = seen.min(axis=0), seen.max(axis=0)
        self._seen = (low + high) / 2, np.linalg.norm(high - low)
        for index, part in enumerate(recording.cloths):
            self._add(part, start, CLOTHS[index % len(CLOTHS)], cloth=True)
        for part in recording.obstacles:
            self._add(part, start, BODY, cloth=False)
        self._add_floor(seen)
        self._add_lights(seen)
        self._add_camera(seen, azimuth, elevation, size[0] / size[1])
        self._caption = None

    def _add(self, part, positions, color, cloth):
        pv = self._pyvista
        vertices, faces = drawn(part, positions, self._seen)
        surface = pv.PolyData(vertices, np.column_stack([np.full(len(faces), 3), faces]).ravel())
        surface.point_data.active_normals = smooth_normals(vertices, faces)
        look = dict(ambient=0.36, diffuse=0.80, specular=0.10 if cloth else 0.16, specular_power=14 if cloth else 24)
        back = None
        if cloth:
            rgb = np.array(pv.Color(color).float_rgb)
            back = dict(look, color=tuple(0.55 * rgb + 0.45 * np.array([0.93, 0.92, 0.9])))
        self._plotter.add_mesh(
            surface, color=color, smooth_shading=False, backface_params=back, interpolation="phong", **look
        )
        self._parts.append((part, surface, faces))

    def _sample(self, moments):
        """Points [n, 3] the picture is framed on: cloth over the whole clip, and the obstacle vertices near it."""
        some = moments[np.unique(np.linspace(0, len(moments) - 1, min(len(moments), 24)).astype(int))]
        cloth, body = [], []
        for moment in some:
            positions = positions_at(self._recording, moment)
            cloth += [
                positions[p.vertices][:: max(1, (p.vertices.stop - p.vertices.start) // 2000)]
                for p in self._recording.cloths
            ]
            body += [drawn(p, positions)[0] for p in self._recording.obstacles if p.shape != "plane"]
        cloth = np.concatenate(cloth or body)
        low, high = np.percentile(cloth, 0.2, axis=0), np.percentile(cloth, 99.8, axis=0)
        reach = 0.4 * np.linalg.norm(high - low)
        body = np.concatenate(body or [cloth])
        near = ((body > low - reach) & (body < high + reach)).all(axis=1)
        return np.concatenate(
            [cloth[((cloth >= low) & (cloth <= high)).all(axis=1)], body[near][:: max(1, near.sum() // 20000)]]
        )

    def _add_floor(self, seen):
        pv = self._pyvista
        low, high = seen.min(axis=0), seen.max(axis=0)
        self._reach = np.linalg.norm(high - low)
        floor = low[2] - 0.004 * self._reach
        self._shade = Shade((low + high)[:2] / 2, 3.2 * self._reach, floor)
        center = (*self._shade.center, floor)
        plane = pv.Plane(
            center=center,
            direction=(0, 0, 1),
            i_size=self._shade.width,
            j_size=self._shade.width,
            i_resolution=1,
            j_resolution=1,
        )
        self._floor_texture = pv.Texture(np.zeros((Shade.SIZE, Shade.SIZE, 3), np.uint8))
        self._floor_texture.InterpolateOn()
        self._plotter.add_mesh(plane, texture=self._floor_texture, lighting=False)
        self._areas = [
            self._point_areas(faces, surface) for part, surface, faces in self._parts if part.shape != "plane"
        ]

    @staticmethod
    def _point_areas(faces, surface):
        corners = np.asarray(surface.points)[faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6
        return np.bincount(faces.ravel(), np.repeat(area, 3), len(surface.points))

    def _add_lights(self, seen):
        pv = self._pyvista
        center = (seen.min(axis=0) + seen.max(axis=0)) / 2
        for direction, color, intensity in (
            ((-0.35, -1.0, 1.15), "#fff6ea", 0.52),
            ((1.4, -0.5, 0.5), "#eaf1ff", 0.28),
            ((-1.2, 0.9, 0.7), "#ffffff", 0.24),
        ):
            self._plotter.add_light(
                pv.Light(
                    position=center + 10 * self._reach * np.array(direction),
                    focal_point=center,
                    color=color,
                    intensity=intensity,
                    light_type="scene light",
                )
            )
        self._plotter.add_light(pv.Light(light_type="headlight", intensity=0.50))

    def _add_camera(self, seen, azimuth, elevation, aspect):
        camera = self._plotter.camera
        camera.position, camera.focal_point, camera.up = frame_camera(seen, azimuth, elevation, aspect)
        camera.view_angle = VIEW_ANGLE
        self._plotter.reset_camera_clipping_range()

    def draw(self, moment, caption):
        """[height, width, 3] uint8 picture of a moment, s."""
        positions = positions_at(self._recording, moment)
        for part, surface, faces in self._parts:
            surface.points = drawn(part, positions, self._seen)[0]
            surface.point_data.active_normals = smooth_normals(np.asarray(surface.points), faces)
        pv = self._pyvista
        shaded = self._shade.image(
            np.concatenate([s.points for p, s, _ in self._parts if p.shape != "plane"]),
            np.concatenate(self._areas),
            np.array(pv.Color(FLOOR).float_rgb),
            np.array(pv.Color(SKY).float_rgb),
        )
        self._floor_texture.SetInputData(pv.Texture(shaded[::-1]).to_image())
        self._caption = self._plotter.add_text(caption, position=(16, 12), font_size=9, color="#8a8d93", name="caption")
        self._plotter.render()
        return np.ascontiguousarray(self._plotter.screenshot(return_img=True)[..., :3])

    def close(self):
        """Frees the window."""
        self._plotter.close()


def needs():
    """Raises BackendError if what draws is not installed; picks VTK's way to draw without a display."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    require("drawing", "pyvista", "imageio", "imageio_ffmpeg")
    import imageio_ffmpeg

    own = os.environ.get("IMAGEIO_FFMPEG_EXE")
    try:
        said = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-version"], capture_output=True, check=True).stdout
    except (RuntimeError, OSError, subprocess.CalledProcessError) as problem:
        said, reason = b"", str(problem)
    else:
        reason = "it does not answer as ffmpeg does"
    if not said.startswith(b"ffmpeg version"):
        raise BackendError(
            f"drawing needs the program ffmpeg, and IMAGEIO_FFMPEG_EXE names {own!r}, which is not it; unset the "
            "variable or let it name ffmpeg"
            if own
            else f"drawing needs the program ffmpeg: {reason}"
        )


def render(folder, fps=30, speed=None, size=(1280, 720), azimuth=-60.0, elevation=22.0, images=True, progress=None):
    """Draws a recording: OUT/images/frame_0000.png ... and OUT/video.mp4. Returns a Rendered.

    Images are equally spaced in time; between recorded frames, positions are interpolated linearly.

    speed: of playback, 1 is real time, None chooses. Raises FileError, BackendError.
    """
    needs()
    import imageio.v2 as imageio

    size = tuple(s - s % 2 for s in size)  # what the video codec takes
    check_hdf5(Path(folder) / NAME if Path(folder).is_dir() else folder)
    with Recording(folder) as recording:
        out = Path(folder) if Path(folder).is_dir() else Path(folder).parent
        interval = float(np.median(np.diff(recording.times))) if len(recording) > 1 else 1.0
        speed = speed or choose_speed(float(recording.times[-1] - recording.times[0]), interval, fps)
        moments = moments_of(recording.times, fps, speed)
        pictures = _clear(out / "images") if images else None
        stage, video = Stage(recording, moments, size, azimuth, elevation), out / "video.mp4"
        bar = Bar(
            TextColumn("image"),
            MofNCompleteColumn(),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=progress,
        )
        partial = out / "video.partial.mp4"
        try:
            with bar, imageio.get_writer(partial, fps=fps, codec="libx264", quality=8, macro_block_size=2) as movie:
                task = bar.add_task("", total=len(moments))
                for number, moment in enumerate(moments):
                    picture = stage.draw(moment, f"{moment:.2f} s   {speed_text(speed)}")
                    movie.append_data(picture)
                    if pictures:
                        imageio.imwrite(pictures / f"frame_{number:04d}.png", picture)
                    bar.update(task, advance=1)
            os.replace(partial, video)
        except OSError as problem:
            with contextlib.suppress(OSError):
                partial.unlink()
            said = (str(problem).splitlines() or [type(problem).__name__])[0]
            raise FileError(f"{out}: writing failed ({said}); is the disk full?") from problem
        finally:
            stage.close()
    return Rendered(len(moments), len(moments) / fps, speed, video)


def _clear(folder):
    """Makes the folder of images and takes away those of an earlier call."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob("frame_*.png"):
            old.unlink()
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None
    return folder
