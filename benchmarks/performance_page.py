# SPDX-License-Identifier: Apache-2.0
"""Tables of step_times' CSV as text, or written into a dated page in results/. Standard library only.

    python benchmarks/performance_page.py bars OUT/bars.csv                 # a table beside the published figures
    python benchmarks/performance_page.py scaling OUT/scaling.csv
    python benchmarks/performance_page.py stages OUT/bars.csv
    python benchmarks/performance_page.py all OUT/bars.csv OUT/scaling.csv --section gpu
    python benchmarks/performance_page.py paper OUT/paper_tables.md --section paper-gpu   # what paper_tables.py wrote

With --section the tables replace that section of today's page in results/, or of --page. Copy the CSV files beside it,
named as the page: benchmarks/plot_results.py draws the plots from them.
"""

import argparse
import collections
import math
import re
import sys

import result_page
import times
from result_page import replace_section  # noqa: F401

#: Page and title of each section.
PAGES = {
    "cpu": ("performance-cpu", "Performance on CPU cores"),
    "gpu": ("performance-cuda", "Performance on a GPU"),
    "paper-cpu": ("paper-measurements", "The measurements of the paper, repeated"),
    "paper-gpu": ("paper-measurements", "The measurements of the paper, repeated"),
}

# Seconds a step of 200,000 triangles, Tesla K40c (Tang et al. 2016, Figure 13; sphere is its "Moving").
PAPER = {"funnel": 1.68, "sphere": 2.84, "twisting": 2.92}


def published(run):
    """What others report for this scene at this size; empty without."""
    if run["scene"] in PAPER and 150000 < run["triangles"] < 250000:
        return f"{1000 * PAPER[run['scene']]:,.0f} (CAMA, K40c)"
    if run["scene"] == "pile" and run["triangles"] > 400000:
        return "6.3 (OGC, RTX 4090, 50 layers)"
    return ""


def bars(runs):
    columns = [
        "scene",
        "triangles",
        "settings",
        "ms per step, median",
        "95 %",
        "published ms",
        "floor ms",
        "iterations",
        "launches",
        "waits",
        "contacts",
        "intersections",
        "peak MiB",
        "steps",
    ]
    rows = [
        [
            r["scene"],
            f"{r['triangles']:,}",
            settings(r),
            times.short(r["median_ms"]),
            times.short(r["p95_ms"]),
            published(r),
            times.short(r["floor_ms"]),
            times.short(r["iterations"]),
            times.short(r["launches"]),
            times.short(r["waits"]),
            times.short(r["contacts"]),
            times.short(r["intersections"]),
            times.short(r["peak_mib"]),
            f"{r['steps']} after {r['skipped']}",
        ]
        for r in runs
    ]
    return times.markdown(columns, rows)


def settings(run):
    """Backend, accuracy, precision, changed options, step."""
    words = [run["backend"], run["accuracy"], run["precision"], f"dt 1/{1 / float(run['time_step']):.0f} s"]
    return ", ".join(words + ([run["options"]] if run["options"] else []))


def scaling(runs):
    """Runs of one scene from the same step on, at several sizes; the exponent is of the fit over all of them."""
    groups = collections.defaultdict(list)
    for r in runs:
        groups[r["scene"], f"{settings(r)}, after {r['skipped']} steps"].append(r)
    rows = []
    for (scene, words), group in groups.items():
        group.sort(key=lambda r: r["triangles"])
        points = [(r["triangles"], r["median_ms"]) for r in group]
        if math.isnan(times.exponent(points)):
            continue
        rows.append(
            [
                scene,
                words,
                " / ".join(f"{x:,}" for x, _ in points),
                " / ".join(times.short(y) for _, y in points),
                f"{times.exponent(points):.2f}",
                times.short(group[-1]["peak_mib"] * 2**20 / group[-1]["triangles"]),
            ]
        )
    return (
        times.markdown(
            ["scene", "settings", "triangles", "ms per step, median", "exponent", "peak bytes per triangle"], rows
        )
        if rows
        else ""
    )


def stages(runs):
    """Median, floor and ratio of the leaf stages, one column a run."""
    names = []
    for r in runs:
        names += [n for n in r.leaves() if n not in names]

    def cell(row):
        if row is None:
            return ""
        ratio = f", {row['ratio']:.1f}x" if row["ratio"] > 0 else ""
        return (
            f"{times.short(row['median_ms'])} ({times.short(row['floor_ms'])}{ratio})"
            if ratio
            else times.short(row["median_ms"])
        )

    rows = [["**step**"] + [cell(r.values) for r in runs]] + [
        [n] + [cell(r.leaves().get(n)) for r in runs] for n in names
    ]
    heads = [f"{r['scene']} {r['triangles']:,}, {r['backend']}, {r['accuracy']}, {r['precision']}" for r in runs]
    return times.markdown(["stage: median ms (floor ms, ratio)"] + heads, rows)


def everything(runs):
    speeds = {}
    for r in runs:
        speeds.setdefault(r["device"], []).append(r["bandwidth_gbs"])
    devices = [
        f"{device} (copy {' to '.join(dict.fromkeys(times.short(f(s)) for f in (min, max)))} GB/s)"
        for device, s in sorted(speeds.items())
    ]
    same = lambda a, b: a["scene"] == b["scene"] and settings(a) == settings(b)  # noqa: E731
    largest = [
        r for r in runs if not r["options"] and not any(same(o, r) and o["triangles"] > r["triangles"] for o in runs)
    ]
    parts = ["; ".join(devices) + ".", bars(runs), scaling(runs), stages(largest)]
    return "\n\n".join(p for p in parts if p)


TABLES = {"bars": bars, "scaling": scaling, "stages": stages, "all": everything}


def paper(paths):
    """What paper_tables.py wrote, headings two levels lower, its title left out."""
    text = ""
    for path in paths:
        with open(path, encoding="utf-8") as file:
            text += file.read()
    return re.sub(r"^## ", "#### ", re.sub(r"^# .*\n+", "", text, flags=re.M), flags=re.M).strip()


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("table", choices=[*TABLES, "paper"])
    p.add_argument("csv", nargs="+")
    p.add_argument("--section", choices=PAGES, help="of the page, to be replaced")
    p.add_argument("--page", help="default: today's in results/")
    arguments = p.parse_args()
    text = paper(arguments.csv) if arguments.table == "paper" else TABLES[arguments.table](times.read(arguments.csv))
    if not arguments.section:
        print(text)
        return
    name, title = PAGES[arguments.section]
    page = arguments.page or result_page.path_of(name)
    command = "python benchmarks/performance_page.py " + " ".join(sys.argv[1:])
    result_page.write_section(page, arguments.section, text, title, command)
    print(page)


if __name__ == "__main__":
    main()
