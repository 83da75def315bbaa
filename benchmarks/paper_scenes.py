# SPDX-License-Identifier: Apache-2.0
"""The paper's seven scenes, whole, at the default level or another: a row a scene, figures of each frame, some frames.

    python benchmarks/paper_scenes.py run andy --triangles 5000 --out OUT  # here, small
    python benchmarks/paper_scenes.py pack --out PACKS  # andy, bishop, falling and dryer at their sizes; needs VTK
    python benchmarks/paper_scenes.py run PACKS/andy.npz --backend cuda --seconds 520 --out OUT  # on a GPU, without VTK
    python benchmarks/paper_scenes.py film OUT/andy --scene PACKS/andy.npz --out FILM && cama render FILM

`run` writes OUT/NAME/row.json, frames.csv (steps, times, contacts, impacts, intersections, strain of each frame; the
paper's Figure 17 is made of these) and frames.npz (positions of up to --keep frames, in steps of 2^-13 m, below 16 MB),
and adds a row to OUT/scenes.csv. It stops after --seconds of wall time and says so; what ended a run is in the row.
Intersections are counted in every frame by the exact audit, and in the frames that are kept, or with `--judge all` in
every frame too, by ipctk where it is there.
"""

import argparse
import csv
import datetime
import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np

import cama
import result_page
import scene_pack

SIZES = {  # triangles of the paper
    "funnel": 200_000,
    "sphere": 200_000,
    "twisting": 200_000,
    "andy": 127_000,
    "bishop": 124_000,
    "falling": 172_000,
    "dryer": 98_000,
}
PACKED = ("andy", "bishop", "falling", "dryer")
STEP = 2.0**-13  # m


def load(given, triangles):
    if str(given).endswith(".npz"):
        return scene_pack.read(given)
    return cama.Scene.load(given, triangles)


def referee(simulation):
    """A count of intersections that is not cama's, or None where ipctk is not installed."""
    try:
        from cama.torture.judge import Referee

        return Referee(simulation).count
    except cama.Error:
        return None


class Kept:
    """Some frames, evenly over a run whose length is not known: every other one is dropped when they get too many."""

    def __init__(self, most):
        self.most, self.every, self.frames = max(2, most), 1, []

    def add(self, number, time_, positions):
        if number % self.every:
            return False
        self.frames.append((number, time_, np.round(positions / STEP).astype(np.int32)))
        if len(self.frames) > self.most:
            self.every *= 2
            self.frames = [frame for frame in self.frames if frame[0] % self.every == 0]
        return True

    def write(self, path):
        positions = np.stack([frame[2] for frame in self.frames])
        low = positions.min(axis=(0, 1))
        narrow = (positions.max(axis=(0, 1)) - low < 2**16).all()
        positions = (positions - low).astype(np.uint16 if narrow else np.uint32)
        np.savez_compressed(
            path,
            number=np.array([frame[0] for frame in self.frames]),
            time=np.array([frame[1] for frame in self.frames]),
            low=low,
            differences=np.diff(positions, axis=1, prepend=positions.dtype.type(0)),  # of vertices in turn, modulo 2^n
        )


def kept_positions(file):
    """Positions [frames, vertices, 3], m, of frames.npz."""
    differences = file["differences"]
    return STEP * (np.cumsum(differences, axis=1, dtype=differences.dtype).astype(np.int64) + file["low"])


COLUMNS = [
    "frame",
    "time_s",
    "steps",
    "ms",
    "contacts",
    "impacts",
    "intersections",
    "ipctk",
    "strain_percent",
    "gap_mm",
]


def run_frames(simulation, frames, seconds, kept, judge_all, file):
    """Returns the rows of frames.csv and what ended the run."""
    rows, count, begin, reports = [], referee(simulation), time.perf_counter(), []
    simulation.before_step = lambda s: reports.append(s.report)  # of the step before
    writer = csv.writer(file)
    writer.writerow(COLUMNS)
    kept.add(0, 0.0, simulation.positions)
    for number in range(1, frames + 1):
        if time.perf_counter() - begin > seconds:
            return rows, f"wall time: {seconds:g} s"
        reports.clear()
        before = time.perf_counter()
        try:
            steps = simulation.step_frame()
        except cama.Error as problem:
            return rows, f"{type(problem).__name__}: {problem}"
        ms = 1e3 * (time.perf_counter() - before)
        own, positions = [*reports[1:], simulation.report], simulation.positions
        keeps = kept.add(number, simulation.time, positions)
        judged = count(positions) if count and (keeps or judge_all) else -1
        contacts, impacts = max(r["contacts"] for r in own), sum(r["impacts"] for r in own)
        row = [number, round(simulation.time, 6), steps, round(ms, 2), contacts, impacts]
        row += [simulation.count_intersections(), judged, 100 * simulation.max_strain, 1e3 * simulation.min_gap]
        rows.append(row)
        writer.writerow(row)
        file.flush()
    return rows, "whole"


