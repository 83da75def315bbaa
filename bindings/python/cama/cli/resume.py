# SPDX-License-Identifier: Apache-2.0
"""`cama run --resume`: finds the checkpoint that a run goes on from."""

import os

from rich.markup import escape

from ..errors import CollisionError, FileError, SceneError
from ..io import checkpoint
from ..io.checkpoint import BEFORE, SceneChanged
from ..io.checkpoint import NAME as CHECKPOINT
from ..io.recording import NAME, Recording
from .common import caution, console
from .loop import Resumed


def resume(simulation, folder, changed_scene=False):
    """Continues from the newest checkpoint of a folder that can be read and fits frames.h5, and says which.

    Args:
        simulation: The Simulation.
        folder: Folder of the results.
        changed_scene: As for Simulation.load_checkpoint.

    Returns:
        A Resumed; None where no checkpoint was written yet, so that the run begins anew.

    Raises:
        FileError, SceneError, CollisionError: None of the checkpoints will do. The newest one's reason is given.
    """
    there = [path for path in (folder / CHECKPOINT, folder / BEFORE) if path.exists()]
    if not there:
        console().print(f"{escape(str(folder))} has no checkpoint to go on from: starting from frame 0")
        return None
    problems = []
    for path in there:
        try:
            found = load(simulation, path, changed_scene)
        except SceneChanged:
            raise
        except (FileError, SceneError, CollisionError) as problem:
            problems.append(problem)
            continue
        for problem in problems:
            caution(f"{problem}; going on from the checkpoint before it")
        keep_as_newest(path)
        return found
    raise problems[0]


def load(simulation, path, changed_scene):
    """Loads one checkpoint and returns a Resumed. Raises as Simulation.load_checkpoint."""
    frames = path.with_name(NAME)
    if not frames.is_file():
        raise FileError(f"{path}: is of a run that recorded to {frames}, which is not there")
    counted = checkpoint.read_run(path)
    needed = int(counted["numbers"]["frames"]) if counted else 0
    with Recording(frames) as recording:
        if len(recording) < needed:
            raise FileError(
                f"{path}: comes after {needed} recorded frames with the start, but {frames} has {len(recording)}"
            )
    try:
        different = simulation.load_checkpoint(path, changed_scene=changed_scene)
    except SceneChanged as problem:
        raise SceneChanged(
            problem.changed,
            "run the scene that it was taken of, start anew without --resume, or go on with this one by "
            "--changed-scene",
        ) from None
    console().print(f"resumed at step {simulation.step_count:,}, {simulation.time:.4g} s, from {escape(str(path))}")
    if different:
        console().print(f"[yellow]not bit by bit as before: {escape(', '.join(different))}[/]")
    return Resumed(counted)


def keep_as_newest(path):
    """Gives a checkpoint the name of the newest one, so that the next one does not replace it first."""
    if path.name == CHECKPOINT:
        return
    try:
        os.replace(path, path.with_name(CHECKPOINT))
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None
