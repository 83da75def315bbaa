# SPDX-License-Identifier: Apache-2.0
"""Whether the level `paper` survives a scene: times of steps, passes, impacts, intersections and strain.

    python benchmarks/paper_mode.py SCENE TRIANGLES [--backend cpu] [--steps 600] [--time-step 0.005] [--seconds 120]
        [--audit 10]

Prints a row every `--audit` steps and a summary; the exit status is 1 where a bound does not hold: intersections above
0.01 % of the triangles, a step beyond 20 times the median, strain of 100 %.
"""

import argparse
import statistics
import sys
import time

import cama


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("triangles", type=int)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--time-step", type=float, default=1 / 200, help="s; the paper's Funnel: 0.00333333")
    parser.add_argument("--seconds", type=float, default=1e9, help="wall time after which no step begins")
    parser.add_argument("--audit", type=int, default=10, help="steps between exact counts of intersections")
    given = parser.parse_args()

    scene = cama.Scene.load(given.scene, resolution=given.triangles)
    simulation = cama.Simulation(scene, accuracy="paper", time_step=given.time_step, backend=given.backend)
    triangles, start, times = simulation.cloth_triangle_count, time.perf_counter(), []
    worst = {"intersections": (0, 0), "strain": (0.0, 0), "passes": (0, 0)}  # value and step
    print("step,ms,median_ms,contacts,impacts,passes,intersections,strain_percent")
    while len(times) < given.steps and time.perf_counter() - start < given.seconds:
        before = time.perf_counter()
        simulation.step()
        times.append(1e3 * (time.perf_counter() - before))
        report = simulation.report
        step = len(times)
        worst["passes"] = max(worst["passes"], (report["impact_passes"], step))
        if step % given.audit:
            continue
        intersections, strain = simulation.count_intersections(), 100 * simulation.max_strain
        worst["intersections"] = max(worst["intersections"], (intersections, step))
        worst["strain"] = max(worst["strain"], (strain, step))
        print(
            f"{step},{times[-1]:.1f},{statistics.median(times):.1f},{report['contacts']},{report['impacts']},"
            f"{report['impact_passes']},{intersections},{strain:.1f}",
            flush=True,
        )
    median, longest = statistics.median(times), max(times)
    (passes, passes_at), (intersections, _), (strain, strain_at) = (
        worst[name] for name in ("passes", "intersections", "strain")
    )
    print(
        f"# {given.scene}, {triangles:,} triangles, {simulation.device}: {len(times)} steps of "
        f"1/{1 / given.time_step:.0f} s, median {median:.1f} ms, longest {longest / median:.1f} times the median (step "
        f"{times.index(longest) + 1}); at most {passes} passes (step {passes_at}), {intersections} intersections, "
        f"strain {strain:.0f} % (step {strain_at})"
    )
    return int(intersections > 1e-4 * triangles or longest > 20 * median or strain >= 100)


if __name__ == "__main__":
    sys.exit(main())
