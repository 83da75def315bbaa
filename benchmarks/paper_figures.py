# SPDX-License-Identifier: Apache-2.0
"""The figures of the paper's evaluation in one command for each backend: tables and CSV files in a folder.

    python benchmarks/paper_figures.py OUT --backend cpu                  # small, minutes on a laptop
    python benchmarks/paper_figures.py OUT --backend cuda --size paper    # the paper's sizes, on a GPU
    python benchmarks/paper_figures.py OUT --parts ladder memory          # some of them

worth    Figures 6 and 18, assembly and "simple GPU", error threshold: what each part of the method is worth
threads  Figure 14: a step of sphere on every backend that is here, and on 1, 2, 4, ... threads; with --threads on as
         many alone, beside CUDA where it is here
ladder   Figures 15 and 16: a step of sphere with 16K, 64K, 256K and 1M triangles, at the levels paper and production
frames   Figure 17: contacts and impacts in every step of sphere, at the level paper, and with anticipated contacts
memory   section 5.3: bytes on the device, and those of the fronts

Steps are 1/200 s. Figure 13 is benchmarks/paper_scenes.py. On a GPU `worth` needs benchmarks/step_times, which waits
for the device after every stage; Python cannot. What does not fit into --budget seconds is left out and said so.
"""

import argparse
import csv
import datetime
import os
import statistics
import sys
import time
from pathlib import Path

import cama
import paper_tables
import result_page
import times

SIZES = {  # triangles of a scene, of the ladder, steps from rest that are not measured, measured steps
    "small": (3000, (1000, 4000, 16000), 60, 10),
    "paper": (200_000, (16_000, 64_000, 256_000, 1_000_000), 60, 20),
}
STEP = 1 / 200  # s
PUBLISHED = {  # ms a step, Figure 16 and Figure 13 of the paper, Tesla K40c
    "ladder": {16_000: 270, 64_000: 1220, 256_000: 5300, 1_000_000: 35570},
    "sphere": 2840,
}
SIMPLE = {"paper.assembly": "sorted", "paper.localized_search": "false"}  # the paper's "simple GPU", section 6


def options_of(changed):
    """The arguments of a Simulation from options as step_times takes them."""
    words = {"true": True, "false": False}
    options, inner = {}, {}
    for name, value in changed.items():
        value = words.get(value, float(value) if value[0].isdigit() else value)
        if name.startswith("paper."):
            inner[name[6:]] = value
        else:
            options[name] = value
    return {**options, **({"paper": inner} if inner else {})}


class Clock:
    def __init__(self, seconds):
        self.end = time.monotonic() + seconds

    def left(self):
        return self.end - time.monotonic()


def measured(scene, triangles, skip, steps, clock, level="paper", backend="cpu", threads=0, start=None, **changed):
    """Medians over steps as a row, or None where the time does not suffice; a shorter measurement says its steps.

    start: a checkpoint after `skip` steps, which is read, or written where there is none."""
    if clock.left() < 10:
        return None
    loaded = cama.Scene.load(scene, triangles)
    simulation = cama.Simulation(
        loaded, accuracy=level, time_step=STEP, backend=backend, threads=threads, **options_of(changed)
    )
    limit = time.monotonic() + 0.4 * clock.left()
    done = 0
    if start and start.exists():
        simulation.load_checkpoint(start)
        done = skip
    while done < skip and time.monotonic() < limit:
        simulation.step()
        done += 1
    if start and done == skip and not start.exists():
        simulation.save_checkpoint(start)
    taken, reports, stages = [], [], []
    while len(taken) < steps and clock.left() > 2:
        before = time.perf_counter()
        simulation.step()
        taken.append(1e3 * (time.perf_counter() - before))
        reports.append(simulation.report)
        stages.append(simulation.timings)
    row = {
        "scene": scene,
        "triangles": simulation.cloth_triangle_count,
        "level": level,
        "backend": simulation.backend,
        "device": simulation.device,
        "options": " ".join(f"{name}={value}" for name, value in changed.items()),
        "skipped": done,
        "steps": len(taken),
        "median_ms": statistics.median(taken),
        "iterations": statistics.median(r["iterations"] for r in reports),
        "contacts": statistics.median(r["contacts"] for r in reports),
        "intersections": simulation.count_intersections(),
        "peak_mib": simulation.peak_memory_bytes / 2**20,
        "front_mib": sum(s["bytes"] for s in simulation.streams if "front" in s["name"]) / 2**20,
    }
    return row, {name: statistics.median(s[name] for s in stages) for name in stages[0]}


