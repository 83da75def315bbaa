# SPDX-License-Identifier: Apache-2.0
"""World-steps a second of many small scenes: a sheet of 512 triangles that falls on a ball, in contact with itself.

python benchmarks/worlds.py [--backend cuda] [--worlds 1,16,128,1024] [--steps 20] [--compare 8]
"""

import argparse
import time

import numpy as np

import cama

CELLS = 16
TIME_STEP = 1 / 200  # s


def scene(number):
    """The sheet is turned and shifted in every world."""
    line = np.linspace(-0.25, 0.25, CELLS + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    index = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, CELLS + 1)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    random = np.random.default_rng(number)
    angle, (east, north) = random.uniform(0, np.pi), random.uniform(-0.04, 0.04, 2)
    turned = np.stack([np.cos(angle) * x - np.sin(angle) * y + east, np.sin(angle) * x + np.cos(angle) * y + north], -1)
    vertices = np.concatenate([turned.reshape(-1, 2), np.full((x.size, 1), 0.14)], axis=1)
    made = cama.Scene()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    made.add_cloth(vertices, faces, name="sheet", material="cotton", thickness=1e-3)
    made.add_obstacle(shape={"shape": {"sphere": {"radius": 0.12}}}, name="ball", friction=0.3)
    return made


def measure(count, warm, steps, compare, options):
    begin = time.perf_counter()
    worlds = cama.Worlds([scene(number) for number in range(count)], **options)
    made = time.perf_counter() - begin
    worlds.step(warm)
    before, times = worlds.launches, []
    for _ in range(steps):
        begin = time.perf_counter()
        worlds.step()
        times.append(time.perf_counter() - begin)
    median = float(np.median(times))
    launches = (worlds.launches - before) / steps
    begin = time.perf_counter()
    worlds.step(steps)
    together = (time.perf_counter() - begin) / steps
    reports = worlds.reports
    print(
        f"{worlds[0].backend}, {count} worlds: made in {made:.2f} s, {median * 1e3:.2f} ms a step, "
        f"{count / median:,.0f} world-steps a second; {steps} steps in one call: {together * 1e3:.2f} ms a step, "
        f"{count / together:,.0f} world-steps a second; {launches:.0f} launches a step, "
        f"{np.mean([r['iterations'] for r in reports]):.0f} iterations and "
        f"{np.mean([r['contacts'] for r in reports]):.0f} contacts a world, {len(worlds.frozen)} frozen, "
        f"{worlds[0].peak_memory_bytes / 1e6:.2f} MB a world",
        flush=True,
    )
    if not compare:
        return
    chosen = range(0, count, max(1, count // compare))
    differ = intersections = 0
    for number in chosen:
        alone = cama.Simulation(scene(number), **options)
        alone.step(warm + 2 * steps)
        differ += alone.state_hash != worlds[number].state_hash
        intersections += worlds[number].count_intersections()
    print(f"  {len(chosen)} worlds compared with themselves alone: {differ} differ; {intersections} intersections")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--precision", default=None)
    parser.add_argument("--worlds", default="1,16,128,1024", help="numbers of worlds")
    parser.add_argument("--warm", type=int, default=40, help="steps before those that are measured")
    parser.add_argument("--steps", type=int, default=20, help="steps one by one, and then in one call")
    parser.add_argument("--compare", type=int, default=0, help="worlds to compare with themselves alone")
    given = parser.parse_args()
    options = {"backend": given.backend, "precision": given.precision, "time_step": TIME_STEP}
    for count in given.worlds.split(","):
        measure(int(count), given.warm, given.steps, given.compare, options)


if __name__ == "__main__":
    main()
