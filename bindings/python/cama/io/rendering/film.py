# SPDX-License-Identifier: Apache-2.0
"""Writing pictures to files: PNG sequences, MP4 and animated WebP."""

import contextlib
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

from ...errors import BackendError, FileError
from ...hints import require

VIDEO = {  # how imageio_ffmpeg.write_frames makes them
    "mp4": dict(codec="libx264", quality=8, macro_block_size=2),
    "webp": dict(
        codec="libwebp_anim", quality=None, macro_block_size=1, output_params=["-loop", "0", "-quality", "80"]
    ),
}
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


class Film:
    """Files of one film. Videos have their name only once they are whole; an end by an exception leaves none.

    Args:
        out: The folder.
        formats: Of "mp4", "webp" and "png".
        size: Of the pictures, width and height.
        fps: Images per second.

    Raises:
        FileError
    """

    def __init__(self, out, formats, size, fps):
        self._out, self._formats, self._size, self._fps, self._count = out, formats, size, fps, 0
        self.files = [out / f"video.{kind}" for kind in formats if kind in VIDEO]
        self._partial = [file.with_suffix(f".partial{file.suffix}") for file in self.files]

    def __enter__(self):
        import imageio_ffmpeg

        self._left = contextlib.ExitStack()
        self._left.callback(self._drop)
        self._pool = self._left.enter_context(ThreadPoolExecutor(1))
        self._waiting, self._movies = [], []
        with self._writing():
            if "png" in self._formats:
                self._clear(self._out / "images")
            for file, partial in zip(self.files, self._partial):
                if file.is_dir():
                    raise IsADirectoryError(f"{file} is a folder")
                how = VIDEO[file.suffix[1:]]
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
                for partial, file in zip(self._partial, self.files):
                    os.replace(partial, file)

    def _drop(self):
        for partial in self._partial:
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
