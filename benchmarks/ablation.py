# SPDX-License-Identifier: Apache-2.0
"""What each part of the collision handling does (the paper's Figure 17): impacts and intersections that are left with parts switched off.

    python benchmarks/ablation.py --resolution 3000 --steps 300
    python benchmarks/ablation.py --resolution 200000 --steps 100 --backend cuda --every 10 --csv ablation.csv

impacts: pairs (vertex-face, edge-edge) that touch while a step takes all vertices straight from where it began to where it ended; pairs by
ipctk's broad phase, the test cama.collision (no false negative).  intersections: edges through faces at the end, exact.  first: impacts
that the step itself found after its solve (report), where it looked for them.  Means over the judged steps.
"""

import argparse
import csv
import json
import sys
import time

import ipctk
import numpy as np

import cama
from cama import collision

VARIANTS = {
    "none": dict(contact=False),
    "proximity": dict(max_impact_passes=0, commit=False),
    "proximity, impact zones": dict(commit=False),
    "all": {},
}
COLUMNS = [
    "variant",
    "triangles",
    "steps",
    "impacts",
    "impacts_worst",
    "intersections",
    "intersections_worst",
    "intersections_end",
    "steps_with_any",
    "first",
    "truncated",
    "lost_motion",
    "ms_per_step",
]


class Judge:
    """Counts impacts of a step; obstacle against obstacle left out."""

    def __init__(self, simulation):
        faces = np.asfortranarray(simulation.faces, np.int32)
        sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        self.edges = np.asfortranarray(np.unique(np.sort(sides, axis=1), axis=0), np.int32)
        self.faces, self.first = faces, simulation.cloth_vertex_count
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(simulation.positions), self.edges, faces)

    def impacts(self, before, after):
        before, after = np.asfortranarray(before), np.asfortranarray(after)
        candidates = ipctk.Candidates()
        candidates.build(self.mesh, before, after, 0.0)
        pairs = np.array([(c.vertex_id, c.face_id) for c in candidates.fv_candidates], np.int64).reshape(-1, 2)
        rows = np.column_stack([pairs[:, 0], self.faces[pairs[:, 1]]])
        found = self._hits(collision.vertex_face_ccd, rows, (1, 3), before, after)
        pairs = np.array([(c.edge0_id, c.edge1_id) for c in candidates.ee_candidates], np.int64).reshape(-1, 2)
        rows = np.column_stack([self.edges[pairs[:, 0]], self.edges[pairs[:, 1]]])
        return found + self._hits(collision.edge_edge_ccd, rows, (2, 2), before, after)

    def _hits(self, test, rows, split, before, after):
        a, b = rows[:, : split[0]], rows[:, split[0] :]
        shared = (a[:, :, None] == b[:, None, :]).any(axis=(1, 2))
        rows = rows[~shared & ((a < self.first).any(axis=1) | (b < self.first).any(axis=1))]
        return int(test(before[rows], after[rows])[0].sum()) if len(rows) else 0


def measure(variant, arguments):
    """One line of the table."""
    options = dict(VARIANTS[variant])
    scene = cama.Scene.load(arguments.scene, arguments.resolution)
    if not options.pop("contact", True):
        described = json.loads(scene.to_json())
        described.setdefault("contact", {})["enabled"] = False
        scene = cama.Scene.parse(described)
    simulation = cama.Simulation(scene, backend=arguments.backend, **options)
    simulation.step(arguments.skip)
    judge, impacts, audits, reports = Judge(simulation), [], [], []
    begin = time.perf_counter()
    for step in range(arguments.steps):
        judged = step % arguments.every == 0
        before = simulation.positions if judged else None
        try:
            simulation.step()
        except cama.CollisionError as problem:
            print(f"  {variant}: ended after {len(reports)} steps: {problem}", file=sys.stderr, flush=True)
            break
        reports.append(simulation.report)
        if judged:
            impacts.append(judge.impacts(before, simulation.positions))
            audits.append(count(simulation, judge))
    print(f"  {variant}: {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    mean = lambda field: float(np.mean([r[field] for r in reports]))  # noqa: E731
    return dict(
        zip(
            COLUMNS,
            [
                variant,
                simulation.cloth_triangle_count,
                len(reports),
                float(np.mean(impacts)),
                max(impacts),
                float(np.mean(audits)),
                max(audits),
                audits[-1],
                float(np.mean(np.array(audits) > 0)),
                mean("impacts"),
                mean("truncated"),
                mean("lost_motion"),
                float(np.median([r["milliseconds"] for r in reports])),
            ],
        )
    )


def count(simulation, judge):
    """Intersections, also where contact is off and the simulation's own audit has nothing to look at."""
    return len(collision.intersections(simulation.positions, simulation.faces, judge.first))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--scene", default="sphere")
    p.add_argument("--resolution", type=int, default=3000, help="cloth triangles")
    p.add_argument("--steps", type=int, default=300)
    p.add_argument("--skip", type=int, default=0, help="steps before the first that is judged")
    p.add_argument("--every", type=int, default=1, help="judge every so many steps")
    p.add_argument("--backend", default="auto")
    p.add_argument("--variant", action="append", choices=VARIANTS, help="default: every one")
    p.add_argument("--csv")
    arguments = p.parse_args()
    rows = []
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS), flush=True)
    for variant in arguments.variant or VARIANTS:
        rows.append(measure(variant, arguments))
        print(
            "| " + " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in rows[-1].values()) + " |",
            flush=True,
        )
    if arguments.csv:
        with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
