# SPDX-License-Identifier: Apache-2.0
"""Tables of `cama tradeoff` written into a dated page in results/, with the data beside it. Standard library only.

    cama tradeoff drape sphere flag funnel twisting --backend cpu --backend opencl --resolution 400 --threads 1 \\
        -o out/tradeoff
    python benchmarks/accuracy_page.py out/tradeoff                        # results/accuracy-fronts-DATE.md, .csv

    cama tradeoff drape sphere flag funnel twisting --resolution 400 --threads 1 -o out/levels \\
        $(printf -- '--also accuracy=%s ' preview interactive production accurate paper)
    python benchmarks/accuracy_page.py out/levels --section levels         # results/accuracy-levels-DATE.md

    the same with --backend cuda, on a machine that has it, and --section levels-cuda

Text between <!-- section fronts --> and <!-- end fronts --> (or levels, levels-cuda) is made here; nothing there is
written by hand. benchmarks/plot_results.py draws the plots from the CSV files.
"""

import argparse
import csv
import json
import shutil
from fractions import Fraction
from pathlib import Path

import result_page
import times

#: Page and title of each section.
PAGES = {
    "fronts": ("accuracy-fronts", "Accuracy against time: fronts"),
    "levels": ("accuracy-levels", "Accuracy levels: error and time"),
    "levels-cuda": ("accuracy-levels", "Accuracy levels: error and time"),
}
PICTURES = "../docs/images/generated"


def step(seconds):
    return str(Fraction(seconds).limit_denominator(100000))


def number(value, digits=3):
    return "" if value is None else times.short(float(value), digits)


def plain(settings):
    """Whether a point is of the grid of time steps, tolerances and precisions alone."""
    return {"tolerance", "time_step"} <= set(settings) <= {"accuracy", "precision", "time_step", "tolerance"}


def grid_table(scene):
    """Error in percent of an edge and time, time step by tolerance, of the first backend in mixed precision."""
    backend = next(iter(scene["fronts"]))
    found = {}
    for p in scene["points"]:
        s = p["settings"]
        if p["backend"] == backend and s.get("precision", "mixed") == "mixed" and plain(s) and not p["failed"]:
            found[s["time_step"], s["tolerance"]] = p
    steps, tolerances = sorted({k[0] for k in found}, reverse=True), sorted({k[1] for k in found}, reverse=True)
    if not found:
        return ""

    def cell(p):
        return (
            ""
            if p is None
            else f"{100 * p['restart_rms_edges']:.2f} % / {number(p['ms_per_second'])} ms / "
            f"{p['iterations'] / p['dt']:,.0f}"
        )

    rows = [[step(t), *(cell(found.get((t, tolerance))) for tolerance in tolerances)] for t in steps]
    return times.markdown(["time step, s", *(f"tolerance {t:g}" for t in tolerances)], rows)


def precision_table(scene):
    """The same time step and tolerance in every precision, first backend."""
    backend, groups = next(iter(scene["fronts"])), {}
    for p in scene["points"]:
        s = p["settings"]
        if p["backend"] == backend and "precision" in s and plain(s) and not p["failed"]:
            groups.setdefault((s["time_step"], s["tolerance"]), {})[s["precision"]] = p
    rows = [
        [
            step(t),
            f"{tolerance:g}",
            *(f"{100 * g[k]['restart_rms_edges']:.3f} %" for k in ("double", "mixed", "single")),
        ]
        for (t, tolerance), g in sorted(groups.items(), reverse=True)
        if len(g) == 3
    ]
    return times.markdown(["time step, s", "tolerance", "double", "mixed", "single"], rows) if rows else ""


def front_table(scene):
    """The front of every backend, and the levels and the paper's settings beside it."""
    rows = []
    for backend, front in scene["fronts"].items():
        for i, p in enumerate(scene["points"]):
            level = set(p["settings"]) == {"accuracy"}
            if p["backend"] != backend or (i not in front and not level):
                continue
            where = "front" if i in front else ("" if not p.get("intersections") else "intersects")
            if p["failed"]:
                where = "failed: " + p["failed"].replace("|", "/")[:80]
            rows.append(
                (
                    backend,
                    p.get("ms_per_second") or float("inf"),
                    [
                        backend,
                        p["label"],
                        number(p.get("ms_per_second")),
                        "" if p.get("restart_rms_edges") is None else f"{100 * p['restart_rms_edges']:.2f} %",
                        number(p.get("surface_mean_edges")),
                        number(p.get("energy_error")),
                        number(p.get("strain_max")),
                        number(p.get("intersections")),
                        number(p.get("lost_motion")),
                        where,
                    ],
                )
            )
    return times.markdown(
        [
            "backend",
            "settings",
            "ms per simulated s",
            "error, of an edge",
            "surface, edges",
            "energy",
            "largest strain",
            "intersections",
            "motion cut",
            "",
        ],
        [row for _, _, row in sorted(rows, key=lambda r: (r[0], r[1]))],
    )


