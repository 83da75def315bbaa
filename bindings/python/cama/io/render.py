# SPDX-License-Identifier: Apache-2.0
"""Pictures and video of a recording, drawn by VTK without a display."""

import contextlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from ..errors import FileError, SceneError
from ..hints import similar
from .progress import Bar
from .recording import Recording
from .rendering.film import VIDEO, Film, needs, needs_ffmpeg, needs_webp, write_png
from .rendering.look import FORMATS, Look, check
from .rendering.moments import choose_speed, moments_of, speed_text
from .rendering.stage import Stage, pictures

MANY = 40  # images, beyond which it is worth while to start processes


@dataclass
class Rendered:
    """What `render` wrote."""

    images: int
    seconds: float
    speed: float
    files: list  #: a file of each video, the folder of the images, or the one picture
    notes: dict = field(default_factory=dict)  #: size and quality of videos with a hold or limit, by their file


def render(
    folder,
    look=None,
    fps=30,
    speed=None,
    formats=("png", "mp4"),
    frame=None,
    caption=False,
    progress=None,
    processes=1,
    hold=0.0,
    limit=None,
):
    """Draws a recording: OUT/images/frame_0000.png ..., OUT/video.mp4, OUT/video.webp. Returns a Rendered.

    Images are equally spaced in time; between recorded frames, positions are interpolated linearly.

    Args:
        folder: Where the recording is, or the file.
        look: A Look; None: the default.
        fps: Images per second of the film.
        speed: Of playback, 1 is real time; None chooses.
        formats: Of "png", "mp4" and "webp".
        frame: Number of a recorded frame, counted from 0, or from the end if it is negative: only this one is drawn, to
            OUT/frame_0012.png for number 12. With a turntable, a film of one turn around it.
        caption: Write time and speed into the pictures.
        progress: A rich Console for the progress; None: say nothing.
        processes: How many draw at once. A program that asks for more than one must start from below
            `if __name__ == "__main__":`.
        hold: How long videos stay at their last picture, s.
        limit: KB (1000 bytes) that each video may have: its quality is lowered until it fits, and where that is not
            enough its size, down to half; None: any.

    Raises:
        FileError, BackendError, SceneError
    """
    look = look or Look()
    for kind in formats:
        if kind not in FORMATS:
            raise SceneError(f"format {kind!r}: is not one of {', '.join(FORMATS)}{similar(kind, FORMATS)}")
    if limit is not None:
        _check_limit(limit, formats, frame is not None and not look.turntable)
    needs()
    if any(kind in VIDEO for kind in formats) and (frame is None or look.turntable):
        needs_ffmpeg()
        if "webp" in formats and (hold or limit is not None):
            needs_webp()
        look = replace(look, size=tuple(s - s % 2 for s in look.size))  # what the video codec takes
    with Recording(folder) as recording:
        check(look, recording)
        out = Path(folder) if Path(folder).is_dir() else Path(folder).parent
        if frame is not None and not look.turntable:
            return _draw_one(recording, out, look, _frame(recording, frame), caption)
        interval = float(np.median(np.diff(recording.times))) if len(recording) > 1 else 1.0
        speed = speed or choose_speed(float(recording.times[-1] - recording.times[0]), interval, fps)
        moments = moments_of(recording.times, fps, speed)
        if frame is not None:
            turn = max(2, round(360 / abs(look.turntable) * fps))
            speed, moments = 1.0, np.full(turn, recording.times[_frame(recording, frame)])
        bar = Bar(
            TextColumn("image"),
            MofNCompleteColumn(),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=progress,
        )
        texts = [f"{moment:.2f} s   {speed_text(speed)}" if caption else None for moment in moments]
        shots = [(moment, text, number / fps) for number, (moment, text) in enumerate(zip(moments, texts))]
        with Film(out, formats, look.size, fps, hold, limit and 1000 * limit) as film, bar:
            task = bar.add_task("", total=len(shots))
            with contextlib.closing(
                pictures(folder, recording, look, shots, processes if len(shots) > MANY else 1)
            ) as drawn:
                for picture in drawn:
                    film.add(picture)
                    bar.update(task, advance=1)
    files = film.files + ([out / "images"] if "png" in formats else [])
    return Rendered(len(moments), len(moments) / fps, speed, files, film.notes)


def _check_limit(limit, formats, single):
    if not limit > 0:
        raise SceneError(f"limit {limit:g}: is not a number of KB above 0")
    if single or not any(kind in VIDEO for kind in formats):
        raise SceneError("limit: is for films; give a format mp4 or webp, and for a single frame a turntable")


def _frame(recording, number):
    if not -len(recording) <= number < len(recording):
        raise SceneError(f"frame {number}: the recording has the frames 0 to {len(recording) - 1}")
    return number % len(recording)


def _draw_one(recording, out, look, number, caption):
    moment = recording.times[number]
    stage = Stage(recording, [moment], look)
    try:
        picture = stage.draw(moment, f"{moment:.2f} s" if caption else None)
    finally:
        stage.close()
    file = out / f"frame_{number:04d}.png"
    try:
        write_png(file, picture)
    except OSError as problem:
        raise FileError(f"{file}: writing failed ({problem})") from problem
    return Rendered(1, 0.0, 1.0, [file])
