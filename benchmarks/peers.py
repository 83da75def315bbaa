# SPDX-License-Identifier: Apache-2.0
"""cama beside other cloth simulators in one run: the same mesh, output times and judge and, as models agree, material.

    python benchmarks/peers.py OUT --triangles 2000 --python newton=PEERS/bin/python
    python benchmarks/peers.py OUT --triangles 20000 --device cuda --systems cama newton libuipc --python ...

Cases (--case), of isotropic cloth of 0.15 kg/m^2, 1000 N/m, Poisson's ratio 0.2, bending 1e-5 N m, friction 0.3:

drape   one square sheet of 1 m that falls on a fixed sphere of radius 0.25 m
sheets  three of them, 6 mm apart and turned against each other, the default
pile    fifty of them that fall on a plane
twist   a strip of 1 m x 0.4 m whose ends turn against each other, by 180 degrees a second each, without gravity

Every system runs at its defaults and at two other settings (peer_systems.py says which), each in a process of the
interpreter that --python names for it, by default this one. A system that is not installed or has no such device is a
row that says so.

OUT/peers.csv and OUT/peers.md: wall seconds a simulated second (steps alone, after one frame that compiles and warms
up), ipctk's count of edges through faces over all frames, depth in the obstacle, strain of edges, energy at the end
(kinetic, by the mean velocity over the last frame, and of height, from the start), and the error against the system's
own refined run: root mean square distance of vertices, at 0.1 s, before the sheets buckle, and at the end.
"""

import argparse
import csv
import datetime
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import result_page
import times
from peer_systems import SETTINGS

COLUMNS = [
    "system", "version", "settings", "device", "precision", "dt_s", "tolerance", "guarantee", "triangles", "s_per_s",
    "intersections", "frames_with_any", "frames", "depth_mm", "strain_mean_percent", "strain_max_percent",
    "kinetic_mj", "height_mj", "error_at_0.1_s_mm", "error_at_end_mm", "note",
]  # fmt: skip
RADIUS = 0.25  # m


def grid(length, width, cells, rows):
    """Vertices [n, 2], m, and triangles of a rectangle about the origin whose diagonals alternate."""
    along, across = length * np.linspace(-0.5, 0.5, cells + 1), width * np.linspace(-0.5, 0.5, rows + 1)
    x, y = np.meshgrid(along, across, indexing="ij")
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    even = (np.add.outer(np.arange(cells), np.arange(rows)) % 2 == 0).ravel()[:, None]
    faces = np.where(even, np.stack([a, b, c, a, c, d], 1), np.stack([a, b, d, b, c, d], 1)).reshape(-1, 3)
    return np.stack([x.ravel(), y.ravel()], axis=1), faces


def write_case(path, name, triangles, seconds, rate):
    """The cloth of a case as one mesh, layer by layer."""
    layers = {"drape": 1, "sheets": 3, "pile": 50, "twist": 1}[name]
    width = 0.4 if name == "twist" else 1.0
    cells = max(2, round((triangles / (2 * layers * width)) ** 0.5))
    rest, one = grid(1.0, width, cells, max(2, round(cells * width)))
    first = {"drape": RADIUS, "sheets": RADIUS, "pile": 0.0, "twist": -6e-3}[name]
    vertices, faces = [], []
    for layer in range(layers):
        turn = np.radians(11.5 * layer)
        x = np.cos(turn) * rest[:, 0] - np.sin(turn) * rest[:, 1]
        y = np.sin(turn) * rest[:, 0] + np.cos(turn) * rest[:, 1]
        vertices.append(np.stack([x, y, np.full(len(rest), first + 6e-3 * (layer + 1))], axis=1))
        faces.append(one + layer * len(rest))
    x = np.concatenate(vertices)
    ends = [np.flatnonzero(np.abs(x[:, 0] - end) < 1e-9) for end in (-0.5, 0.5)] if name == "twist" else [[], []]
    np.savez(
        path, vertices=x, faces=np.concatenate(faces).astype(np.int32), rest=rest, layers=layers,
        frames=round(seconds * rate), frame_time=1 / rate, density=0.15, young=1000.0, poisson=0.2, bending=1e-5,
        friction=0.3, thickness=1.5e-3, gravity=0.0 if name == "twist" else 9.81,
        obstacle={"pile": "plane", "twist": ""}.get(name, "sphere"), radius=RADIUS,
        held=np.concatenate(ends).astype(np.int32), rate=np.repeat([-np.pi, np.pi], [len(ends[0]), len(ends[1])]),
    )  # fmt: skip


def edges_of(faces):
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)


class Judge:
    """ipctk's view of the cloth."""

    def __init__(self, vertices, faces):
        import ipctk

        self.ipctk, self.faces, self.edges = ipctk, np.asfortranarray(faces), np.asfortranarray(edges_of(faces))
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(vertices), self.edges, self.faces)

    def count(self, positions):
        """Edges through faces."""
        x = np.asfortranarray(positions, float)
        if not self.ipctk.has_intersections(self.mesh, x):
            return 0
        tree = self.ipctk.LBVH()
        tree.build(x, self.edges, self.faces, 1e-9)
        found = 0
        for pair in tree.detect_edge_face_candidates():
            e, f = self.edges[pair.edge_id], self.faces[pair.face_id]
            found += not set(e) & set(f) and self.ipctk.is_edge_intersecting_triangle(*x[e], *x[f])
        return int(found)


