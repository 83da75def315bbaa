# SPDX-License-Identifier: Apache-2.0
"""Runs scene cases over seeds, sizes and backends; prints a table, writes CSV and pictures."""

import argparse
import ast
import csv
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from . import judge
from .scene_cases import CASES

COLUMNS = [
    "case",
    "backend",
    "seed",
    "triangles",
    "steps",
    "ms_per_step",
    "ms_worst",
    "audit",
    "ipctk",
    "impacts",
    "truncated",
    "lost_motion",
    "lost_worst",
    "substeps",
    "gap_mm",
    "strain",
    "kinetic",
    "outcome",
]


def perform(
    name, seed=0, resolution=0, backend="cpu", steps=0, keep=0, judge_every=1, options=None, expect=True, build=()
):
    """Runs one case. Returns (Run, complaints); an expected error is none."""
    case = CASES[name]
    scene = case.build(resolution or case.resolution, seed, **dict(build))
    run = judge.run(
        scene, steps or None, bound=case.bound, keep=keep, judge_every=judge_every, backend=backend, **(options or {})
    )
    complaints = list(run.problems)
    if case.error and not steps:
        if not (run.error.startswith(case.error + ":") and case.words in run.error):
            complaints.append(f"expected {case.error} with {case.words!r}, got {run.error or 'none'}")
    elif run.error:
        complaints.append(f"after {len(run.reports)} steps: {run.error}")
    if expect and not steps and not complaints:
        complaints += case.expect(run)
    return run, complaints


def row(name, seed, run, complaints):
    """One line of the table. truncated: share of vertices cut, mean over steps.  lost_motion: share of motion cut, mean over steps."""
    steps, s = max(1, len(run.reports)), run.simulation
    of = lambda field: [r[field] for r in run.reports] or [0]  # noqa: E731
    outcome = "; ".join(complaints) or ("ends with " + run.error.split(":")[0] if run.error else "ok")
    return dict(
        zip(
            COLUMNS,
            [
                name,
                s.backend,
                seed,
                s.cloth_triangle_count,
                len(run.reports),
                sum(of("milliseconds")) / steps,
                max(of("milliseconds")),
                max(run.audit, default=-1),
                max(run.referee, default=-1),
                run.total("impacts") / steps,
                run.total("truncated") / steps / s.cloth_vertex_count,
                run.total("lost_motion") / steps,
                max(of("lost_motion")),
                max(of("substeps")),
                1e3 * s.min_gap,
                s.max_strain,
                run.kinetic[-1] / max(run.kinetic) if run.kinetic else 0.0,
                outcome,
            ],
        )
    )


def task(name, seed, backend, arguments):
    """What a worker does."""
    keep = 0
    if arguments.pictures:
        keep = max(1, CASES[name].build(40, seed).frames // 60)
    run, complaints = perform(
        name, seed, arguments.resolution, backend, arguments.steps, keep, arguments.judge_every, dict(arguments.option)
    )
    if arguments.pictures:
        from . import pictures  # VTK

        case = CASES[name]
        pictures.strip(
            run,
            Path(arguments.pictures) / f"{name}_{backend}_{seed}.png",
            arguments.moments,
            *case.look,
            hide=case.hide,
        )
    return row(name, seed, run, complaints)


def text(value):
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def option(word):
    name, value = word.split("=", 1)
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, {"true": True, "false": False}.get(value.lower(), value)


def parser():
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}; none: all")
    p.add_argument("--seeds", type=int, default=1, help="jittered repeats")
    p.add_argument("--first-seed", type=int, default=0)
    p.add_argument("--backend", action="append", help="cpu (default), opencl, cuda; may be repeated")
    p.add_argument("--resolution", type=int, default=0, help="cloth triangles; 0: the case's")
    p.add_argument("--full", action="store_true", help="the case's large size")
    p.add_argument("--steps", type=int, default=0, help="stop earlier; nothing is expected of the end then")
    p.add_argument("--judge-every", type=int, default=1, help="audit every so many steps")
    p.add_argument(
        "--option", action="append", type=option, default=[], help="NAME=VALUE of cama.Simulation, may be repeated"
    )
    p.add_argument("--jobs", type=int, default=1, help="processes")
    p.add_argument("--csv", help="file to write")
    p.add_argument("--pictures", help="folder for one PNG per run")
    p.add_argument("--moments", type=int, default=4, help="moments in a picture")
    return p


def main(words=None):
    arguments = parser().parse_args(words)
    unknown = set(arguments.cases) - set(CASES)
    if unknown:
        sys.exit(f"unknown case {sorted(unknown)}; there are {', '.join(CASES)}")
    if arguments.pictures:
        Path(arguments.pictures).mkdir(parents=True, exist_ok=True)
    rows, begin = [], time.perf_counter()
    print(" | ".join(COLUMNS), flush=True)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        futures = {}
        for name in arguments.cases or CASES:
            for backend in arguments.backend or ["cpu"]:
                for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                    own = argparse.Namespace(**vars(arguments))
                    own.resolution = arguments.resolution or (CASES[name].full if arguments.full else 0)
                    futures[pool.submit(task, name, seed, backend, own)] = (name, backend, seed)
        for future in as_completed(futures):
            try:
                rows.append(future.result())
            except Exception as problem:  # a case that cannot even start is a line of the table
                rows.append(
                    dict(
                        zip(
                            COLUMNS,
                            [*futures[future], *[""] * (len(COLUMNS) - 4), f"{type(problem).__name__}: {problem}"],
                        )
                    )
                )
            print(" | ".join(text(v) for v in rows[-1].values()), flush=True)
            if arguments.csv:
                with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
                    writer = csv.DictWriter(file, COLUMNS)
                    writer.writeheader()
                    writer.writerows(rows)
    good = sum(r["outcome"] == "ok" or r["outcome"].startswith("ends with") for r in rows)
    print(f"{good} of {len(rows)} runs as expected, {time.perf_counter() - begin:.0f} s")
    return 0 if good == len(rows) else 1
