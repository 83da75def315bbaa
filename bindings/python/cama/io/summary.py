# SPDX-License-Identifier: Apache-2.0
"""summary.json: what a run did and what it cost."""

import array
import contextlib
import json
import math
import os
import statistics
import time
from pathlib import Path

import numpy as np

from ..errors import FileError

NAME = "summary.json"
SUMS = (
    "milliseconds",
    "iterations",
    "time_step",
    "truncated",
    "released",
    "retries",
    "rejected",
    "over_error",
)  # of the reports of steps
LARGEST = ("iterations", "time_step", "contacts", "impacts", "lost_motion")


class Summary:
    """Collects the report of every step and the audit of every frame, over all parts of a run that was continued."""

    def __init__(self, simulation):
        self._simulation, self._begun = simulation, time.monotonic()
        self._milliseconds, self._stages = array.array("d"), {}  # of every step; {stage: sum}
        self._resumed_at = None
        self.stepped = False  #: whether `add_step` was called
        self._numbers = {
            **{f"sum {name}": 0 for name in SUMS},
            **{f"largest {name}": -math.inf for name in LARGEST},
            "smallest time_step": math.inf,
            "intersections": 0,
            "min_gap": math.inf,
            "max_strain": -math.inf,
            "frames": 0,  # that were recorded, the start among them
            "counted_from": 0,  # steps before it are not in the sums
            "wall_time": 0,  # s, of the parts before this one
            "peak_memory_bytes": 0,
            "last contacts": 0,  # of the last step
            "last gap": math.inf,
        }

    def resume(self, state, frames, intersections):
        """Call before the first step of a run that continues.

        Args:
            state: What `state` returned when the checkpoint was written. None, or that of a version that counted other
                things: the sums begin here, and `counted_from` says so.
            frames: Number of frames that are kept, the start among them.
            intersections: In these frames.
        """
        self._resumed_at = self._simulation.step_count
        if state is None or state["numbers"].keys() != self._numbers.keys():
            self._numbers["counted_from"] = self._resumed_at
        else:
            self._numbers, self._stages = dict(state["numbers"]), dict(state["stages"])
            self._milliseconds = array.array("d", state["milliseconds"])
        self._numbers.update(frames=frames, intersections=intersections)

    def _gap(self):
        """Of the last step, which another part of the run may have computed."""
        return self._simulation.min_gap if self.stepped or self._resumed_at is None else self._numbers["last gap"]

    def state(self):
        """Returns what a checkpoint keeps of it: {"numbers": {...}, "stages": {...}, "milliseconds": [steps]}."""
        s = self._simulation
        now = {
            "wall_time": self.wall_time,
            "peak_memory_bytes": max(self._numbers["peak_memory_bytes"], s.peak_memory_bytes),
            "last gap": self._gap(),
        }
        numbers = {name: float(value) for name, value in {**self._numbers, **now}.items()}
        return {"numbers": numbers, "stages": dict(self._stages), "milliseconds": np.array(self._milliseconds)}

    def add_step(self):
        """Call after every step."""
        self.stepped = True
        report, numbers = self._simulation.report, self._numbers
        for name in SUMS:
            numbers[f"sum {name}"] += report[name]
        for name in LARGEST:
            numbers[f"largest {name}"] = max(numbers[f"largest {name}"], report[name])
        numbers["smallest time_step"] = min(numbers["smallest time_step"], report["time_step"])
        numbers["last contacts"] = report["contacts"]
        self._milliseconds.append(report["milliseconds"])
        for name, milliseconds in self._simulation.timings.items():
            self._stages[name] = self._stages.get(name, 0.0) + milliseconds

    def add_frame(self, intersections):
        """Call after every recorded frame."""
        numbers = self._numbers
        numbers["intersections"] += intersections
        numbers["min_gap"] = min(numbers["min_gap"], self._gap())
        numbers["max_strain"] = max(numbers["max_strain"], self._simulation.max_strain)
        numbers["frames"] += 1

    @property
    def wall_time(self):
        """Time of the run and of the parts before it, up to their checkpoints, s."""
        return self._numbers["wall_time"] + time.monotonic() - self._begun

    @property
    def frames(self):
        """Number of recorded frames, the start among them."""
        return int(self._numbers["frames"])

    @property
    def contacts(self):
        """Contacts of the last step, which another part of the run may have computed."""
        return int(self._numbers["last contacts"])

    @property
    def intersections(self):
        """In the recorded frames."""
        return int(self._numbers["intersections"])

    @property
    def min_gap(self):
        """Smallest distance at the recorded frames, m; inf: there were no candidate pairs."""
        return self._numbers["min_gap"]

    def milliseconds(self):
        """Returns the mean time of a step, ms."""
        return self._mean("milliseconds") if self._milliseconds else math.nan

    def _mean(self, name):
        return self._numbers[f"sum {name}"] / len(self._milliseconds) if self._milliseconds else None

    def fields(self):
        """Returns the fields of summary.json; numbers that are not finite are None."""
        s, energy, numbers, times = self._simulation, self._simulation.energy(), self._numbers, self._milliseconds
        return finite(
            {
                "scene": s.scene.name,
                "backend": s.backend,
                "device": s.device,
                "precision": s.options["precision"],
                "accuracy": s.options["accuracy"],
                "triangles": s.cloth_triangle_count,
                "vertices": s.cloth_vertex_count,
                "rest_shapes": {cloth.name: cloth.rest_shape for cloth in s.scene.cloths},
                "obstacles": {obstacle.name: obstacle.source for obstacle in s.scene.obstacles},
                "steps": s.step_count,
                "resumed_at": self._resumed_at,
                "counted_from": int(numbers["counted_from"]),
                "wall_time": self.wall_time,
                "error": s.error,
                "dt": self._mean("time_step") if s.error else s.time_step,
                "time_steps": {"min": numbers["smallest time_step"], "max": numbers["largest time_step"]},
                "rejected": int(numbers["sum rejected"]),
                "over_error": int(numbers["sum over_error"]),
                "ms_per_step": {
                    "mean": self._mean("milliseconds"),
                    "median": statistics.median(times) if times else None,
                    "max": max(times, default=None),
                },
                "stages": {name: total / max(1, len(times)) for name, total in self._stages.items()},
                "pcg": {
                    "iterations": {
                        "mean": self._mean("iterations"),
                        "max": int(numbers["largest iterations"]) if times else None,
                    }
                },
                "contacts": {"max": int(max(0, numbers["largest contacts"]))},
                "impacts": {"max": int(max(0, numbers["largest impacts"]))},
                "intersections": self.intersections,
                "min_gap": numbers["min_gap"],
                "max_strain": numbers["max_strain"],
                "energy": dict(energy, total=sum(energy.values())),
                "peak_memory_bytes": int(max(numbers["peak_memory_bytes"], s.peak_memory_bytes)),
                "truncated": int(numbers["sum truncated"]),
                "lost_motion": max(0.0, numbers["largest lost_motion"]),
                "released": int(numbers["sum released"]),
                "retries": int(numbers["sum retries"]),
                "state_hash": s.state_hash,
            }
        )

    def write(self, folder):
        """Writes summary.json completely or not at all; returns its fields, and the FileError or None."""
        fields = self.fields()
        path = Path(folder) / NAME
        partial = path.with_name(NAME + ".partial")
        try:
            partial.write_text(json.dumps(fields, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            os.replace(partial, path)
        except OSError as problem:
            with contextlib.suppress(OSError):
                partial.unlink()
            return fields, FileError(f"{path}: writing failed ({problem})")
        return fields, None


def finite(value):
    """Returns the value with None in place of every float that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