def judged(case, positions):
    """What is measured of the frames of one run."""
    judge, edges = Judge(case["vertices"], case["faces"]), edges_of(case["faces"])

    def length(x):
        return np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)

    rest = length(case["vertices"])
    depth = {
        "sphere": lambda: RADIUS - float(np.linalg.norm(positions, axis=2).min()),
        "plane": lambda: -float(positions[:, :, 2].min()),
        "": lambda: 0.0,
    }[str(case["obstacle"])]()
    counts = [judge.count(x) for x in positions]
    strain = [np.abs(length(x) / rest - 1) for x in positions]
    return {
        "intersections": sum(counts),
        "frames_with_any": sum(n > 0 for n in counts),
        "frames": len(counts),
        "depth_mm": round(1e3 * max(0.0, depth), 3),
        "strain_mean_percent": round(100 * max(float(s.mean()) for s in strain), 2),
        "strain_max_percent": round(100 * max(float(s.max()) for s in strain), 1),
    }


def energy(case, positions):
    """Kinetic energy over the last frame and gain of energy of height since the start, mJ."""
    start, faces = case["vertices"], case["faces"]
    a, b, c = (start[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    mass = np.bincount(faces.ravel(), np.repeat(float(case["density"]) * area / 3, 3), len(start))
    before = positions[-2] if len(positions) > 1 else start
    velocity = (positions[-1] - before) / float(case["frame_time"])
    return {
        "kinetic_mj": round(500 * float(mass @ (velocity**2).sum(axis=1)), 3),
        "height_mj": round(1e3 * float(case["gravity"]) * float(mass @ (positions[-1] - start)[:, 2]), 3),
    }


def distance(first, second):
    return round(1e3 * float(np.sqrt(((first - second) ** 2).sum(axis=1).mean())), 2)


def run_one(python, system, settings, case, out, device, seconds):
    """Starts one system in a process; returns what it said, and its frames or None."""
    words = [python, str(Path(__file__).with_name("peer_systems.py")), system, settings, str(case), str(out), device]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired as over:
        frames = len((over.stdout or b"").decode(errors="replace").split("frame ")) - 1
        return {"note": f"not ended after {seconds:.0f} s, in which it computed {frames} frames"}, None
    if done.returncode:
        lines = [line for line in (done.stderr or done.stdout).strip().splitlines() if line.strip()]
        return {"note": "not run: " + (lines[-1][:200] if lines else f"exit status {done.returncode}")}, None
    with np.load(out) as file:
        return json.loads(str(file["said"])), file["positions"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--case", default="sheets", choices=["drape", "sheets", "pile", "twist"])
    parser.add_argument("--triangles", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=0.8, help="simulated")
    parser.add_argument("--rate", type=int, default=40, help="frames a second that are judged")
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    parser.add_argument("--systems", nargs="+", default=list(SETTINGS), choices=SETTINGS)
    parser.add_argument("--python", nargs="+", default=[], metavar="SYSTEM=PROGRAM")
    parser.add_argument("--settings", type=int, nargs="+", default=[], help="some of them, 0: the defaults")
    parser.add_argument("--limit", type=float, default=600, help="wall seconds of one run")
    given = parser.parse_args()
    out = Path(given.out)
    out.mkdir(parents=True, exist_ok=True)
    programs = dict(word.split("=", 1) for word in given.python)
    write_case(out / "case.npz", given.case, given.triangles, given.seconds, given.rate)
    with np.load(out / "case.npz") as file:
        case = {name: file[name] for name in file.files}
    rows, early = [], min(round(0.1 * given.rate), int(case["frames"])) - 1
    for system in given.systems:
        program = programs.get(system, sys.executable)
        refined, own = None, []
        for number, settings in reversed(list(enumerate(SETTINGS[system]))):  # the refined one is the last
            if given.settings and number not in given.settings:
                continue
            said, positions = run_one(
                program, system, settings, out / "case.npz", out / f"{system}-{number}.npz", given.device, given.limit
            )
            row = {"system": system, "settings": settings, "triangles": len(case["faces"]), **said}
            if positions is not None:
                refined = positions if settings == SETTINGS[system][-1] else refined
                row.update(judged(case, positions))
                row.update(energy(case, positions))
                if refined is not None and refined is not positions:
                    row["error_at_0.1_s_mm"] = distance(positions[early], refined[early])
                    row["error_at_end_mm"] = distance(positions[-1], refined[-1])
            print(row, flush=True)
            own.insert(0, row)
        rows += own
    with open(out / "peers.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows)
    text = f"{datetime.date.today().isoformat()}, commit {result_page.commit()}.\n\n    python benchmarks/peers.py "
    text += " ".join(["OUT", *sys.argv[2:]]) + "\n\n"
    text += times.markdown(COLUMNS, [[row.get(name, "") for name in COLUMNS] for row in rows]) + "\n"
    (out / "peers.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
