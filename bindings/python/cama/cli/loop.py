# SPDX-License-Identifier: Apache-2.0
"""The main loop of `cama run`."""

import contextlib
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from .._core import __version__
from ..errors import Error, FileError
from ..io.checkpoint import NAME as CHECKPOINT
from ..io.recording import NAME, Recorder
from ..io.summary import Summary


@dataclass
class Result:
    """How a run ended."""

    fields: dict  #: of summary.json
    interrupted: int = 0  #: number of the signal that stopped it: SIGINT (Ctrl-C) or SIGTERM; 0: none
    problem: Optional[Error] = None  #: what stopped it, else


@contextlib.contextmanager
def interruptible():
    """Yields a function that gives the number of the signal that came, Ctrl-C's or SIGTERM, or 0; a second one raises KeyboardInterrupt."""
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
    """Frame, ms per step, contacts, intersections, time left."""
    return Progress(
        TextColumn("frame"),
        MofNCompleteColumn(),
        BarColumn(),
        TextColumn("{task.fields[ms]} ms/step"),
        TextColumn("{task.fields[contacts]} contacts"),
        TextColumn("{task.fields[found]} intersections"),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        disable=console is None,
        transient=True,
    )


def attributes(simulation):
    """What frames.h5 says about the run."""
    scene, options = simulation.scene, simulation.options
    return {
        "scene": scene.name,
        "description": scene.description,
        "backend": simulation.backend,
        "device": simulation.device,
        "precision": options["precision"],
        "accuracy": options["accuracy"],
        "time_step": simulation.time_step,
        "steps_per_frame": simulation.steps_per_frame,
        "frame_time": simulation.time_step * simulation.steps_per_frame,
        "thickness": scene.thickness,
        "cama_version": __version__,
        "created": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }


def prepare(folder):
    """Makes the folder and takes away what an earlier run wrote there. Throws FileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (NAME, CHECKPOINT, "summary.json"):
            (folder / name).unlink(missing_ok=True)
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None


def run(simulation, folder, frames, store=None, progress=None, checkpoint_every=0, resume=False):
    """Computes and records `frames` frames after the start; writes frames.h5, summary.json and, at the end however it comes, checkpoint.h5. Returns
    a Result.

    progress: a rich Console to draw the bar on, or None. checkpoint_every: frames from one checkpoint to the next, 0: the last alone. resume: the
    simulation has loaded this folder's checkpoint; goes on with its frames. store: "double" or "single"; None: double, or what the frames have that it
    goes on with. Errors of a step end the run and are returned, not raised.
    """
    folder = Path(folder)
    if not resume:
        prepare(folder)
    summary, problem, stopped = Summary(simulation), None, 0
    dtype = {None: None, "double": np.float64, "single": np.float32}[store]
    with (
        Recorder(
            folder / NAME, simulation, attributes(simulation), dtype, simulation.time if resume else None
        ) as recorder,
        progress_bar(progress) as bar,
        interruptible() as pressed,
    ):
        steps = simulation.steps_per_frame
        if resume:
            done, found = len(recorder.times) - 1, recorder.intersections
            if done >= frames:
                raise FileError(
                    f"{folder / NAME}: has {done} frames after the start already; ask for more than that with --frames"
                )
            summary.resume(found)
            left = steps - round((simulation.time - recorder.times[-1]) / simulation.time_step)
        else:
            done, found, left = 0, record(simulation, recorder, summary), steps
        task = bar.add_task("", total=frames, completed=done, ms="-", contacts="-", found=found)
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
    """Steps up to the next frame; returns the number of the signal that stopped them, or 0."""
    for _ in range(steps):
        if pressed():
            return pressed()
        simulation.step()
        summary.add_step()
    return 0


def record(simulation, recorder, summary):
    """Writes and audits the state as it is; returns the number of intersections."""
    intersections = simulation.count_intersections()
    summary.add_frame(intersections)
    recorder.add(simulation.time, simulation.positions, simulation.report["contacts"], intersections)
    return intersections
