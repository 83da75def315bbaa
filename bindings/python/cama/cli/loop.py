# SPDX-License-Identifier: Apache-2.0
"""The main loop of `cama run`."""

import contextlib
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
from ..io.checkpoint import NAME as CHECKPOINT
from ..io.progress import Bar
from ..io.reading import check_hdf5
from ..io.recording import NAME, Recorder, Recording
from ..io.summary import Summary


@dataclass
class Result:
    """How a run ended."""

    fields: dict  #: of summary.json
    interrupted: int = 0  #: number of the signal that stopped it: SIGINT (Ctrl-C) or SIGTERM; 0: none
    problem: Optional[Error] = None  #: what stopped it, else


@contextlib.contextmanager
def interruptible():
    """Yields a function that returns the number of the last signal (Ctrl-C or SIGTERM), or 0.

    A second signal raises KeyboardInterrupt.
    """
    came = []

    def note(number, frame):
        if came:
            raise KeyboardInterrupt
        came.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: came[0] if came else 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def progress_bar(console):
    """Frame, length of the steps, ms per step, contacts, intersections, time left."""
    return Bar(
        TextColumn("frame"),
        MofNCompleteColumn(),
        BarColumn(),
        TextColumn("steps of {task.fields[step]} ms"),
        TextColumn("{task.fields[ms]} ms/step"),
        TextColumn("{task.fields[contacts]} contacts"),
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
        check_hdf5(file)
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
    files = [folder / name for name in (NAME, CHECKPOINT, "summary.json")]
    frames, previous = 0, folder / "previous"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if keep is not None and files[0].exists():
            frames = frames_of(files[0])
        if frames:
            previous.mkdir(exist_ok=True)
        for file in files:
            if frames and file.exists():
                os.replace(file, previous / file.name)
            else:
                file.unlink(missing_ok=True)
                if frames:
                    (previous / file.name).unlink(missing_ok=True)
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None
    if frames:
        keep(frames, previous)


def run(simulation, folder, frames, store=None, progress=None, checkpoint_every=0, resume=False, keep=None):
    """Computes and records frames; writes frames.h5, summary.json and, however the run ends, checkpoint.h5.

    Args:
        simulation: The Simulation.
        folder: Folder of the files.
        frames: Number of frames after the start.
        store: Precision of the positions, "double" or "single"; None: double, or that of the file that is continued.
        progress: A rich Console for the progress bar, or None.
        checkpoint_every: Frames between checkpoints; 0: only one at the end.
        resume: Whether the simulation has loaded this folder's checkpoint and continues its frames.
        keep: As for `prepare`.

    Returns:
        A Result. Errors of a step are in it, not raised.
    """
    folder = Path(folder)
    if not resume:
        prepare(folder, keep)
    summary, problem, stopped = Summary(simulation), None, 0
    dtype = {None: None, "double": np.float64, "single": np.float32}[store]
    with (
        Recorder(
            folder / NAME, simulation, attributes(simulation), dtype, simulation.time if resume else None
        ) as recorder,
        progress_bar(progress) as bar,
        interruptible() as pressed,
    ):
        steps = simulation.steps_per_frame or None
        if resume:
            done, found = len(recorder.times) - 1, recorder.intersections
            if done >= frames:
                raise FileError(
                    f"{folder / NAME}: has {done} frames after the start already; ask for more than that with --frames"
                )
            summary.resume(found)
            left = steps and steps - round((simulation.time - recorder.times[-1]) / simulation.time_step)
        else:
            done, found, left = 0, record(simulation, recorder, summary), steps
        task = bar.add_task("", total=frames, completed=done, step="-", ms="-", contacts="-", found=found)
        try:
            for frame in range(done + 1, frames + 1):
                stopped = compute(simulation, summary, pressed, left)
                if stopped:
                    break
                left = steps
                found += record(simulation, recorder, summary)
                bar.update(
                    task,
                    advance=1,
                    step=f"{simulation.time_step * 1e3:.2g}",
                    ms=f"{summary.milliseconds():.1f}",
                    contacts=simulation.report["contacts"],
                    found=found,
                )
                if checkpoint_every and frame % checkpoint_every == 0 and frame < frames:
                    simulation.save_checkpoint(folder / CHECKPOINT)
        except Error as error:
            problem = error
    try:
        simulation.save_checkpoint(folder / CHECKPOINT)
    except Error as error:  # a disk that is full, a device that is lost
        problem = problem or error
    fields, unwritten = summary.write(folder)
    return Result(fields, stopped, problem or unwritten)


def compute(simulation, summary, pressed, steps):
    """Computes steps up to the next frame; returns the number of the signal that stopped them, or 0.

    steps: their number; None: until one ends a frame.
    """
    left = steps
    while left is None or left > 0:
        if pressed():
            return pressed()
        simulation.step()
        summary.add_step()
        if left is None:
            if simulation._core.frame_ended():
                break
        else:
            left -= 1
    return 0


def record(simulation, recorder, summary):
    """Records and audits the state; returns the number of intersections."""
    intersections = simulation.count_intersections()
    summary.add_frame(intersections)
    recorder.add(simulation.time, simulation.positions, simulation.report["contacts"], intersections)
    return intersections
