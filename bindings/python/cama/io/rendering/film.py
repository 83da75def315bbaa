# SPDX-License-Identifier: Apache-2.0
"""Writing pictures to files: PNG sequences, MP4 and animated WebP."""

import bisect
import contextlib
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

from ...errors import BackendError, FileError, SceneError
from ...hints import require

VIDEO = {  # how imageio_ffmpeg.write_frames makes them
    "mp4": dict(codec="libx264", quality=8, macro_block_size=2),
    "webp": dict(
        codec="libwebp_anim", quality=None, macro_block_size=1, output_params=["-loop", "0", "-quality", "80"]
    ),
}
LOSSLESS = dict(codec="ffv1", quality=None, macro_block_size=1, pix_fmt_out="bgr0")
#: Qualities that are tried for a file of a limited size, best first: what encoders call crf and quality.
GRADES = {"mp4": range(10, 41, 2), "webp": range(80, 28, -3)}
SHARES = (1.0, 0.85, 0.7, 0.6, 0.5)  # of width and height, tried one after the other
WAITING = 8  # pictures that may wait for being compressed


def needs():
    """Raises BackendError if what draws is not installed; picks VTK's way to draw without a display."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    require("drawing", "pyvista", "imageio", "imageio_ffmpeg")


def needs_ffmpeg():
    """Raises BackendError if there is no program ffmpeg."""
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


def write_png(path, picture):
    """Writes a PNG file, [height, width, 3] uint8."""
    from PIL import Image

    partial = path.with_name(f"{path.stem}.partial.png")
    try:
        Image.fromarray(picture).save(partial, compress_level=3)
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def needs_webp():
    """Raises BackendError if Pillow writes no WebP."""
    from PIL import features

    if not features.check("webp"):
        raise BackendError("a film in webp needs a Pillow that was built with WebP; install one, or give --to mp4")


def compress(source, file, size, fps, hold, limit):
    """Writes a video from a lossless one, of at most `limit` bytes; returns a text of its size and quality.

    The quality is the best that fits; the size is the first of SHARES at which one fits. `hold`: how long the last
    picture stays, s.

    Raises:
        SceneError: None fits.
        OSError
    """
    kind = file.suffix[1:]
    grades, word = GRADES[kind], {"webp": "quality", "mp4": "crf"}[kind]
    encode = _encode_webp(source, size, fps, hold) if kind == "webp" else _encode_mp4(source, hold)
    if limit is None:
        encode(file, size, grades[0])
        return f"{size[0]} x {size[1]}, {word} {grades[0]}"

    def fits(side, grade):
        encode(file, side, grade)
        return file.stat().st_size <= limit

    for share in SHARES:
        side = tuple(max(2, 2 * round(share * length / 2)) for length in size)
        if not fits(side, grades[-1]):
            continue
        best = bisect.bisect_left(grades, True, hi=len(grades) - 1, key=lambda grade: fits(side, grade))
        fits(side, grades[best])
        return f"{side[0]} x {side[1]}, {word} {grades[best]}"
    least = file.stat().st_size / 1000
    raise SceneError(
        f"limit {limit / 1000:g} KB: the {kind} has {least:,.0f} KB at the lowest quality and half the size; draw "
        "fewer images (--fps, --speed)"
    )


def _encode_mp4(source, hold):
    import imageio_ffmpeg

    def encode(file, size, grade):
        filters = f"tpad=stop_mode=clone:stop_duration={hold:g},scale={size[0]}:{size[1]}:flags=area"
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-i", source, "-filter:v", filters]
        command += ["-codec:v", "libx264", "-crf", str(grade), "-pix_fmt", "yuv420p", file]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL)
        if done.returncode:
            raise OSError(done.stderr.strip() or "ffmpeg was stopped")

    return encode


def _encode_webp(source, size, fps, hold):
    """Each picture stands for itself: of differences to the one before, traces of what was there would stay."""
    import imageio_ffmpeg
    from PIL import Image

    frames = imageio_ffmpeg.read_frames(str(source), pix_fmt="rgb24")
    next(frames)  # what the file is
    pictures = [Image.frombytes("RGB", size, frame) for frame in frames]
    times = [round(1000 * number / fps) for number in range(len(pictures) + 1)]
    durations = [after - before for before, after in zip(times, times[1:])]
    durations[-1] += round(1000 * hold)

    def encode(file, size, grade):
        shown = pictures
        if size != pictures[0].size:
            shown = [picture.resize(size, Image.Resampling.HAMMING) for picture in pictures]
        how = dict(save_all=True, append_images=shown[1:], duration=durations, loop=0, kmin=0, kmax=1)
        shown[0].save(file, quality=grade, method=4, **how)

    return encode


class Film:
    """Files of one film. Videos have their name only once they are whole; an end by an exception leaves none.

    Args:
        out: The folder.
        formats: Of "mp4", "webp" and "png".
        size: Of the pictures, width and height.
        fps: Images per second.
        hold: How long videos stay at their last picture, s.
        limit: Bytes that a video may have; None: any.

    Raises:
        FileError, SceneError
    """

    def __init__(self, out, formats, size, fps, hold=0.0, limit=None):
        self._out, self._formats, self._size, self._fps, self._count = out, formats, size, fps, 0
        self._hold, self._limit = hold, limit
        self._late = bool(hold) or limit is not None  #: videos are compressed once all pictures are there
        self.files = [out / f"video.{kind}" for kind in formats if kind in VIDEO]
        self.notes = {}  #: size and quality of videos that are compressed at the end, by their file
        self._partial = [file.with_suffix(f".partial{file.suffix}") for file in self.files]
        self._source = out / "video.partial.mkv"

    def __enter__(self):
        import imageio_ffmpeg

        self._left = contextlib.ExitStack()
        self._left.callback(self._drop)
        self._pool = self._left.enter_context(ThreadPoolExecutor(1))
        self._waiting, self._movies = [], []
        with self._writing():
            if "png" in self._formats:
                self._clear(self._out / "images")
            for file in self.files:
                if file.is_dir():
                    raise IsADirectoryError(f"{file} is a folder")
            written = [(partial, VIDEO[partial.suffix[1:]]) for partial in self._partial]
            if self._late:
                written = [(self._source, LOSSLESS)]
            for partial, how in written:
                movie = imageio_ffmpeg.write_frames(str(partial), self._size, fps=self._fps, **how)
                self._movies.append(self._left.enter_context(contextlib.closing(movie)))
                movie.send(None)
        return self

    def add(self, picture):
        """Appends a picture, [height, width, 3] uint8."""
        with self._writing():
            if "png" in self._formats:
                path = self._out / "images" / f"frame_{self._count:04d}.png"
                self._waiting.append(self._pool.submit(write_png, path, picture))
                while len(self._waiting) > WAITING:
                    self._waiting.pop(0).result()
            for movie in self._movies:
                movie.send(picture)
        self._count += 1

    def __exit__(self, kind, problem, trace):
        with self._left:
            if kind is not None:
                return
            with self._writing():
                for waiting in self._waiting:
                    waiting.result()
                for movie in self._movies:
                    movie.close()
                if self._late and self._count:
                    for partial, file in zip(self._partial, self.files):
                        how = (self._size, self._fps, self._hold, self._limit)
                        self.notes[file] = compress(self._source, partial, *how)
                for partial, file in zip(self._partial, self.files):
                    os.replace(partial, file)

    def _drop(self):
        for partial in (*self._partial, self._source):
            with contextlib.suppress(OSError):
                partial.unlink()

    @contextlib.contextmanager
    def _writing(self):
        """A failure to write becomes a FileError, and drops what was begun."""
        try:
            yield
        except OSError as problem:
            self._left.close()
            said = (str(problem).splitlines() or [type(problem).__name__])[0]
            raise FileError(f"{self._out}: writing failed ({said}); is the disk full?") from problem

    def _clear(self, folder):
        """Makes the folder of images and takes away those of an earlier call."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob("frame_*.png"):
                old.unlink()
        except OSError as problem:
            raise FileError(f"{folder}: {problem.strerror}") from None
