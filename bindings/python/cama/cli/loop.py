# SPDX-License-Identifier: Apache-2.0
"""The main loop of `cama run`."""

import contextlib
import math
import os
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from .._core import __version__
from ..errors import Error, FileError
from ..io import checkpoint
from ..io.checkpoint import BEFORE
from ..io.checkpoint import NAME as CHECKPOINT
from ..io.journal import recover
from ..io.progress import Bar
from ..io.recording import NAME, Recorder, Recording
from ..io.summary import Summary

STOPPING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
EVERY = 60  # s of wall time between checkpoints
WIDE = 130  # columns of a terminal that all of the progress fits in
FIRST = "first step"  # which searches for contacts among all pairs


@dataclass
class Result:
    """How a run ended."""

    fields: dict  #: of summary.json
    interrupted: int = 0  #: number of the signal that stopped it: SIGINT (Ctrl-C), SIGTERM or SIGHUP; 0: none
    problem: Optional[Error] = None  #: what stopped it, else


@contextlib.contextmanager
def interruptible():
    """Yields a function that returns the number of the last signal (Ctrl-C, SIGTERM or SIGHUP), or 0.

    A second signal raises KeyboardInterrupt, but for SIGHUP, which a terminal may send twice. What was ignored, as
    SIGHUP is below nohup, stays ignored.
    """
    came = []

    def note(number, frame):
        if came and number != getattr(signal, "SIGHUP", None):
            raise KeyboardInterrupt
        came.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    heard = [number for number in STOPPING if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield lambda: came[0] if came else 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def progress_bar(console):
    """Frame, contacts, smallest gap, intersections, time left; where there is room triangles and times of steps too."""
    wide = console is None or not console.is_terminal or console.width >= WIDE
    sizes = ("{task.fields[triangles]} triangles", "steps of {task.fields[step]} ms", "{task.fields[ms]} ms/step")
    return Bar(
        TextColumn("frame"),
        MofNCompleteColumn(),
        BarColumn(bar_width=40 if wide else 6),
        TextColumn("{task.description}"),
        *(TextColumn(text) for text in sizes if wide),
        TextColumn("{task.fields[contacts]} contacts"),
        TextColumn("gap {task.fields[gap]} mm"),
        TextColumn("{task.fields[found]} intersections"),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
    )


def attributes(simulation):
    """Returns what frames.h5 says about the run."""
    scene, options = simulation.scene, simulation.options
    return {
        "scene": scene.name,
        "description": scene.description,
        "backend": simulation.backend,
        "device": simulation.device,
        "precision": options["precision"],
        "accuracy": options["accuracy"],
        "error": simulation.error,
        "time_step": 0.0 if simulation.error else simulation.time_step,
        "steps_per_frame": simulation.steps_per_frame,
        "frame_time": (
            scene.seconds_per_frame if simulation.error else simulation.time_step * simulation.steps_per_frame
        ),
        "thickness": scene.thickness,
        "cama_version": __version__,
        "created": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }


def frames_of(file):
    """Returns the number of frames after the start that a file has recorded; 0 for what is no recording."""
    try:
        with Recording(file) as recording:
            return len(recording) - 1
    except FileError:
        return 0


def prepare(folder, keep=None):
    """Makes the folder and takes away the files of an earlier run.

    Args:
        folder: The folder.
        keep: Called with (frames, folder) after results of an earlier run were moved to FOLDER/previous, where they
            replace those of the run before. None: they are deleted.

    Raises:
        FileError
    """
    frames, previous = 0, folder / "previous"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        recover(folder / NAME)
        if keep is not None and (folder / NAME).exists():
            frames = frames_of(folder / NAME)
        if frames:
            previous.mkdir(exist_ok=True)
        for name in (CHECKPOINT, BEFORE, NAME, "summary.json"):  # frames without a checkpoint are no run to go on with
            if frames and (folder / name).exists():
                os.replace(folder / name, previous / name)
            else:
                (folder / name).unlink(missing_ok=True)
                if frames:
                    (previous / name).unlink(missing_ok=True)
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None
    if frames:
        keep(frames, previous)


@dataclass
class Resumed:
    """What a run goes on from, beside the checkpoint that its simulation has loaded."""

    counted: Optional[dict]  #: what the summary had counted; None: the checkpoint does not say


class Run:
    """A run that is going on: steps, frames and checkpoints.

    Args:
        simulation: The Simulation.
        folder: Folder of the files.
        recorder: The Recorder.
        bar: The progress bar.
        every: Wall time between checkpoints, s; 0: not by time.
        every_frames: Frames between checkpoints; 0: not by frames.
    """

    def __init__(self, simulation, folder, recorder, bar, every, every_frames):
        self.summary = Summary(simulation)
        self._simulation, self._folder, self._recorder, self._bar = simulation, folder, recorder, bar
        self._every, self._every_frames, self._last = every, every_frames, time.monotonic()
        self._steps = simulation.steps_per_frame or None  # of a frame; None: until one ends it
        self._done, self._left = 0, self._steps  # frames after the start; steps up to the next one
        self._task = None

    def go_on(self, resumed, frames):
        """Finds the place of the checkpoint among the frames. Raises FileError if all frames are there already."""
        simulation, times = self._simulation, self._recorder.times
        self._done = len(times) - 1
        if self._done >= frames:
            raise FileError(
                f"{self._folder / NAME}: has {self._done} frames after the start already; ask for more than that with "
                "--frames"
            )
        self.summary.resume(resumed.counted, len(times), self._recorder.intersections)
        if self._steps:
            self._left = self._steps - round((simulation.time - times[-1]) / simulation.time_step)
        elif simulation._core.frame_ended() and simulation.time > times[-1] * (1 + 1e-9):
            self._left = 0  # the state ends a frame that could not be recorded

    def compute(self, frames, pressed):
        """Computes and records frames up to a number; returns the number of the signal that stopped it, or 0.

        Raises:
            Error: A step failed, or a file could not be written.
        """
        triangles = f"{self._simulation.cloth_triangle_count:,}"
        self._task = self._bar.add_task(FIRST, total=frames, completed=self._done, triangles=triangles, **self._shown())
        if not self.summary.frames:
            self._record()
        while self._done < frames:
            stopped = self._compute_frame(pressed)
            if stopped:
                return stopped
            self._record()
            self._done, self._left = self._done + 1, self._steps
            self._show(completed=self._done)
            by_frames = self._every_frames and self._done % self._every_frames == 0
            if self._done < frames and (by_frames or self._due()):
                self._save()
        return 0

    def _compute_frame(self, pressed):
        """Computes the steps up to the end of a frame; returns the number of the signal that stopped them, or 0."""
        simulation = self._simulation
        while self._left != 0:
            if pressed():
                return pressed()
            self._step()
            if self._left is not None:
                self._left -= 1
            elif simulation._core.frame_ended():
                break
            if self._left != 0 and self._due():
                self._save()
        return 0

    def _step(self):
        first = not self.summary.stepped
        with self._bar.during(f"{FIRST}, with the search among all pairs") if first else contextlib.nullcontext():
            self._simulation.step()
        self.summary.add_step()
        self._show(description="")

    def _record(self):
        """Records and audits the state."""
        simulation, intersections = self._simulation, self._simulation.count_intersections()
        self._recorder.add(simulation.time, simulation.positions, self.summary.contacts, intersections)
        self.summary.add_frame(intersections)

    def _shown(self):
        gap = self.summary.min_gap
        return {
            "step": f"{self._simulation.time_step * 1e3:.2g}" if self.summary.stepped else "-",
            "ms": f"{self.summary.milliseconds():.1f}" if self.summary.stepped else "-",
            "contacts": f"{self.summary.contacts:,}",
            "gap": f"{gap * 1e3:.2g}" if gap < math.inf else "-",
            "found": f"{self.summary.intersections:,}",
        }

    def _show(self, **changes):
        self._bar.update(self._task, **self._shown(), **changes)

    def _due(self):
        return self._every and time.monotonic() - self._last >= self._every

    def _save(self):
        self._recorder.sync()  # a checkpoint is of frames that are there
        self.save_checkpoint()
        self._last = time.monotonic()

    def save_checkpoint(self):
        """Writes checkpoint.h5 and keeps the one before. Raises FileError, or what a lost device raises."""
        checkpoint.write(self._folder / CHECKPOINT, self._simulation, self.summary.state(), BEFORE)


def run(
    simulation,
    folder,
    frames,
    store=None,
    progress=None,
    every=EVERY,
    every_frames=0,
    resumed=None,
    keep=None,
):
    """Computes and records frames; writes frames.h5, summary.json and, at times and however the run ends, checkpoints.

    Args:
        simulation: The Simulation.
        folder: Folder of the files.
        frames: Number of frames after the start.
        store: Precision of the positions, "double" or "single"; None: double, or that of the file that is continued.
        progress: A rich Console for the progress bar, or None.
        every: Wall time between checkpoints, s; 0: not by time.
        every_frames: Frames between checkpoints; 0: not by frames.
        resumed: What of this folder the simulation has loaded and continues, a Resumed; None: the start.
        keep: As for `prepare`.

    Returns:
        A Result. Errors of a step are in it, not raised.
    """
    folder = Path(folder)
    simulation._check_frame()
    if resumed is None:
        prepare(folder, keep)
    problem, stopped = None, 0
    dtype = {None: None, "double": np.float64, "single": np.float32}[store]
    with (
        Recorder(
            folder / NAME, simulation, attributes(simulation), dtype, simulation.time if resumed else None
        ) as recorder,
        progress_bar(progress) as bar,
        interruptible() as pressed,
    ):
        going_on = Run(simulation, folder, recorder, bar, every, every_frames)
        if resumed is not None:
            going_on.go_on(resumed, frames)
        try:
            stopped = going_on.compute(frames, pressed)
        except Error as error:
            problem = error
        except Exception:  # a fault of the program or of what it uses
            end(recorder, going_on)
            raise
        problem = end(recorder, going_on, problem)
    fields, unwritten = going_on.summary.write(folder)
    return Result(fields, stopped, problem or unwritten)


def end(recorder, going_on, problem=None):
    """Closes the recording and writes the last checkpoint; returns the problem, or the first that came up here."""
    for finish in (recorder.close, going_on.save_checkpoint):  # what a full disk refused is given back by the first
        try:
            finish()
        except Error as error:  # a disk that is full, a device that is lost
            problem = problem or error
    return problem
