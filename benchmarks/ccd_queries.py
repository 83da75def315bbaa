# SPDX-License-Identifier: Apache-2.0
"""Continuous collision queries: errors and cost of ours, FCL's and Tight Inclusion's in one run, as a Markdown table.

    python benchmarks/ccd_queries.py build/benchmarks/ccd_queries [--data FOLDER] [--seconds 10] [--output FILE]

FOLDER holds sample-queries and scalable with their readers (left out where absent). Tight Inclusion is ipctk's, called from Python: the cost
of a call, measured with pairs that its boxes reject at once, is subtracted. It gets --seconds per set and counts what it did in them.
"""

import argparse
import csv
import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import ipctk
import numpy as np


def sample_queries(folder):
    """Six folders of hand-made queries: name -> rows [n, 26]."""
    sys.path.insert(0, str(folder))
    import read_ccd_queries

    sets = {}
    for q in read_ccd_queries.sample_queries(str(folder / "sample-queries")):
        sets.setdefault(q.scene, []).append(np.concatenate([[q.is_edge_edge, q.truth], q.V.ravel()]))
    return {name: np.array(rows) for name, rows in sets.items()}


def scalable(folder, scene):
    """All listed pairs of two frames: rows [n, 26]."""
    sys.path.insert(0, str(folder))
    import scalable_frames

    first, second, _ = scalable_frames.load(scene)
    truth = np.load(folder / "scalable" / scene / "truth_ours.npz")
    parts = []
    for kind in ("ee", "vf"):
        v = truth[kind + "_verts"]
        head = np.stack([np.full(len(v), float(kind == "ee")), truth[kind + "_truth"].astype(float)], 1)
        parts.append(np.concatenate([head, first[v].reshape(-1, 12), second[v].reshape(-1, 12)], 1))
    return np.concatenate(parts)


def tight_inclusion(rows, seconds, overhead):
    """Returns queries done, missed, extra, ns a query less the cost of a call."""
    ccd = ipctk.TightInclusionCCD(1e-6, 1_000_000, 1.0)
    rows = rows[np.random.default_rng(1).permutation(len(rows))]
    points = rows[:, 2:].reshape(-1, 8, 3)
    calls = [(ccd.edge_edge_ccd if edges else ccd.point_triangle_ccd, tuple(p)) for edges, p in zip(rows[:, 0], points)]
    hit, begin, done = [], time.process_time_ns(), 0
    for query, p in calls:
        hit.append(query(*p)[0])
        done += 1
        if done % 16 == 0 and time.process_time_ns() - begin > seconds * 1e9:
            break
    total = [time.process_time_ns() - begin]
    while sum(total) < seconds * 0.5e9 and len(total) < 5:
        begin = time.process_time_ns()
        for query, p in calls[:done]:
            query(*p)
        total.append(time.process_time_ns() - begin)
    truth, hit = rows[:done, 1] > 0, np.array(hit)
    return done, int((truth & ~hit).sum()), int((~truth & hit).sum()), np.median(total) / done - overhead


def call_overhead():
    """ns of a call that the boxes reject at once; median of 9 over both kinds."""
    ccd = ipctk.TightInclusionCCD(1e-6, 1_000_000, 1.0)
    start = np.eye(4, 3)
    start[2:] += 100
    calls = [(q, tuple(start) + tuple(start)) for q in (ccd.edge_edge_ccd, ccd.point_triangle_ccd)] * 1000
    costs = []
    for _ in range(9):
        begin = time.process_time_ns()
        for query, p in calls:
            query(*p)
        costs.append((time.process_time_ns() - begin) / len(calls))
    return float(np.median(costs))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", type=Path)
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data" / "ccd")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sets = {}
        if options.data.exists():
            sets = sample_queries(options.data)
            sets.update({scene: scalable(options.data, scene) for scene in ("cloth-ball", "cloth-funnel")})
        else:
            print(f"SKIPPED: no query sets in {options.data}", file=sys.stderr)
        for name, rows in sets.items():
            np.ascontiguousarray(rows, float).tofile(Path(folder) / f"{name}.bin")
        command = [options.program, "--write", folder] + [f"{name}={folder}/{name}.bin" for name in sets]
        table = list(
            csv.DictReader(io.StringIO(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
        )
        overhead = call_overhead()
        names = list(dict.fromkeys(row["set"] for row in table))
        out = [
            "| set | queries | hits | " + " | ".join(["additive", "cubic", "FCL", "Tight Inclusion"]) + " |",
            "|---|---|---|---|---|---|---|",
        ]
        for name in names:
            cells = [f"{r['missed']} / {r['extra']} / {r['ns']}" for r in table if r["set"] == name]
            done, missed, extra, ns = tight_inclusion(
                np.fromfile(Path(folder) / f"{name}.bin").reshape(-1, 26), options.seconds, overhead
            )
            first = next(r for r in table if r["set"] == name)
            cells.append(
                f"{missed} / {extra} / {max(ns, 0):.0f}" + ("" if done == int(first["queries"]) else f" (of {done})")
            )
            out.append(f"| {name} | {first['queries']} | {first['hits']} | " + " | ".join(cells) + " |")
        out.append("")
        out.append(
            f"Missed / extra / ns a query. Cost of a call to Tight Inclusion from Python, subtracted: {overhead:.0f} ns."
        )
        text = "\n".join(out) + "\n"
        print(text)
        if options.output:
            options.output.write_text(text)


if __name__ == "__main__":
    main()
