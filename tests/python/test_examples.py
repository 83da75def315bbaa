# SPDX-License-Identifier: Apache-2.0
"""The programs in examples/ run and print what is true, by closed forms, counts and other libraries.

The C++ one is built and run by tests/install/check.sh.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import conftest

ROOT = Path(__file__).resolve().parents[2]

# Runs an example as a script and keeps the state that it ends with.
DUMP = """
import runpy, sys
import numpy as np
target, sys.argv = sys.argv[1], sys.argv[2:]
end = runpy.run_path(sys.argv[0], run_name="__main__")
simulation = end["simulation"]
np.savez(target, positions=simulation.positions, faces=simulation.faces, first_obstacle=simulation.cloth_vertex_count,
         cloth_faces=simulation.faces[:simulation.cloth_triangle_count], distances=simulation.contacts["distance"],
         start=type(simulation)(end["scene"]).positions, waist=end.get("waist", ()))
"""


def run(name, folder, *arguments):
    """(printed claims {name: text}, arrays at the end) of an example, run in an empty folder."""
    work, kept = folder / "work", folder / "end.npz"
    work.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", DUMP, str(kept), str(ROOT / "examples" / name), *map(str, arguments)],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 and "PlausibilityWarning" not in done.stderr, done.stderr
    claims = dict(line.split(": ", 1) for line in done.stdout.splitlines() if ": " in line)
    assert set(os.listdir(work)) == {str(a) for a in arguments}, (
        "an example writes what it is told to write, nothing else"
    )
    return claims, np.load(kept), done.stdout


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", text)]


def seen_by_ipctk(end):
    return conftest.count_intersections(end["positions"], end["faces"], int(end["first_obstacle"]))


def distances(points, triangles):
    """Distance of each point to a soup of triangles [m, 3, 3], by trimesh."""
    return [
        np.linalg.norm(trimesh.triangles.closest_point(triangles, np.tile(p, (len(triangles), 1))) - p, axis=1).min()
        for p in points
    ]


def test_drop_cloth(tmp_path):
    claims, end, _ = run("01_drop_cloth.py", tmp_path)
    assert claims["triangles"] == "512"  # 16 x 16 cells: the squares nearest to 500 / 2
    assert claims["intersections"] == "0" and seen_by_ipctk(end) == 0
    time, steps = numbers(claims["time"])
    assert time == pytest.approx(48 / 60, abs=1e-9) and steps >= 48  # at least one in each frame
    # The sheet lies on the ball: by trimesh's closest point to the centre, above it by less than the contact thickness.
    gap = distances([np.zeros(3)], end["positions"][end["cloth_faces"]])[0] - 0.25
    assert 0 < gap < 1.5e-3
    count, closest = numbers(claims["contacts"])
    assert count == len(end["distances"]) > 0 and closest == pytest.approx(end["distances"].min() * 1e3, abs=1e-3)
    assert 0 < closest < 2 * 1.5  # contacts are anticipated within a step


def test_drop_cloth_writes_a_scene_when_told(tmp_path):
    run("01_drop_cloth.py", tmp_path, "ball.json")
    scene = json.loads((tmp_path / "work" / "ball.json").read_text())
    assert scene["name"] == "ball" and len(scene["cloth"]) == len(scene["obstacles"]) == 1


def test_pins_and_obstacles(tmp_path):
    claims, end, text = run("02_pins_and_obstacles.py", tmp_path)
    assert claims["intersections"] == "0" and seen_by_ipctk(end) == 0
    assert numbers(claims["corners moved before the release"]) == [0.0]
    held, free = numbers(claims["corners moved at the end"])
    # Let go for 0.4 s: further than a tenth of the free fall, not further than the free fall and its own cloth allow.
    assert held == 0 and 0.1 * 9.81 * 0.4**2 / 2 < free < 2**0.5
    assert f"ball is at y = {-0.5 + 0.8 * 54 / 60:.6f} m" in text


def test_garment_on_body(tmp_path):
    claims, end, _ = run("03_garment_on_body.py", tmp_path)
    assert claims["triangles"] == str(len(end["cloth_faces"]))
    assert claims["intersections"] == "0" and seen_by_ipctk(end) == 0
    area, mass = numbers(claims["rest area"].replace("m^2", "m"))
    density = json.loads((ROOT / "materials" / "wool.json").read_text())["density"]
    assert mass == pytest.approx(area * density, rel=1e-5)
    count, height = numbers(claims["waist"])
    assert height == pytest.approx(1.06, abs=0.02)  # asked for at 1.06 m; the hips go up and down a little in a walk
    # The waist follows the body's surface: each of its vertices stays as far from it as it was, to a fraction of the
    # body's triangles.
    body = end["faces"][len(end["cloth_faces"]) :]
    before, after = (np.array(distances(x[end["waist"]], x[body])) for x in (end["start"], end["positions"]))
    assert count == len(after) > 20 and before.min() > 0.004 and np.abs(after - before).max() < 0.01
    assert (
        np.linalg.norm(end["positions"][end["waist"]] - end["start"][end["waist"]], axis=1).min() > 0.004
    )  # the body walks
    assert trimesh.Trimesh(end["positions"], end["cloth_faces"], process=False).area == pytest.approx(
        area, rel=0.05
    )  # hardly stretched
    assert numbers(claims["lowest point of the hem"])[0] == pytest.approx(1.06 - 0.45, abs=0.06)


def test_arrays_in_and_out(tmp_path):
    claims, end, text = run("04_arrays_in_out.py", tmp_path, "checkpoint.h5")
    fallen, formula = numbers(text.splitlines()[0])
    assert fallen == pytest.approx(formula, abs=1e-9)
    assert formula == pytest.approx(9.81 / 400**2 * (50**2 / 2 + 0.75), abs=1e-9)
    assert numbers(claims["weight"])[0] == pytest.approx(0.15 * 0.4**2 * 9.81, abs=1e-6)  # density x area x gravity
    assert (
        claims["intersections"] == "0" and end["positions"][: int(end["first_obstacle"]), 2].min() > 0
    )  # above the table
    assert claims["the same after the checkpoint"] == "True"


def test_fold_a_towel(tmp_path):
    claims, end, _ = run("06_fold_a_towel.py", tmp_path)
    assert claims["intersections"] == "0" and seen_by_ipctk(end) == 0
    assert numbers(claims["time"]) == [pytest.approx((90 + 60) / 60)]
    assert numbers(claims["corners missed their targets by"])[0] < 1e-9
    before, after = numbers(claims["folded from"])
    assert before == 0.4 and 0.19 < after < 0.26  # in half, give or take what friction let slide
    cloth = end["positions"][: int(end["first_obstacle"])]
    assert cloth[:, 2].min() > 0 and cloth[:, 2].max() < 0.05, "it lies on the table"
