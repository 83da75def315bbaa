# SPDX-License-Identifier: Apache-2.0
"""A simulation that goes on beside Blender, and the cache that it leaves."""

import json
import os
import subprocess
import time
from pathlib import Path

import bpy
import numpy as np

from .sampling import MODIFIER, Problem, sample

PYTHON = "python3"
FILES = ("job.json", "job.npz", "cloth.pc2", "progress.jsonl", "errors.txt")  # of a simulation, in its folder
SLICE = 0.05  # s of sampling between two events of the window


class Run:
    """A simulation of one object, which `advance` takes further until it returns False.

    Raises:
        Problem
    """

    current = None  # the one that goes on, or None

    def __init__(self, item):
        self.name, self.folder = item.name, folder_of(item)
        self.text, self.part, self.problem, self.warnings = "Sampling", 0.0, "", []
        self.frames = self.intersections = 0  # frames after the start in the cache
        self.cancelled, self._process, self._read = False, None, 0  # bytes of what the process has said
        self._made = False  # whether this run has begun a cache
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise Problem(f"{self.folder}: {problem.strerror}; choose another folder") from None
        self._samples = sample(item.name, self.folder)
        Run.current = self

    def advance(self):
        """Goes on for a moment; returns whether there is more to come."""
        try:
            if self.cancelled or Run.current is not self:
                return self._finish()
            if self._process is None:
                return self._sample() or self._start()
            return self._poll()
        except Problem as problem:
            self.problem = str(problem)
        except ReferenceError:
            self.problem = "the scene was changed while it was sampled; simulate again"
        except (OSError, np.linalg.LinAlgError) as problem:
            self.problem = f"{type(problem).__name__}: {problem}"
        except Exception:  # a fault of the add-on
            self._finish()
            raise
        return self._finish()

    def _sample(self):
        until = time.monotonic() + SLICE
        for part in self._samples:
            self.part, self.text = part, f"Sampling, {part:.0%}"
            if time.monotonic() > until:
                return True
        return False

    def _start(self):
        python = python_of()
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONHOME"}
        try:
            with open(self.folder / "progress.jsonl", "wb") as out, open(self.folder / "errors.txt", "wb") as errors:
                self._process = subprocess.Popen(
                    [python, "-m", "cama.blender.job", str(self.folder)],
                    stdin=subprocess.DEVNULL, stdout=out, stderr=errors, env=environment,
                )  # fmt: skip
        except OSError as problem:
            raise Problem(f"{python}: {problem.strerror}; name the Python that has cama in the preferences") from None
        self.text, self.part = "Starting", 0.0
        return True

    def _poll(self):
        ended = self._process.poll() is not None  # first, so that nothing is missed
        self._hear()
        if not ended:
            return True
        if self._process.returncode and not self.problem:
            said = (self.folder / "errors.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
            what = said[-1] if said else f"exit code {self._process.returncode}"
            if "No module named" in what:
                what += f"; {python_of()} does not have cama, name the Python that has it in the preferences"
            self.problem = f"the simulation ended: {what}"
        return self._finish()

    def _hear(self):
        """Takes note of what the process has said since the last time."""
        with open(self.folder / "progress.jsonl", "rb") as file:
            file.seek(self._read)
            lines = file.read()
        lines = lines[: lines.rfind(b"\n") + 1]
        self._read += len(lines)
        for line in lines.splitlines():
            self._note(json.loads(line))

    def _note(self, said):
        if "frame" in said:
            self._made, self.frames = True, said["frame"]
            self.part = said["frame"] / said["frames"]
            self.text = f"Frame {said['frame']} of {said['frames']}, {said.get('contacts', 0):,} contacts"
        self.intersections = said.get("intersections", self.intersections)
        self.problem = said.get("error", self.problem)
        self.warnings += [said["warning"]] if "warning" in said else []

    def stop(self):
        """Ends the process, whatever it does."""
        self._samples.close()
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _finish(self):
        """Stops, and shows what there is."""
        self.stop()
        Run.current = None
        if self._process is not None:
            self._hear()
        if self._made and self.name in bpy.data.objects:
            play(bpy.data.objects[self.name], self.folder / "cloth.pc2")
        return False


def python_of():
    """Returns the interpreter that has cama."""
    own = bpy.context.preferences.addons.get(__package__)
    return os.environ.get("CAMA_PYTHON") or (own.preferences.python if own else "") or PYTHON


def folder_of(item):
    """Returns the folder of an object's simulation: as chosen, else beside the .blend file, else a temporary one."""
    name = bpy.path.clean_name(item.name)
    if item.cama.folder:
        if item.cama.folder.startswith("//") and not bpy.data.filepath:
            raise Problem(f"{item.cama.folder}: is beside the .blend file, which is not saved yet; save it first")
        return Path(bpy.path.abspath(item.cama.folder))
    if bpy.data.filepath:
        file = Path(bpy.data.filepath)
        return file.parent / f"{file.stem}_cama" / name
    return Path(bpy.app.tempdir) / "cama" / name


def play(item, cache):
    """Gives an object a Mesh Cache modifier; one that it has stays at its place."""
    modifier = item.modifiers.get(MODIFIER) or item.modifiers.new(MODIFIER, "MESH_CACHE")
    saved = bpy.data.filepath and item.library is None
    try:
        path = bpy.path.relpath(str(cache)) if saved else str(cache)
    except ValueError:  # on another drive
        path = str(cache)
    modifier.cache_format, modifier.filepath = "PC2", path
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.frame_start = bpy.context.scene.frame_start
    item.update_tag()
    bpy.context.scene.frame_set(bpy.context.scene.frame_current)


def remove(item):
    """Takes the modifier off an object, and away the files of its simulation. Raises Problem."""
    modifier = item.modifiers.get(MODIFIER)
    if modifier is not None:
        item.modifiers.remove(modifier)
    folder = folder_of(item)
    try:
        for name in FILES:
            (folder / name).unlink(missing_ok=True)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as problem:
        raise Problem(f"{folder}: {problem.strerror}") from None
