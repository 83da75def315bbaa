# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pages in results/, drawn from the CSV files beside them; needs matplotlib.

    python benchmarks/plot_results.py                      # into docs/images/generated, which git ignores
    python benchmarks/plot_results.py --out FOLDER

The build of the documentation calls it (docs/results_pages.py). Which pictures a CSV file gives follows from its name:

| file in results/ | pictures |
|---|---|
| accuracy-fronts-DATE.csv, with -references.csv | accuracy-fronts-DATE-SCENE.svg: measures against time, with fronts |
| performance-NAME-DATE.csv; -bars- and -scaling- together | performance-NAME-DATE-stages.png, -scaling.png |
| paper-measurements-NAME-DATE.csv | paper-measurements-NAME-DATE.png: shares of a step |
"""

import argparse
import csv
import math
import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

import paper_tables  # noqa: E402
import plot_times  # noqa: E402
import times  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PICTURES = ROOT / "results", ROOT / "docs" / "images" / "generated"
COLORS = {"cpu": "#4c78a8", "opencl": "#e45756", "cuda": "#54a24b"}
MARKERS = {"mixed": "o", "double": "s", "single": "^"}
#: Measures that are drawn against time: column, title, logarithmic.
PANELS = (
    ("restart_rms_edges", "position error after a window, rms, edge lengths", True),
    ("surface_mean_edges", "mean surface distance at the end, edge lengths", True),
    ("energy_error", "energy error after a window, of the kinetic", True),
    ("strain_max", "largest principal strain", False),
    ("lost_motion", "motion cut by the commit, mean part", False),
)


def read(path):
    """Rows of a CSV file as dicts."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def number(text):
    """A cell, nan where it is empty."""
    return float(text) if text else math.nan


def precision_of(row):
    """What a point was computed in."""
    return row.get("precision") or ("double" if row["accuracy"] == "paper" else "mixed")


def pareto(points):
    """Those of [(time, error)] that no other beats in both, fastest first."""
    front = []
    for x, y in sorted(points):
        if not front or y < front[-1][1]:
            front.append((x, y))
    return front


def panel(axes, rows, measure, title, logarithmic):
    """One measure of every point against time, and the front of each backend."""
    points = [(number(r["ms_per_second"]), number(r[measure]), r) for r in rows]
    points = [p for p in points if not math.isnan(p[0] + p[1]) and (p[1] > 0 or not logarithmic)]
    axes.set(xscale="log", yscale="log" if logarithmic else "linear", xlabel="ms per simulated second")
    for x, y, row in points:
        paper, clean = row["accuracy"] == "paper", number(row["intersections"] or "0") == 0
        color = COLORS.get(row["backend"], "#777777")
        marker, size = ("*", 12) if paper else (MARKERS[precision_of(row)], 5)
        axes.plot(x, y, marker, ms=size, mfc=color if clean else "white", mec=color, mew=1.2, alpha=0.8)
    for backend in dict.fromkeys(r["backend"] for r in rows):
        front = pareto(
            (x, y) for x, y, r in points if r["backend"] == backend and number(r["intersections"] or "0") == 0
        )
        if measure != "strain_max" and front:  # a strain is no error
            axes.step([x for x, _ in front], [y for _, y in front], where="post", lw=1, color=COLORS[backend])
    axes.set_title(title, fontsize=8.5)
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)


def plot_fronts(path, folder):
    """One picture a scene."""
    rows, made = read(path), []
    facts = {r["scene"]: r for r in read(path.with_name(f"{path.stem}-references.csv"))}
    for scene in dict.fromkeys(r["scene"] for r in rows):
        own, fact = [r for r in rows if r["scene"] == scene], facts[scene]
        figure, grid = plt.subplots(2, 3, figsize=(12.5, 7.9), layout="constrained")
        axes = grid.ravel()
        for a, (measure, title, logarithmic) in zip(axes, PANELS):
            panel(a, own, measure, title, logarithmic)
        floor = number(fact["uncertainty_edges"])
        if floor > axes[0].get_ylim()[0] / 3:
            axes[0].axhspan(min(axes[0].get_ylim()[0], floor / 1.5), floor, color="#999999", alpha=0.25, lw=0)
        if not math.isnan(number(fact["reference_strain_max"])):
            axes[3].axhline(number(fact["reference_strain_max"]), color="#555555", ls="--", lw=0.8)
        legend(axes[5], own)
        figure.suptitle(
            f"{scene}, {int(fact['triangles']):,} triangles: speed for accuracy\nReference: steps of "
            f"{fact['reference_step']} s, off itself by about {floor:.2g} edge lengths (rms, grey); an edge is "
            f"{fact['edge_mm']} mm. {len(own)} points.",
            fontsize=9,
        )
        made.append(folder / f"{path.stem}-{scene}.svg")
        figure.savefig(made[-1], metadata={"Date": None})
        plt.close(figure)
    return made


def legend(axes, rows):
    """What colours and markers mean."""
    line = plt.Line2D
    handles = [
        line([], [], color=COLORS[b], marker="o", label=f"{b} and its front") for b in {r["backend"]: 0 for r in rows}
    ]
    handles += [line([], [], ls="", marker=m, color="#777777", label=f"precision {p}") for p, m in MARKERS.items()]
    handles.append(line([], [], ls="", marker="*", ms=12, color="#777777", label="the options of the paper"))
    handles.append(line([], [], ls="", marker="o", mfc="white", color="#777777", label="hollow: left intersections"))
    handles.append(line([], [], ls="--", color="#555555", label="strain of the reference"))
    axes.legend(handles=handles, loc="center", frameon=False)
    axes.axis("off")


def plot_performance(paths, stem, folder):
    """Stages and scaling of all files together."""
    runs = times.read([str(p) for p in paths])
    made = [folder / f"{stem}-stages.png"]
    plot_times.plot_stages(runs, made[0])
    if plot_times.plot_scaling(runs, folder / f"{stem}-scaling.png"):
        made.append(folder / f"{stem}-scaling.png")
    return made


def plot_paper(path, folder):
    """Shares of a step: from every run, or from shares that were kept alone."""
    made = folder / f"{path.stem}.png"
    rows = read(path)
    if "PC" in rows[0]:
        parts = {r["scene"]: {box: number(r[box]) for box in ("PC", "MA", "LS", "PH", "Misc")} for r in rows}
    else:
        runs = paper_tables.read_runs(str(path))
        parts = {s: paper_tables.shares(r["paper"]) for s, r in runs.items() if "paper" in r}
    paper_tables.plot_shares(parts, made)
    return [made]


def plot_all(results=RESULTS, folder=PICTURES):
    """Draws every picture; paths of what was drawn."""
    folder.mkdir(parents=True, exist_ok=True)
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "cama", "font.size": 8})
    made, performance = [], {}
    for path in sorted(results.glob("*.csv")):
        if path.stem.startswith("accuracy-fronts-") and not path.stem.endswith("-references"):
            made += plot_fronts(path, folder)
        elif path.stem.startswith("performance-"):
            performance.setdefault(re.sub(r"-(bars|scaling)-", "-", path.stem), []).append(path)
        elif path.stem.startswith("paper-measurements-"):
            made += plot_paper(path, folder)
    for stem, paths in performance.items():
        made += plot_performance(paths, stem, folder)
    return made


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--results", type=Path, default=RESULTS)
    p.add_argument("--out", type=Path, default=PICTURES)
    arguments = p.parse_args()
    for path in plot_all(arguments.results, arguments.out):
        print(path)


if __name__ == "__main__":
    main()