def as_run(row, stages):
    """The same as benchmarks/times.py has it."""
    parts = [{**row, "stage": name, "median_ms": value} for name, value in stages.items()]
    return times.Run([{**row, "stage": "step", "precision": ""}, *parts])


def part_worth(given, clock, out):
    triangles, _, skip, steps = SIZES[given.size]
    variants = {**paper_tables.VARIANTS, "simple": SIMPLE}
    runs = {scene: {} for scene in paper_tables.SCENES}
    if given.backend != "cpu":
        given_tables = argparse.Namespace(
            build=given.build, scenes=paper_tables.SCENES, budget=max(10, clock.left()), backend=given.backend,
            precision="double", threads=given.threads, device=0, resolution=triangles, skip=skip, steps=steps,
        )  # fmt: skip
        paper_tables.VARIANTS["simple"] = SIMPLE
        with open(out / "worth.csv", "w", encoding="utf-8") as file:
            runs = paper_tables.run_all(given_tables, file)
    else:
        rows = []
        for variant, changed in variants.items():
            for scene in runs:
                found = measured(scene, triangles, skip, steps, clock, threads=given.threads, **changed)
                if found:
                    rows.append(found[0])
                    runs[scene][variant] = as_run(*found)
        write_csv(out / "worth.csv", rows)
    tables = paper_tables.tables(runs) if any("paper" in found for found in runs.values()) else []
    simple = [
        [s, times.short(r["simple"]["median_ms"] / r["paper"]["median_ms"])]
        for s, r in runs.items()
        if {"simple", "paper"} <= set(r)
    ]
    return [*tables, ('A step of "simple GPU" over ours (the paper: 10.2 to 15.4)', ["scene", "ratio"], simple)]


def part_threads(given, clock, out):
    triangles, _, skip, steps = SIZES[given.size]
    rows = []
    here = [row["name"] for row in cama.backends() if row["available"]]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    counts = [n for n in (1, 2, 4, 8, 16, 32, 64, 128) if n <= cores]
    tried = [(name, 0) for name in ("cuda", "opencl") if name in here] + [("cpu", n) for n in reversed(counts)]
    if given.threads:  # the GPU alone makes the state that they begin at
        tried = [(name, 0) for name in ("cuda",) if name in here] + [("cpu", given.threads)]
    few = steps if given.size == "small" else 3  # one thread takes a minute for a step of the paper's size
    start = out / "threads.h5"  # the same steps on every device, after those of the first
    start.unlink(missing_ok=True)  # of a run that was stopped
    for backend, threads in tried:
        found = measured("sphere", triangles, skip, few, clock, backend=backend, threads=threads, start=start)
        if found:
            rows.append({"threads": threads or "", **found[0]})
            write_csv(out / "threads.csv", rows)
    start.unlink(missing_ok=True)
    columns = ["backend", "device", "threads", "triangles", "ms per step", "iterations"]
    keys = ["backend", "device", "threads", "triangles", "median_ms", "iterations"]
    table = [[show(row[key]) for key in keys] for row in rows]
    return [("Figure 14: a step of sphere by device and threads", columns, table)]


def part_ladder(given, clock, out):
    _, ladder, skip, steps = SIZES[given.size]
    rows = []
    for level in ("production", "paper"):
        for triangles in ladder:
            found = measured(
                "sphere", triangles, skip, steps, clock, level=level, backend=given.backend, threads=given.threads
            )
            if found:
                rows.append({"published_ms": PUBLISHED["ladder"].get(triangles, ""), **found[0]})
            else:
                print(f"ladder: {level}, {triangles:,} triangles: not run, the time is spent", file=sys.stderr)
    write_csv(out / "ladder.csv", rows)
    columns = [
        "level",
        "triangles",
        "ms per step",
        "paper, K40c, ms",
        "iterations",
        "intersections",
        "peak MiB",
        "steps",
    ]
    keys = ["level", "triangles", "median_ms", "published_ms", "iterations", "intersections", "peak_mib"]
    table = [[show(row[key]) for key in keys] + [f"{row['steps']} after {row['skipped']}"] for row in rows]
    growth = [
        [level, times.short(times.exponent([(r["triangles"], r["median_ms"]) for r in rows if r["level"] == level]))]
        for level in ("production", "paper")
    ]
    growth.append(["paper, K40c", times.short(times.exponent(list(PUBLISHED["ladder"].items())))])
    return [
        ("Figures 15 and 16: a step of sphere by resolution", columns, table),
        ("Exponent of the time in the triangles", ["level", "exponent"], growth),
    ]


