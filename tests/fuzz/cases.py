# SPDX-License-Identifier: Apache-2.0
"""One case of the fuzzer: a damaged file, and what cama does with it."""

import math
import random
import shutil
import warnings
from pathlib import Path

import mutate
import numpy as np
import seeds
from typer.testing import CliRunner

import cama
from cama import plausibility
from cama.cli import app
from cama.io.reading import check_hdf5
from cama.io.recording import Recording

KINDS = {"scene": 45, "mesh": 35, "material": 8, "checkpoint": 6, "recording": 6}  # weights
COMMANDS = 0.15  # of the scenes that are given to commands
MOST = 2000  # triangles and vertices that are simulated
RUNNER = CliRunner()


class Wrong(Exception):
    """What must not happen: a number that is not finite, or a command that ends as it must not."""


def finite(what, *arrays):
    for array in arrays:
        if not np.isfinite(array).all():
            raise Wrong(f"{what}: a number is not finite")


def step(scene):
    """Takes two steps of a scene that is small enough."""
    plausibility.findings(scene)
    size = scene.triangle_count + scene.vertex_count + sum(len(o.vertices) + len(o.faces) for o in scene.obstacles)
    if size > MOST:
        return
    simulation = cama.Simulation(scene, backend="cpu", threads=1, accuracy="preview")
    for _ in range(2):
        simulation.step()
        finite("state", simulation.positions, simulation.velocities, list(simulation.energy().values()))


def use_scene(path, _):
    scene = cama.Scene.load(path)
    scene.validate()
    step(cama.Scene.parse(scene.to_json()))


def use_mesh(path, random):
    scene = cama.Scene()
    if random.random() < 0.5:
        scene.add_cloth(path, rest=random.choice(("start", "uv")), weld=random.random() < 0.3)
    else:
        scene.add_cloth(shape=seeds.GRID, translate=(0, 0, 5))
        scene.add_obstacle(path, weld=path.suffix in (".ply", ".obj", ".stl") and random.random() < 0.3)
    scene.validate()
    step(scene)


def use_material(path, _):
    scene = cama.Scene()
    scene.add_cloth(shape=seeds.GRID, material=cama.Material.load(path))
    step(scene)


def use_checkpoint(path, random):
    simulation = seeds.falling()
    simulation.load_checkpoint(path, changed_scene=random.random() < 0.3)
    simulation.step()
    finite("state", simulation.positions, simulation.velocities)


def use_recording(path, _):
    check_hdf5(path)  # as `cama render` does
    with Recording(path) as recording:
        for part in (*recording.cloths, *recording.obstacles):
            finite("radius", part.radius)
        finite("times", recording.times)
        for index in range(min(len(recording), 10)):
            finite("frame", recording.frame(index))


def command(path, random):
    """Gives a scene to a command in this process."""
    words = random.choice((["check"], ["explain"], ["run", "--frames", "1", "--threads", "1", "--overwrite", "-o"]))
    if words[0] == "run":
        words = [*words, str(path.parent / "out")]
    result = RUNNER.invoke(app, [words[0], str(path), *words[1:]])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    if result.exit_code not in (0, 1, 2):
        raise Wrong(f"cama {words[0]}: exit code {result.exit_code}")
    last = result.stderr.strip().splitlines()[-1:]
    if result.exit_code == 2 and not any("Error: " in line for line in last):
        raise Wrong(f"cama {words[0]}: exit code 2 without an error: {last}")


USES = {
    "scene": use_scene,
    "mesh": use_mesh,
    "material": use_material,
    "checkpoint": use_checkpoint,
    "recording": use_recording,
}


def make(seed, number, files, folder):
    """Writes the file of a case; returns its kind, its path and the case's random numbers."""
    chance = random.Random(f"{seed}/{number}")
    kind = chance.choices(list(KINDS), weights=KINDS.values())[0]
    source = chance.choice(files[kind])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / source.name
    if source.name == "files.json":
        for other in files["mesh"]:
            shutil.copy(other, folder)
        if chance.random() < 0.7:  # a damaged file of a whole scene
            victim = folder / chance.choice(("sheet.obj", "ball.ply", "body.gltf", "morph.gltf"))
            victim.write_bytes(mutate.mutated(chance, victim.read_bytes()))
            shutil.copy(source, path)
            return kind, path, chance
    path.write_bytes(mutate.mutated(chance, source.read_bytes()))
    return kind, path, chance


def run(seed, number, files, folder):
    """Runs a case. Returns (kind, outcome, problem): what was refused or taken, and "" or what must not happen."""
    kind, path, chance = make(seed, number, files, Path(folder))
    use = USES[kind]
    if kind == "scene" and chance.random() < COMMANDS:
        kind, use = "command", command
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # of NumPy: it means NaN or Inf
            warnings.simplefilter("ignore", cama.PlausibilityWarning)
            use(path, chance)
    except cama.Error as problem:
        text = str(problem)
        bad = "" if text and math.isfinite(len(text)) and len(text) < 5000 else f"error text of {len(text)} characters"
        return kind, type(problem).__name__, bad
    except Exception as problem:
        return kind, "foreign", f"{type(problem).__name__}: {problem}"
    return kind, "taken", ""
