# SPDX-License-Identifier: Apache-2.0
"""How often Chromium, drawing in software, draws the page of `cama view`: python benchmarks/viewer.py.

Plays a recording of waves on a grid, and prints for every stretch of seconds: pictures drawn and positions taken over a
second, frames that were sent, processor time of each process for a picture, and memory. It needs viser, playwright and
Chromium (CAMA_CHROMIUM can name it).
"""

import argparse
import collections
import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import cama
from cama.io.recording import NAME, Recorder
from cama.viewing.player import Player

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
COUNT = """
window.seen = {pictures: 0, taken: 0};
const paint = () => { window.seen.pictures++; requestAnimationFrame(paint); };
requestAnimationFrame(paint);
for (const name of ["bufferData", "bufferSubData"]) {
  const own = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    const data = given[name === "bufferData" ? 1 : 2];
    window.seen.taken += ((data && data.byteLength) || 0) > 1000 ? 0.5 : 0;  // positions and normals
    return own.apply(this, given);
  };
}
"""
NOW = "() => ({...window.seen, heap: performance.memory.usedJSHeapSize / 1e6})"


def record(folder, triangles, frames=60, rate=30):
    """Writes a recording of a sheet in waves that pass above a ball."""
    scene = cama.Scene(name="waves", frame_time=1 / rate)
    scene.add_cloth(shape={"grid": {"size": [1, 1]}, "triangles": triangles}, translate=(0, 0, 0.3))
    scene.add_obstacle(shape={"sphere": {"radius": 0.2}})
    simulation = cama.Simulation(scene, accuracy="preview")
    start, count = simulation.positions, scene.vertex_count
    with Recorder(folder / NAME, simulation, {"scene": "waves", "frame_time": 1 / rate, "thickness": 1e-3}) as recorder:
        for frame in range(frames):
            x = start.copy()
            x[:count, 2] += 0.05 * np.sin(2 * np.pi * (2 * x[:count, 0] + x[:count, 1] - frame / rate))
            recorder.add(frame / rate, x, 0, 0)
    return scene.triangle_count


def processor_time():
    """Processor time, s, of this process and of each kind of Chromium's below it."""
    spent = collections.Counter()
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_text().replace("\0", " ")
            row = (entry / "stat").read_text().rsplit(")", 1)[1].split()
        except (OSError, IndexError):
            continue
        if entry.name == str(os.getpid()):
            spent["cama"] += int(row[11]) + int(row[12])
        elif "chromium" in words.split(" ")[0]:
            kind = next((word[7:] for word in words.split() if word.startswith("--type=")), "browser")
            spent[kind] += int(row[11]) + int(row[12])
    return {kind: ticks / os.sysconf("SC_CLK_TCK") for kind, ticks in spent.items()}


def measure(page, sent, seconds, label):
    """Prints what happens within some seconds."""
    begun, before, seen = time.monotonic(), processor_time(), page.evaluate(NOW)
    sent.clear()
    page.wait_for_timeout(1e3 * seconds)
    now, after, took = page.evaluate(NOW), processor_time(), time.monotonic() - begun
    pictures = max(now["pictures"] - seen["pictures"], 1)
    shares = {kind: (after[kind] - before.get(kind, 0)) / pictures for kind in after}
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    print(
        f"{label}: {pictures / took:.2f} pictures/s, {(now['taken'] - seen['taken']) / took:.2f} taken over/s, "
        f"{len(sent) / took:.1f} sent/s; s of a processor a picture: "
        + ", ".join(f"{kind} {share:.3f}" for kind, share in shares.items() if share > 5e-3)
        + f"; heap {now['heap']:.0f} MB, resident {resident:.0f} MB; load {os.getloadavg()[0]:.1f}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--triangles", type=int, default=200_000)
    parser.add_argument("--seconds", type=float, default=15)
    parser.add_argument("--stretches", type=int, default=2)
    parser.add_argument("--size", type=int, nargs=2, default=(900, 480))
    given = parser.parse_args()
    program = os.environ.get("CAMA_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        print(f"{record(Path(folder), given.triangles):,} triangles, {given.size[0]} x {given.size[1]} pixels")
        with Player(folder) as viewer:
            sent, show = [], viewer._show
            viewer._show = lambda: (sent.append(None), show())
            browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
            page = browser.new_page(viewport=dict(zip(("width", "height"), given.size)))
            page.set_default_timeout(300_000)
            page.add_init_script(COUNT)
            page.goto(viewer.url)
            page.wait_for_timeout(8000)
            measure(page, sent, given.seconds, "still")
            page.get_by_role("button", name="Play").click()
            for number in range(given.stretches):
                measure(page, sent, given.seconds, f"play {number + 1}")
            browser.close()


if __name__ == "__main__":
    main()