def part_frames(given, clock, out):
    triangles, *_ = SIZES[given.size]
    tables, rows = [], []
    for name, changed in (("paper", {}), ("contacts anticipated", {"paper.anticipate_contacts": "true"})):
        scene = cama.Scene.load("sphere", triangles)
        simulation = cama.Simulation(
            scene, accuracy="paper", time_step=STEP, backend=given.backend, threads=given.threads, **options_of(changed)
        )
        own, end, total = (
            [],
            time.monotonic() + 0.48 * clock.left(),
            round(scene.frames * scene.seconds_per_frame / STEP),
        )
        while len(own) < total and time.monotonic() < end:
            simulation.step()
            report = simulation.report
            own.append([name, len(own) + 1, report["contacts"], report["impacts"], report["impact_passes"]])
        rows += own
        touching = [row for row in own if row[2]]
        tables.append(
            [name, simulation.cloth_triangle_count, f"{len(own)} of {total}"]
            + [times.short(statistics.mean(row[2] for row in touching or [[0] * 5])), max(row[2] for row in own)]
            + [times.short(statistics.mean(row[3] for row in own)), max(row[3] for row in own)]
            + [sum(row[3] > 0 for row in own), simulation.count_intersections()]
        )
    with open(out / "frames.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["variant", "step", "contacts", "impacts", "passes"], *rows])
    columns = ["variant", "triangles", "steps", "contacts a step in contact", "most", "impacts a step", "most"]
    columns += ["steps with impacts", "intersections at the end"]
    return [
        ("Figure 17: proximities and penetrations in sphere (the paper: below 1 penetration a step)", columns, tables)
    ]


def part_memory(given, clock, out):
    triangles, *_ = SIZES[given.size]
    rows = []
    for scene in paper_tables.SCENES:
        for search in ("fronts", "tree"):
            changed = {"paper.search": search}
            found = measured(scene, triangles, 40, 2, clock, backend=given.backend, threads=given.threads, **changed)
            if found:
                rows.append({"search": search, **found[0]})
    write_csv(out / "memory.csv", rows)
    columns = ["scene", "triangles", "search", "peak MiB", "of which fronts, MiB", "bytes a triangle"]
    table = [
        [r["scene"], show(r["triangles"]), r["search"], show(r["peak_mib"]), show(r["front_mib"])]
        + [show(r["peak_mib"] * 2**20 / r["triangles"])]
        for r in rows
    ]
    return [("Memory (the paper: 300 to 400 MB, and 1.5 GB of fronts in Funnel)", columns, table)]


def show(value):
    """A number of a table."""
    if isinstance(value, int):
        return f"{value:,}"
    return times.short(value) if isinstance(value, float) else value


def write_csv(path, rows):
    with open(path, "w", newline="", encoding="utf-8") as file:
        if rows:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)


PARTS = {
    "worth": part_worth,
    "threads": part_threads,
    "ladder": part_ladder,
    "frames": part_frames,
    "memory": part_memory,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--backend", default="cpu")
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--threads", type=int, default=0, help="of the backend cpu; 0: all")
    parser.add_argument("--budget", type=float, default=3600, help="seconds for each part")
    parser.add_argument("--build", help="build folder with benchmarks/step_times, for `worth` on a GPU")
    given = parser.parse_args()
    out = Path(given.out)
    out.mkdir(parents=True, exist_ok=True)
    device = cama.Simulation(cama.Scene.load("sphere", 200), backend=given.backend).device
    date = datetime.date.today().isoformat()
    text = f"# Figures of the paper\n\n{date}, commit {result_page.commit()}, {given.backend} on {device}.\n\n"
    text += f"    python benchmarks/paper_figures.py OUT {' '.join(sys.argv[2:])}\n"
    for name in given.parts:
        for title, columns, rows in PARTS[name](given, Clock(given.budget), out):
            text += f"\n## {title}\n\n{times.markdown(columns, rows)}\n"
        (out / "figures.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
