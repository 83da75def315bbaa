# SPDX-License-Identifier: Apache-2.0
"""Reads the CSV of step_times; runs it. Standard library only."""

import csv
import io
import math
import os
import shutil
import subprocess

KEY = ["scene", "triangles", "accuracy", "backend", "device", "precision", "options", "time_step"]
NUMBERS = [
    "mean_ms",
    "median_ms",
    "stddev_ms",
    "p95_ms",
    "bytes",
    "bandwidth_gbs",
    "floor_ms",
    "ratio",
    "iterations",
    "launches",
    "waits",
    "contacts",
    "candidates",
    "intersections",
    "peak_mib",
]


class Run:
    """One scene at one resolution: `values` of the whole step, `stages` by nested name, the step left out."""

    def __init__(self, rows):
        self.values = dict(rows[0])
        self.stages = {r["stage"]: r for r in rows[1:]}

    def __getitem__(self, name):
        return self.values[name]

    def top(self):
        """Stages that are not part of another, in the order of the step."""
        return {name: r for name, r in self.stages.items() if "/" not in name}

    def leaves(self):
        """Stages without parts."""
        return {
            name: r for name, r in self.stages.items() if not any(other.startswith(name + "/") for other in self.stages)
        }


def _number(text):
    try:
        return float(text)
    except ValueError:
        return math.nan


def parse(text):
    """Runs in the order of the CSV text; header lines in its midst are passed over."""
    runs, rows, columns = [], [], None
    for line in csv.reader(io.StringIO(text)):
        if not line or line[0].startswith("#"):
            continue
        if line[0] == "scene":
            columns = line
            continue
        row = dict(zip(columns, line))
        for name in NUMBERS:
            row[name] = _number(row.get(name) or "")
        row["triangles"] = int(row["triangles"])
        if row["stage"] == "step" and rows:
            runs.append(Run(rows))
            rows = []
        rows.append(row)
    return runs + ([Run(rows)] if rows else [])


def read(paths):
    """Runs of several files."""
    runs = []
    for path in paths:
        with open(path, encoding="utf-8") as file:
            runs += parse(file.read())
    return runs


def find_program(folder=None):
    """Path of step_times: in `folder`, else in the usual build folders of the repository. Throws FileNotFoundError."""
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    places = (
        [folder]
        if folder
        else [os.path.join(root, name) for name in (os.environ.get("CAMA_GPU_BUILD", "build-gpu"), "build")]
    )
    for place in places:
        found = shutil.which(os.path.join(place, "benchmarks", "step_times"))
        if found:
            return found
    raise FileNotFoundError(
        "step_times is not built; configure with -DCAMA_BUILD_BENCHMARKS=ON (looked in " + ", ".join(places) + ")"
    )


def run(program, scene, seconds, **settings):
    """CSV text of one run of step_times and what it said on standard error; text is what was printed before `seconds` ran out."""
    words = [program, scene] + [f"{name}={value}" for name, value in settings.items()]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=seconds, check=False)
        return done.stdout, done.stderr.strip()
    except subprocess.TimeoutExpired as late:
        out = late.stdout or b""
        return out.decode() if isinstance(out, bytes) else out, f"ended after {seconds:.0f} s"


def exponent(points):
    """Slope of the least squares line through (log x, log y) of [(x, y)]; nan for fewer than two different x."""
    if len({x for x, _ in points}) < 2:
        return math.nan
    xs, ys = [math.log(x) for x, _ in points], [math.log(y) for _, y in points]
    mx, my = sum(xs) / len(xs), sum(ys) / len(ys)
    return sum((x - mx) * (y - my) for x, y in zip(xs, ys)) / sum((x - mx) ** 2 for x in xs)


def markdown(columns, rows):
    """A table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join(lines + ["| " + " | ".join(str(v) for v in row) + " |" for row in rows])


def short(value, digits=3):
    """A number in few digits, thousands with commas; empty for nan."""
    if isinstance(value, str):
        return value
    if math.isnan(value):
        return ""
    if abs(value) >= 10**digits:
        return f"{value:,.0f}"
    return f"{value:.{digits}g}"
