# SPDX-License-Identifier: Apache-2.0
"""The paper's own measurements, in paper mode: where a step's time goes (its Figure 18) and what each part is worth.

    python benchmarks/paper_tables.py OUT --resolution 2000 --skip 40 --steps 10  # here
    python benchmarks/paper_tables.py OUT --resolution 200000 --backend cuda --budget 540  # on a machine with a GPU
    python benchmarks/paper_tables.py OUT --read OUT/paper.csv  # tables and plot again, nothing is run

Runs benchmarks/step_times; needs nothing beyond Python itself. Writes OUT/paper.csv (every run), OUT/paper_tables.csv,
OUT/paper_tables.md, and where matplotlib is, OUT/paper_stages.png. What the paper reports (Tang et al. 2016, Figures 6,
13, 18 and section 5) stands beside.
"""

import argparse
import csv
import math
import os
import sys
import time

import times

SCENES = ["sphere", "funnel", "twisting"]

# Changed option(s) against the paper's: variant, options.
VARIANTS = {
    "paper": {},
    "no preconditioner": {"preconditioner": "none"},
    "sorted assembly": {"paper.assembly": "sorted"},
    "atomic filling": {"paper.atomic_filling": "true"},
    "search not localized": {"paper.localized_search": "false"},
    "tolerance 1e-11": {"tolerance": "1e-11"},
}
# How tables of before name them.
OLD_NAMES = {
    "assembly=sorted": "sorted assembly",
    "atomic_filling=1": "atomic filling",
    "localized_search=0": "search not localized",
}

BOXES = {
    "PC": ["proximity checking"],
    "MA": ["matrix assembly"],
    "LS": ["linear solve"],
    "PH": ["penetration handling"],
}

CLAIMS = [
    ("Jacobi instead of no preconditioner: fewer iterations", "32 %"),
    ("Jacobi instead of no preconditioner: shorter time integration (MA + LS)", "28 % (Funnel)"),
    ("Algorithm 1 against collect, sort, reduce: assembly faster", "3.8x to 5.3x"),
    ("the same, Algorithm 1 filled by atomics", "3.8x to 5.3x"),
    ("localized search: shorter penetration handling", "32 % to 54 % (of CCD)"),
    ("tolerance 1e-11 instead of 1e-6: longer step", "30 %"),
]


def stage(run, name):
    return run.stages[name]["median_ms"] if name in run.stages else math.nan


def shares(run):
    """Milliseconds of the paper's four boxes and of the rest."""
    boxes = {box: sum(stage(run, name) for name in names) for box, names in BOXES.items()}
    total = sum(r["median_ms"] for r in run.top().values())
    return {**boxes, "Misc": total - sum(boxes.values())}


def claims(runs):
    """Our value for each of CLAIMS from the runs of one scene; None where a run is missing."""
    base = runs.get("paper")

    def compare(variant, value):
        other = runs.get(variant)
        return value(base, other) if base and other else None

    percent = lambda x: f"{100 * x:.0f} %"  # noqa: E731
    integration = lambda r: stage(r, "matrix assembly") + stage(r, "linear solve")  # noqa: E731
    assembly = lambda r: stage(r, "matrix assembly/matrix assembly")  # noqa: E731
    sorting, atomic = runs.get("sorted assembly"), runs.get("atomic filling")
    return [
        compare("no preconditioner", lambda a, b: percent(1 - a["iterations"] / b["iterations"])),
        compare("no preconditioner", lambda a, b: percent(1 - integration(a) / integration(b))),
        compare("sorted assembly", lambda a, b: f"{assembly(b) / assembly(a):.2f}x"),
        f"{assembly(sorting) / assembly(atomic):.2f}x" if sorting and atomic else None,
        compare(
            "search not localized",
            lambda a, b: percent(1 - stage(a, "penetration handling") / stage(b, "penetration handling")),
        ),
        compare("tolerance 1e-11", lambda a, b: percent(b["median_ms"] / a["median_ms"] - 1)),
    ]


def run_all(arguments, file):
    """{scene: {variant: Run}}; the CSV of every run goes to `file` as it comes."""
    program, root = times.find_program(arguments.build), os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    begin, runs = time.monotonic(), {scene: {} for scene in arguments.scenes}
    share = 3 * arguments.budget / (len(VARIANTS) * len(arguments.scenes))  # at most, of one run
    for variant, changed in VARIANTS.items():
        for scene in arguments.scenes:
            left = min(max(share, 10), arguments.budget - (time.monotonic() - begin))
            if left < 5:
                print(f"  {scene}, {variant}: not run, the time is spent", file=sys.stderr)
                continue
            settings = dict(
                accuracy="paper",
                backend=arguments.backend,
                precision=arguments.precision,
                threads=arguments.threads,
                device=arguments.device,
                resolutions=arguments.resolution,
                skip=arguments.skip,
                steps=arguments.steps,
                limit=round(0.8 * left),
                **changed,
            )
            text, said = times.run(program, os.path.join(root, "scenes", scene), left, **settings)
            print(f"  {variant}: {said}", file=sys.stderr, flush=True)
            file.write(text)
            file.flush()
            found = times.parse(text)
            if found:
                runs[scene][variant] = found[0]
    return runs