def summary(simulation, name, level, rows, ended, wall):
    """The row of scenes.csv."""
    column = {key: [row[k] for row in rows] for k, key in enumerate(COLUMNS)}
    steps, ms = sum(column["steps"]), sum(column["ms"])
    precision = {row["name"]: row["value"] for row in simulation.chosen_options}.get("precision", "")
    judged = [n for n in column["ipctk"] if n >= 0]
    return {
        "scene": name,
        "triangles": simulation.cloth_triangle_count,
        "level": level or "production",
        "backend": simulation.backend,
        "device": simulation.device,
        "precision": precision,
        "date": datetime.date.today().isoformat(),
        "commit": result_page.commit(),
        "frames": len(rows),
        "seconds": round(simulation.time, 4),
        "steps": steps,
        "ms_per_step": round(ms / max(steps, 1), 2),
        "ms_per_frame_median": round(statistics.median(column["ms"]), 1) if rows else "",
        "ms_per_frame_longest": max(column["ms"], default=""),
        "s_per_simulated_s": round(1e-3 * ms / simulation.time, 2) if rows else "",
        "contacts_median": statistics.median(column["contacts"]) if rows else "",
        "contacts_most": max(column["contacts"], default=""),
        "impacts_a_frame": round(sum(column["impacts"]) / max(len(rows), 1), 2),
        "intersections": sum(column["intersections"]),
        "ipctk_frames": len(judged),
        "ipctk_intersections": sum(judged) if judged else "",
        "strain_percent": round(max(column["strain_percent"], default=0), 1),
        "peak_mib": round(simulation.peak_memory_bytes / 2**20, 1),
        "wall_s": round(wall, 1),
        "ended": ended,
    }


def run(given):
    scene = load(given.scene, given.triangles or SIZES.get(given.scene, 0))
    frames, out = given.frames or scene.frames, Path(given.out) / scene.name
    out.mkdir(parents=True, exist_ok=True)
    options = {"time_step": given.time_step} if given.time_step else {}
    simulation = cama.Simulation(scene, backend=given.backend, accuracy=given.level, **options)
    print(f"{scene.name}: {simulation.cloth_triangle_count:,} triangles on {simulation.device}", flush=True)
    kept, begin = Kept(given.keep), time.perf_counter()
    with open(out / "frames.csv", "w", newline="", encoding="utf-8") as file:
        rows, ended = run_frames(simulation, frames, given.seconds, kept, given.judge == "all", file)
    row = summary(simulation, scene.name, given.level, rows, ended, time.perf_counter() - begin)
    kept.write(out / "frames.npz")
    (out / "row.json").write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
    table = Path(given.out) / "scenes.csv"
    new = not table.exists()
    with open(table, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, row)
        if new:
            writer.writeheader()
        writer.writerow(row)
    print(json.dumps(row, indent=1))
    return int(bool(row["intersections"]) or (ended != "whole" and not ended.startswith("wall time")))


def pack(given):
    out = Path(given.out)
    out.mkdir(parents=True, exist_ok=True)
    for name in given.scenes or PACKED:
        path = out / f"{name}.npz"
        scene_pack.write(cama.Scene.load(name, given.triangles or SIZES[name]), path)
        scene = scene_pack.read(path)
        print(
            f"{path}: {scene.triangle_count:,} triangles, {path.stat().st_size / 2**20:.1f} MiB, intersections at the "
            f"start: {len(scene.intersections())}",
            flush=True,
        )
    return 0


def film(given):
    """Writes kept frames as a recording that `cama render` draws."""
    from cama.cli.loop import attributes
    from cama.io.recording import Recorder

    scene = load(given.scene, given.triangles)
    simulation = cama.Simulation(scene, backend="cpu")
    Path(given.out).mkdir(parents=True, exist_ok=True)
    with np.load(Path(given.folder) / "frames.npz") as file:
        numbers, times, positions = file["number"], file["time"], kept_positions(file)
    with open(Path(given.folder) / "frames.csv", newline="", encoding="utf-8") as file:
        rows = {int(row["frame"]): row for row in csv.DictReader(file)}
    with Recorder(Path(given.out) / "frames.h5", simulation, attributes(simulation), np.float32) as recorder:
        for number, at, places in zip(numbers, times, positions):
            row = rows.get(int(number), {"contacts": 0, "intersections": 0})
            recorder.add(at, places, int(row["contacts"]), int(row["intersections"]))
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("run", help="compute a scene")
    one.add_argument("scene", help=f"a scene, of the paper's {', '.join(SIZES)}, or a file of pack")
    one.add_argument("--triangles", type=int, default=0, help="0: the paper's")
    one.add_argument("--backend", default="auto")
    one.add_argument("--level", default=None, help="accuracy level; the default is production")
    one.add_argument("--time-step", type=float, default=0, help="s, in place of the level's")
    one.add_argument("--frames", type=int, default=0, help="0: all of the scene")
    one.add_argument("--seconds", type=float, default=1e9, help="wall time after which no frame begins")
    one.add_argument("--keep", type=int, default=16, help="frames to keep at most")
    one.add_argument("--judge", choices=["kept", "all"], default="kept", help="frames that ipctk judges")
    one.add_argument("--out", required=True)
    several = commands.add_parser("pack", help="write scenes that need no VTK to be read")
    several.add_argument("scenes", nargs="*", help=f"default: {' '.join(PACKED)}")
    several.add_argument("--triangles", type=int, default=0, help="0: the paper's")
    several.add_argument("--out", required=True)
    drawn = commands.add_parser("film", help="make a recording of the frames kept by run")
    drawn.add_argument("folder", help="OUT/NAME of run")
    drawn.add_argument("--scene", required=True, help="as given to run")
    drawn.add_argument("--triangles", type=int, default=0)
    drawn.add_argument("--out", required=True)
    given = parser.parse_args()
    return {"run": run, "pack": pack, "film": film}[given.command](given)


if __name__ == "__main__":
    sys.exit(main())
