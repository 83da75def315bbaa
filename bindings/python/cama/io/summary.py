# SPDX-License-Identifier: Apache-2.0
"""summary.json: what a run did and what it cost."""

import contextlib
import json
import math
import os
import statistics
from pathlib import Path

from ..errors import FileError

NAME = "summary.json"


class Summary:
    """Collects the report of every step and the audit of every frame."""

    def __init__(self, simulation):
        self._simulation = simulation
        self._reports, self._stages = [], {}
        self._intersections, self._gap, self._strain = 0, math.inf, -math.inf
        self._resumed_at = None

    def resume(self, intersections):
        """Call before the first step of a run that continues; intersections: of the frames before it."""
        self._resumed_at, self._intersections = self._simulation.step_count, intersections

    def add_step(self):
        """Call after every step."""
        self._reports.append(self._simulation.report)
        for name, milliseconds in self._simulation.timings.items():
            self._stages[name] = self._stages.get(name, 0.0) + milliseconds

    def add_frame(self, intersections):
        """Call after every recorded frame."""
        self._intersections += intersections
        self._gap = min(self._gap, self._simulation.min_gap)
        self._strain = max(self._strain, self._simulation.max_strain)

    def milliseconds(self):
        """Returns the mean time of a step, ms."""
        return statistics.fmean(self._column("milliseconds")) if self._reports else math.nan

    def _column(self, name):
        return [report[name] for report in self._reports]

    def fields(self):
        """Returns the fields of summary.json; numbers that are not finite are None."""
        s, energy = self._simulation, self._simulation.energy()
        lengths = self._column("time_step")
        times, iterations = self._column("milliseconds"), self._column("iterations")
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
                "steps": s.step_count,
                "resumed_at": self._resumed_at,
                "error": s.error,
                "dt": mean(lengths) if s.error else s.time_step,
                "time_steps": {"min": min(lengths, default=None), "max": max(lengths, default=None)},
                "rejected": sum(self._column("rejected")),
                "ms_per_step": {
                    "mean": mean(times),
                    "median": statistics.median(times) if times else None,
                    "max": max(times, default=None),
                },
                "stages": {name: total / max(1, len(times)) for name, total in self._stages.items()},
                "pcg": {"iterations": {"mean": mean(iterations), "max": max(iterations, default=None)}},
                "contacts": {"max": max(self._column("contacts"), default=0)},
                "impacts": {"max": max(self._column("impacts"), default=0)},
                "intersections": self._intersections,
                "min_gap": self._gap,
                "max_strain": self._strain,
                "energy": dict(energy, total=sum(energy.values())),
                "peak_memory_bytes": s.peak_memory_bytes,
                "truncated": sum(self._column("truncated")),
                "lost_motion": max(self._column("lost_motion"), default=0.0),
                "released": sum(self._column("released")),
                "retries": sum(self._column("retries")),
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


def mean(values):
    """Returns the mean, or None without values."""
    return statistics.fmean(values) if values else None


def finite(value):
    """Returns the value with None in place of every float that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