def read_runs(path):
    """The same from a CSV of before; a run's changed options say which variant it is."""
    names = {
        " ".join(f"{name}={value}" for name, value in changed.items()): variant for variant, changed in VARIANTS.items()
    }
    names.update(OLD_NAMES)
    runs = {}
    for run in times.read([path]):
        if run["options"] in names:
            runs.setdefault(run["scene"], {})[names[run["options"]]] = run
    return runs


def tables(runs):
    """Two tables as (title, columns, rows)."""
    scenes = [s for s in runs if "paper" in runs[s]]
    rows = []
    for scene in scenes:
        run, parts = runs[scene]["paper"], shares(runs[scene]["paper"])
        total = sum(parts.values())
        rows.append(
            [
                scene,
                f"{run['triangles']:,}",
                times.short(run["median_ms"]),
                times.short(run["iterations"]),
                times.short(run["contacts"]),
            ]
            + [f"{100 * v / total:.0f} %" for v in parts.values()]
            + [times.short(run["intersections"])]
        )
    columns = [
        "scene",
        "triangles",
        "ms per step",
        "iterations",
        "contacts",
        "PC",
        "MA",
        "LS",
        "PH",
        "Misc",
        "intersections",
    ]
    worth = [
        [claim, said] + [value or "not run" for value in values]
        for (claim, said), *values in zip(CLAIMS, *[claims(runs[s]) for s in scenes])
    ]
    return [("Shares of a step", columns, rows), ("What each part is worth", ["claim", "paper, 200K"] + scenes, worth)]


def plot(runs, path):
    """Stacked shares of each scene; False without matplotlib."""
    try:
        plot_shares({s: shares(variants["paper"]) for s, variants in runs.items() if "paper" in variants}, path)
    except ImportError:
        return False
    return True


def plot_shares(parts, path):
    """Bars of {scene: {box: time or share}}. Throws ImportError without matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scenes = list(parts)
    figure, axes = plt.subplots(figsize=(7, 0.7 * len(scenes) + 1.2), constrained_layout=True)
    left = [0.0] * len(scenes)
    for box, color in zip(["PC", "MA", "LS", "PH", "Misc"], ["#4c78a8", "#f58518", "#54a24b", "#e45756", "#9d9da1"]):
        width = [100 * parts[s][box] / sum(parts[s].values()) for s in scenes]
        axes.barh(scenes, width, left=left, label=box, color=color)
        for y, (w, x) in enumerate(zip(width, left)):
            if w >= 4:
                axes.text(x + w / 2, y, f"{w:.0f}", ha="center", va="center", color="white", fontsize=9)
        left = [a + b for a, b in zip(left, width)]
    axes.set(xlim=(0, 100), xlabel="share of a step, %")
    axes.invert_yaxis()
    axes.legend(ncols=5, loc="lower center", bbox_to_anchor=(0.5, 1), frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def write(runs, folder):
    title = "# The paper's measurements\n\n"
    first = next((r for variants in runs.values() for r in variants.values()), None)
    if first is None:
        raise SystemExit("nothing ran")
    title += f"Paper mode, {first['precision']}, {first['backend']} on {first['device']}; "
    title += f"medians of {first['steps']} steps after {first['skipped']}.\n"
    with open(os.path.join(folder, "paper_tables.csv"), "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for name, columns, rows in tables(runs):
            title += f"\n## {name}\n\n{times.markdown(columns, rows)}\n"
            writer.writerows([[name], columns, *rows, []])
    with open(os.path.join(folder, "paper_tables.md"), "w", encoding="utf-8") as file:
        file.write(title)
    print(title)
    if not plot(runs, os.path.join(folder, "paper_stages.png")):
        print("matplotlib is not there: no plot", file=sys.stderr)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("out")
    p.add_argument("--scenes", nargs="+", default=SCENES)
    p.add_argument("--resolution", type=int, default=2000, help="cloth triangles; the paper: 200000")
    p.add_argument("--skip", type=int, default=60, help="steps from rest that are not measured")
    p.add_argument("--steps", type=int, default=20)
    p.add_argument("--backend", default="cpu")
    p.add_argument("--precision", default="double")
    p.add_argument("--device", type=int, default=0)
    p.add_argument("--threads", type=int, default=0)
    p.add_argument(
        "--budget", type=float, default=3600, help="seconds for all runs; what does not fit is left out and said so"
    )
    p.add_argument("--read", metavar="CSV", help="of an earlier call, in place of running")
    p.add_argument("--build", help="build folder with benchmarks/step_times")
    arguments = p.parse_args()
    os.makedirs(arguments.out, exist_ok=True)
    if arguments.read:
        runs = read_runs(arguments.read)
    else:
        with open(os.path.join(arguments.out, "paper.csv"), "w", encoding="utf-8") as file:
            runs = run_all(arguments, file)
    write(runs, arguments.out)


if __name__ == "__main__":
    main()
