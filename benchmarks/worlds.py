# SPDX-License-Identifier: Apache-2.0
"""World-steps a second of many small scenes: a sheet of 512 triangles that falls on a ball, or two of half its width
one above the other, which touch each other and the ball.

python benchmarks/worlds.py [--backend cuda] [--worlds 1,16,128,1024] [--steps 20] [--compare 8]
python benchmarks/worlds.py --worlds 1024 --episodes 2 --length 200 --layers 2 --accuracy interactive
"""

import argparse
import time

import numpy as np

import cama
from cama.cli.common import chosen

CELLS = 16
TIME_STEP = 1 / 200  # s


def scene(number, layers=1):
    """The sheets are turned and shifted in every world."""
    across, width = (CELLS, 0.5) if layers == 1 else (CELLS // 2, 0.25)
    x, y = np.meshgrid(
        np.linspace(-0.25, 0.25, CELLS + 1), np.linspace(-width / 2, width / 2, across + 1), indexing="ij"
    )
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    random = np.random.default_rng(number)
    angle, (east, north) = random.uniform(0, np.pi), random.uniform(-0.04, 0.04, 2)
    turned = np.stack([np.cos(angle) * x - np.sin(angle) * y + east, np.sin(angle) * x + np.cos(angle) * y + north], -1)
    made = cama.Scene()
    for layer in range(layers):
        height = np.full((x.size, 1), 0.14 + 0.004 * layer)
        vertices = np.concatenate([turned.reshape(-1, 2), height], axis=1)
        name = "sheet" if layers == 1 else f"sheet {layer}"
        made.add_cloth(vertices, faces, name=name, material="cotton", thickness=1e-3)
    made.add_obstacle(shape={"shape": {"sphere": {"radius": 0.12}}}, name="ball", friction=0.3)
    return made


def measure_episodes(count, length, episodes, layers, options):
    """Episodes of `length` steps in one call, each after a reset of all worlds but the first."""
    worlds = cama.Worlds([scene(number, layers) for number in range(count)], **options)
    for episode in range(episodes):
        begin = time.perf_counter()
        if episode:
            worlds.reset()
        reset = time.perf_counter() - begin
        worlds.step(length)
        whole = time.perf_counter() - begin
        print(
            f"{worlds[0].backend}, {count} worlds, episode {episode}: reset {reset * 1e3:.1f} ms, "
            f"{(whole - reset) / length * 1e3:.2f} ms a step, {count * length / whole:,.0f} world-steps a second, "
            f"{np.mean([r['contacts'] for r in worlds.reports]):.0f} contacts a world, {len(worlds.frozen)} frozen",
            flush=True,
        )


def measure(count, warm, steps, compare, layers, options):
    begin = time.perf_counter()
    worlds = cama.Worlds([scene(number, layers) for number in range(count)], **options)
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
        alone = cama.Simulation(scene(number, layers), **options)
        alone.step(warm + 2 * steps)
        differ += alone.state_hash != worlds[number].state_hash
        intersections += worlds[number].count_intersections()
    print(f"  {len(chosen)} worlds compared with themselves alone: {differ} differ; {intersections} intersections")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--accuracy", default=None)
    parser.add_argument("--precision", default=None)
    parser.add_argument("--worlds", default="1,16,128,1024", help="numbers of worlds")
    parser.add_argument("--warm", type=int, default=40, help="steps before those that are measured")
    parser.add_argument("--steps", type=int, default=20, help="steps one by one, and then in one call")
    parser.add_argument("--compare", type=int, default=0, help="worlds to compare with themselves alone")
    parser.add_argument("--layers", type=int, default=1, choices=[1, 2], help="sheets in a world")
    parser.add_argument("--episodes", type=int, default=0, help="episodes to measure, instead of steps")
    parser.add_argument("--length", type=int, default=200, help="steps of an episode")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another option")
    given = parser.parse_args()
    options = {"backend": given.backend, "accuracy": given.accuracy, "precision": given.precision}
    options.update(chosen(TIME_STEP, given.set))
    for count in given.worlds.split(","):
        if given.episodes:
            measure_episodes(int(count), given.length, given.episodes, given.layers, options)
        else:
            measure(int(count), given.warm, given.steps, given.compare, given.layers, options)


if __name__ == "__main__":
    main()
