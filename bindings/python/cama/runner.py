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

from ._core import __version__
from .errors import Error, FileError
from .recording import NAME, Recorder
from .summary import Summary


@dataclass
class Result:
    """How a run ended."""

    fields: dict                       #: of summary.json
    interrupted: bool = False          #: by Ctrl-C
    problem: Optional[Error] = None    #: what stopped it, else


@contextlib.contextmanager
def interruptible():
    """Yields a function that says whether Ctrl-C was pressed; pressed twice, it raises as usual."""
    pressed = threading.Event()

    def press(number, frame):
        if pressed.is_set():
            raise KeyboardInterrupt
        pressed.set()

    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return
    before = signal.signal(signal.SIGINT, press)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def progress_bar(console):
    """Frame, ms per step, contacts, intersections, time left."""
    return Progress(TextColumn("frame"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.fields[ms]} ms/step"),
                    TextColumn("{task.fields[contacts]} contacts"), TextColumn("{task.fields[found]} intersections"),
                    TimeRemainingColumn(), TextColumn("left"), console=console, disable=console is None, transient=True)


def attributes(simulation):
    """What frames.h5 says about the run."""
    scene, options = simulation.scene, simulation.options
    return {"scene": scene.name, "description": scene.description, "backend": simulation.backend, "device": simulation.device,
            "precision": options["precision"], "accuracy": options["accuracy"], "time_step": simulation.time_step,
            "steps_per_frame": simulation.steps_per_frame, "frame_time": simulation.time_step * simulation.steps_per_frame,
            "thickness": scene.thickness, "cama_version": __version__, "created": time.strftime("%Y-%m-%dT%H:%M:%S%z")}


def prepare(folder):
    """Makes the folder and takes away what an earlier run wrote there. Throws FileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (NAME, "summary.json"):
            (folder / name).unlink(missing_ok=True)
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None


def run(simulation, folder, frames, store="double", progress=None):
    """Computes and records `frames` frames after the start; writes frames.h5 and summary.json. Returns a Result.

    progress: a rich Console to draw the bar on, or None. Errors of a step end the run and are returned, not raised.
    """
    folder = Path(folder)
    prepare(folder)
    summary, problem, stopped = Summary(simulation), None, False
    dtype = np.float64 if store == "double" else np.float32
    with Recorder(folder / NAME, simulation, attributes(simulation), dtype) as recorder, \
            progress_bar(progress) as bar, interruptible() as pressed:
        found = record(simulation, recorder, summary)
        task = bar.add_task("", total=frames, ms="-", contacts="-", found=found)
        try:
            for _ in range(frames):
                if not compute(simulation, summary, pressed):
                    stopped = True
                    break
                found += record(simulation, recorder, summary)
                bar.update(task, advance=1, ms=f"{summary.milliseconds():.1f}", contacts=simulation.report["contacts"], found=found)
        except Error as error:
            problem = error
    return Result(summary.write(folder), stopped, problem)


def compute(simulation, summary, pressed):
    """The steps of one frame; False if Ctrl-C stopped them."""
    for _ in range(simulation.steps_per_frame):
        if pressed():
            return False
        simulation.step()
        summary.add_step()
    return True


def record(simulation, recorder, summary):
    """Writes and audits the state as it is; returns the number of intersections."""
    intersections = simulation.count_intersections()
    summary.add_frame(intersections)
    recorder.add(simulation.time, simulation.positions, simulation.report["contacts"], intersections)
    return intersections
