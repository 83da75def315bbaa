# SPDX-License-Identifier: Apache-2.0
"""Plots from the CSV of step_times; needs matplotlib.

    python benchmarks/plot_times.py CSV... --out out/times            # out/times-stages.png, out/times-scaling.png
    python benchmarks/plot_times.py CSV... --out FOLDER/name --format svg --scene drape

stages: time of every stage and, beside it, the time that its bytes take at the bandwidth of the device, one panel a
run (the largest of each scene and its options). scaling: step time against triangles, log-log, with the fitted
exponent.
"""

import argparse
import collections
import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

import times  # noqa: E402

MEASURED, FLOOR = "#4c78a8", "#f58518"
COLORS = ["#4c78a8", "#e45756", "#54a24b", "#b279a2", "#f58518", "#72b7b2"]


def setting(run):
    """What distinguishes a run from others of its scene."""
    words = [run["backend"], run["accuracy"], run["precision"]] + ([run["options"]] if run["options"] else [])
    return ", ".join(words)


def largest(runs):
    """Of each scene and setting the run with most triangles."""
    best = {}
    for run in runs:
        key = run["scene"], setting(run)
        if key not in best or run["triangles"] > best[key]["triangles"]:
            best[key] = run
    return list(best.values())


def label(name):
    """Of a stage: the part alone, the outer one only where names repeat."""
    outer, _, inner = name.partition("/")
    return {"matrix assembly/matrix assembly": "matrix", "matrix assembly": "matrix assembly"}.get(name, inner or outer)


def draw_stages(axes, run):
    """Bars of one run, both times on a log axis, the ratio written behind."""
    stages = {name: r for name, r in run.leaves().items() if r["median_ms"] > 0}
    rows = [("whole step", run.values)] + [(label(name), r) for name, r in stages.items()]
    values = [r["median_ms"] for _, r in rows] + [r["floor_ms"] for _, r in rows if r["floor_ms"] > 0]
    low, high = 10 ** math.floor(math.log10(max(min(values), max(values) * 1e-5))), max(values) * 40
    for y, (_, r) in enumerate(rows):
        axes.barh(
            y - 0.19,
            max(r["median_ms"], low),
            height=0.36,
            color=MEASURED,
            label="measured, median" if y == 0 else None,
        )
        if r["floor_ms"] > 0:
            axes.barh(
                y + 0.19,
                max(r["floor_ms"], low),
                height=0.36,
                color=FLOOR,
                label="floor of its bytes" if y == 0 else None,
            )
        ratio = f"  ({r['ratio']:.1f}x)" if r["ratio"] > 0 else ""
        axes.text(r["median_ms"] * 1.08, y - 0.19, f"{times.short(r['median_ms'])} ms{ratio}", va="center", fontsize=8)
    axes.set(
        xscale="log",
        xlim=(low, high),
        xlabel="ms per step",
        yticks=range(len(rows)),
        yticklabels=[name for name, _ in rows],
    )
    axes.set_title(f"{run['scene']}, {run['triangles']:,} triangles\n{setting(run)}", fontsize=9)
    axes.invert_yaxis()
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)


def plot_stages(runs, path):
    runs = largest(runs)
    wide = min(2, len(runs))
    tall = -(-len(runs) // wide)
    figure, grid = plt.subplots(tall, wide, figsize=(5.6 * wide, 3.9 * tall), squeeze=False, constrained_layout=True)
    panels = [axes for row in grid for axes in row]
    for axes, run in zip(panels, runs):
        draw_stages(axes, run)
    for axes in panels[len(runs) :]:
        axes.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def series(runs):
    """{(scene, setting): [(triangles, ms)]}, those with at least two sizes."""
    found = collections.defaultdict(list)
    for run in runs:
        found[run["scene"], f"{setting(run)}, after {run['skipped']} steps"].append(
            (run["triangles"], run["median_ms"])
        )
    return {key: sorted(points) for key, points in found.items() if len({x for x, _ in points}) > 1}


def plot_scaling(runs, path):
    """False where nothing was run at two sizes."""
    lines = series(runs)
    if not lines:
        return False
    figure, axes = plt.subplots(figsize=(6.4, 4.6), constrained_layout=True)
    for i, ((scene, words), points) in enumerate(lines.items()):
        xs, ys = [x for x, _ in points], [y for _, y in points]
        p, color = times.exponent(points), COLORS[i % len(COLORS)]
        middle = math.exp(sum(math.log(y) - p * math.log(x) for x, y in points) / len(points))
        axes.plot(xs, ys, "o", color=color, label=f"{scene}, {words}: exponent {p:.2f}")
        axes.plot([xs[0], xs[-1]], [middle * xs[0] ** p, middle * xs[-1] ** p], color=color, lw=1)
        axes.plot([xs[0], xs[-1]], [ys[0], ys[0] * xs[-1] / xs[0]], color=color, lw=0.8, ls=":")
    axes.plot([], [], color="gray", ls=":", lw=0.8, label="linear from the smallest")
    sizes = sorted({x for points in lines.values() for x, _ in points})
    axes.set(xscale="log", yscale="log", xlabel="cloth triangles", ylabel="ms per step, median")
    axes.set_xticks(sizes, labels=[f"{x / 1000:,.0f}K" for x in sizes])
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.grid(which="both", alpha=0.25)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return True


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("csv", nargs="+")
    p.add_argument("--out", required=True, help="start of the images' names")
    p.add_argument("--format", default="png", choices=["png", "svg"])
    p.add_argument("--scene", action="append", help="of the stages plot; default: every one")
    arguments = p.parse_args()
    runs = times.read(arguments.csv)
    chosen = [r for r in runs if not arguments.scene or r["scene"] in arguments.scene]
    plot_stages(chosen, f"{arguments.out}-stages.{arguments.format}")
    print(f"{arguments.out}-stages.{arguments.format}")
    if plot_scaling(runs, f"{arguments.out}-scaling.{arguments.format}"):
        print(f"{arguments.out}-scaling.{arguments.format}")


if __name__ == "__main__":
    main()