def section(scenes, page):
    """Text of the section, for the page of this name without ending."""
    parts = []
    for scene in scenes:
        devices = "; ".join(f"{b}: {d}" for b, d in scene["devices"].items())
        threads = (
            f"{scene['threads']} thread{'s' if scene['threads'] > 1 else ''}" if scene["threads"] else "all threads"
        )
        parts.append(
            f"### {scene['scene']}, {scene['triangles']:,} triangles\n\n"
            f"{devices}; {threads} on the CPU. Reference: steps of {step(scene['reference_step'])} s, off itself by "
            f"{100 * scene['uncertainty_edges']:.2g} % of an edge (rms); cama {scene['version'].split('+')[0]}; "
            f"an edge is {1e3 * scene['edge']:.3g} mm; {scene['windows']} windows of {scene['window']:g} s from "
            f"{scene['first'] * scene['window']:g} s.\n\n"
            f"![{scene['scene']}]({PICTURES}/{page}-{scene['scene']}.svg)\n\n{front_table(scene)}\n"
        )
        if grid_table(scene):
            parts.append(
                "Error / ms per simulated second / solver iterations per simulated second, mixed precision:\n\n"
                f"{grid_table(scene)}\n"
            )
        if precision_table(scene):
            parts.append(f"Error by precision:\n\n{precision_table(scene)}\n")
    return "\n".join(parts)


def levels(scenes):
    """Text of the section on levels: error and time of each in every scene."""
    names = list(
        dict.fromkeys(
            p["settings"]["accuracy"] for s in scenes for p in s["points"] if set(p["settings"]) == {"accuracy"}
        )
    )
    rows = []
    for scene in scenes:
        found = {p["settings"]["accuracy"]: p for p in scene["points"] if set(p["settings"]) == {"accuracy"}}
        row = [f"{scene['scene']}, {scene['triangles']:,}", f"{100 * scene['uncertainty_edges']:.2g} %"]
        for name in names:
            p = found.get(name)
            if p is None or p["failed"]:
                row.append("" if p is None else "failed")
            else:
                left = f", {p['intersections']} intersections" if p["intersections"] else ""
                row.append(f"{100 * p['restart_rms_edges']:.2g} %, {number(p['ms_per_second'])} ms{left}")
        rows.append(row)
    return times.markdown(["scene, triangles", "reference", *names], rows) + "\n"


def write_references(scenes, path):
    """What the plots need besides the points: the reference's own uncertainty and strain."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["scene", "triangles", "reference_step", "uncertainty_edges", "edge_mm", "windows", "window_s",
                         "first_window_s", "reference_strain_max"])  # fmt: skip
        for s in scenes:
            strain = s.get("strain_max")
            writer.writerow([s["scene"], s["triangles"], step(s["reference_step"]), f"{s['uncertainty_edges']:.2g}",
                             f"{1e3 * s['edge']:.3g}", s["windows"], f"{s['window']:g}",
                             f"{s['first'] * s['window']:g}", "" if strain is None else f"{strain:.4g}"])  # fmt: skip


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=Path, help="what `cama tradeoff -o` wrote")
    p.add_argument("--section", choices=PAGES, default="fronts")
    p.add_argument("--page", type=Path, help="default: today's in results/")
    arguments = p.parse_args()
    scenes = json.loads((arguments.folder / "tradeoff.json").read_text(encoding="utf-8"))["scenes"]
    name, title = PAGES[arguments.section]
    page = arguments.page or result_page.path_of(name)
    made = section(scenes, page.stem) if arguments.section == "fronts" else levels(scenes)
    command = f"python benchmarks/accuracy_page.py {arguments.folder} --section {arguments.section}"
    result_page.write_section(page, arguments.section, made, title, command)
    if arguments.section == "fronts":
        shutil.copyfile(arguments.folder / "tradeoff.csv", page.with_suffix(".csv"))
        write_references(scenes, page.with_name(f"{page.stem}-references.csv"))
    print(f"{page}: {len(scenes)} scenes")


if __name__ == "__main__":
    main()
