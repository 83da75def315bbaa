# SPDX-License-Identifier: Apache-2.0
"""A newcomer's walk: README, start and guide, every block typed in the order of the site.

A page has a folder of its own, in which the project's files and `.venv` lie as in the project's folder. Commands run
in bash, Python blocks share their names, a JSON block is loaded as a scene, or as a part of one. A `text` block that
follows is what the block before it prints: `...` in it stands for anything, on a line of its own for any number of
lines, and times may differ. Everything else must be as shown; a command ends with exit code 0.

`test_walk` takes smaller sizes for some commands (SMALLER), the long `test_walk_as_typed` takes none.
"""

import contextlib
import io
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import traceback
import warnings

import h5py
import numpy as np
import pytest

import cama
from pages import ROOT, SHELL, blocks, checked, name_of, same, typed


def walked():
    """README, then the pages of start and guide in the order of the site's navigation."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    return [ROOT / "README.md", *(ROOT / "docs" / page for page in re.findall(r": ((?:start|guide)/\S+\.md)\n", nav))]


PAGES = walked()
FIRST_STEPS = ROOT / "docs/start/first-steps.md"
# By `cama render`, `cama view`, `cama export`, `cama tradeoff` and `cama tune`.
for needed in ("pyvista", "imageio", "viser", "pxr", "scipy", "matplotlib"):
    pytest.importorskip(needed)

# What is not run: a command, or the first line of a block, and why.
BUILDS = "installs system packages and builds; script/test and tests/install do it"
SERVES = "serves until Ctrl-C; test_viewer.py does it"
WHEEL = "builds a wheel, or needs one; script/test makes and tries one with script/wheel"
CHARACTER = "needs the file of a character; test_characters.py does it"
NOT_RUN = {
    "script/demo": BUILDS,
    "script/test": BUILDS + ", and this test is part of it",
    "pip install .": BUILDS,
    "pip install '.[render]'": BUILDS,
    "pip install '.[export]'": BUILDS,
    "pip install '.[render,tradeoff]'": BUILDS,
    "blender --python examples/blender/open_cache.py -- out/drape/export/mdd": "needs Blender; test_blender.py does it",
    "pip install cama-0.1.0-cp311-cp311-manylinux_2_35_x86_64.whl": WHEEL,
    "pip install 'cama-0.1.0-cp311-cp311-manylinux_2_35_x86_64.whl[render]'": WHEEL,
    "script/wheel": WHEEL,
    "script/wheel python3.10 python3.12": WHEEL,
    "script/wheel --cuda": WHEEL,
    "cmake --preset release && cmake --build --preset release": BUILDS,
    "cmake --install build-release --prefix ~/cama --component library": BUILDS,
    "find_package(cama 0.1 REQUIRED)": "a part of the reader's CMake project; tests/install builds one",
    "cmake --preset release -DCAMA_CUDA=ON": "needs nvcc, and builds",
    'CMAKE_ARGS="-DCAMA_CUDA=ON" pip install .': "needs nvcc, and builds",
    "pip install '.[view]'": BUILDS,
    ".venv/bin/cama view out/drape": SERVES,
    "cama view out/drape": SERVES,
    "ssh -L 8080:127.0.0.1:8080 user@machine": "needs another machine",
    "cama view drape --accuracy interactive": SERVES,
    "@article{tang2016cama,": "an entry for BibTeX",
    '{ "frame_time": 0.02, "frames": 150, "resolution": 2000,': CHARACTER,
    '"obstacles": [{"name": "body", "character": {': "needs the file of a character; test_morph.py does it",
    "cloth = bpy.context.active_object.cama": "runs in Blender; test_blender_addon.py does it",
    "# Belt loops: eight vertices of the ring.": CHARACTER,
    "step 359: a moving obstacle or pin pinches cloth without a way out at (0.093, 0.015, 0.6165) m, between": (
        CHARACTER
    ),
    "E = k l² (θ - θ₀)² / (8 A)": "a formula",
    "N = stiffness (thickness - g/2) area": "a formula",
    "pip install gymnasium": "in the list `test` of pyproject.toml; the program below it is run",
    "pip install mujoco": "installs a package; test_mujoco.py runs the program where it is there",
    "python examples/10_mujoco.py": "needs MuJoCo; test_mujoco.py runs it",
    "@ray.remote(num_cpus=2)": "needs a cluster",
    "MeshError: mesh of cloth 2: face 0 (0 1 9) uses vertex 9, but there are 4; indices count from 0": (
        "messages that no block of the page provokes; test_errors_shown does"
    ),
}

# What the default walk adds to a command, so that it takes seconds; the last of an option that is given twice holds.
SMALL = "--resolution 96 --frames 2"
PICTURES = "--width 160 --height 120"
PLAN = "--resolution 96 --windows 2 --reference-step 1/4000"
SMALLER = {
    ".venv/bin/cama run drape --accuracy interactive": SMALL,
    ".venv/bin/cama render out/drape": PICTURES,
    "cama render out/drape": PICTURES,
    "cama run drape": SMALL,
    "cama run drape --accuracy interactive --frames 50 -o out/quick": SMALL,
    "cama run drape --resolution 20000 --backend opencl": SMALL,
    'cama run drape --error "0.5 %" --frames 50 -o out/error': SMALL,
    "cama run drape --set tolerance=1e-4 --set paper.search=fronts": SMALL,
    "cama run my-scene/scene.json --threads 2": SMALL,
    "cama run drape --frames 50": SMALL,
    "cama render out/drape --frame -1 --quality draft": PICTURES,
    "cama render out/drape --frame -1 --color steelblue --color upper=#b06a72 --background white": PICTURES,
    "cama render out/drape --film --limit 250": f"{PICTURES} --quality draft",
    "cama run drape --frames 100 --resume": SMALL.replace("2", "4"),
    "cama render out/drape --fps 60 --speed 1 --azimuth 30 --elevation 10 --width 1920 --height 1080": PICTURES,
    "cama run drape --backend cuda": SMALL,
    "cama render out/gripper --frame 190": PICTURES,
    "python examples/08_dataset.py draped.h5": "--samples 4",
    "python examples/09_gymnasium.py": "--worlds 1",
    "CAMA_BACKEND=cuda cama run drape": SMALL,
    "cama run napkin.json": SMALL,
    "cama dress skirt --body walker": "--resolution 300",
    "cama dress skirt --body walker --shrinkage front=0.03 --shrinkage back=0.03,0.01": "--resolution 300",
    "cama render out/skirt": PICTURES,
    "cama run out/skirt/scene.json -o out/skirt-run --frames 10": "--frames 1 --accuracy preview",
    "cama dress skirt --body dance -o out/dancer": "--resolution 200",
    "cama run out/dancer/scene.json": "--frames 1 --accuracy preview",
    "cama dress skirt top --body walk --fabric wool --fabric cotton -o out/outfit": "--resolution 200",
    "cama run my-skirt --frames 5": "--resolution 300 --frames 1 --accuracy preview",  # coarser ones touch the body
    "cama tradeoff drape --resolution 400": f"{PLAN} --vary time_step=1/200,1/400",
    "cama tradeoff flag --resolution 400 --vary time_step=1/200,1/800 --vary integrator=backward_euler,bdf2": PLAN,
    "cama fabric test cotton": "--only tensile --only drape --sectors 24 --drapes 1",
    "cama fabric test cotton --only cantilever --only drape --json": "--sectors 24 --drapes 1",
    "cama fabric test wool --only drape --picture drape.png": "--sectors 24 --drapes 1",
    "cama fabric fit measured.json -o twill.json": "--sectors 24 --drapes 1",
    "cama fabric test twill.json --only drape": "--sectors 24 --drapes 1",
    "cama run drape --material twill.json": SMALL,
    "cama tune drape --resolution 400 --error 8%": f"{PLAN} --vary time_step=1/200,1/400",
}

EXIT = {"cama check crossing.json --mesh intersections.ply": 1}  # something intersects there, as the page says


# --- What the reader has ----------------------------------------------------------------------------------------------


def dress(path):
    """A square of 20 cm with texture coordinates in centimetres."""
    path.write_text(
        "v 0 0 1\nv 0.2 0 1\nv 0.2 0.2 1\nv 0 0.2 1\nvt 0 0\nvt 20 0\nvt 20 20\nvt 0 20\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )


def fabric(path):
    shutil.copy(ROOT / "materials" / "cotton.json", path)


FILES = {"dress.obj": dress, "my-fabric.json": fabric}  # named by a block, made by nothing before it


def executable(path, text):
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def furnish(folder):
    """The project's folder after script/demo, with the package under test as `.venv/bin/cama`."""
    for path in ROOT.iterdir():
        if not path.name.startswith((".", "build")) and path.name != "out":
            (folder / path.name).symlink_to(path)
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    executable(programs / "python", f'exec "{sys.executable}" "$@"\n')
    executable(programs / "cama", f'exec "{sys.executable}" -m cama "$@"\n')
    for name, make in FILES.items():
        make(folder / name)


# --- The walk ---------------------------------------------------------------------------------------------------------


class Wrong(AssertionError):
    """The documentation is not true; names page and line."""

    def __init__(self, page, line, what):
        super().__init__(f"{name_of(page)}:{line}: {what}")


def backend_is_missing(command):
    """Whether a command names a backend that is not here."""
    named = re.search(r"(?:--backend |CAMA_BACKEND=)(\w+)", command)
    there = {backend["name"] for backend in cama.backends() if backend["available"]}
    return bool(named) and named[1] not in there


def run_command(page, line, command, folder, added=""):
    """What a command prints on standard output."""
    done = subprocess.run(
        ["bash", "-c", f"{command} {added}"],
        cwd=folder,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=3600,
        env={**os.environ, "PATH": f"{folder}/.venv/bin:{os.environ['PATH']}", "COLUMNS": "120"},
    )
    if backend_is_missing(command):
        right = done.returncode == 2 and "BackendError: " in done.stderr
    else:
        right = done.returncode == EXIT.get(command, 0)
    if not right:
        raise Wrong(page, line, f"{command} {added}\nexit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def run_python(block, names):
    """What a Python block prints; `names` are those of the page's program."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            exec(checked(block), names)
    except Exception as problem:
        here = [f.lineno for f in traceback.extract_tb(problem.__traceback__) if f.filename == name_of(block.page)]
        line = here[-1] if here else getattr(problem, "lineno", block.line)
        raise Wrong(block.page, line, f"{type(problem).__name__}: {problem}") from problem
    return printed.getvalue()


def load_scene(block, folder):
    """Loads a scene; of a part of one, with cloth that uses its materials where the part has none."""
    whole = block.text.lstrip().startswith("{")
    try:
        scene = json.loads(block.text if whole else f"{{{block.text}}}")
        if not whole:
            sheet = {"grid": {"size": [1, 1], "cells": [2, 2]}, "transform": {"translate": [0, 0, 2]}}
            cloth = [{**sheet, "material": material} for material in scene.get("materials", ["cotton"])]
            scene = {"name": "part", "cloth": cloth, **scene}
        path = folder / f"{scene['name']}.json"  # where the reader saves it
        path.write_text(json.dumps(scene))
        cama.Scene.load(str(path)).validate()
    except (ValueError, KeyError, cama.Error) as problem:
        raise Wrong(block.page, block.line, f"{type(problem).__name__}: {problem}") from problem


def pattern(line):
    """The expression for a line of shown output."""
    line = re.escape(" ".join(line.split())).replace(r"\ ", " ").replace(r"\.\.\.", ".*")
    return re.sub(r"\d+(?:\\\.\d+)?(?= (?:ms|s|minutes)\b)", r"[\\d.,]+", line)


def compare(block, printed):
    lines = [r"(?:.*\n)*" if line.strip() == "..." else pattern(line) + r"\n" for line in block.text.splitlines()]
    said = "".join(" ".join(line.split()) + "\n" for line in printed.splitlines())
    if not re.fullmatch("".join(lines), said):
        raise Wrong(block.page, block.line, f"shown is\n{block.text}\nprinted was\n{printed}")


def run_shell(block, folder, smaller):
    """What the commands of a block print; None where one was run smaller than it is typed."""
    run = [(line, command) for line, command in typed(block) if command not in NOT_RUN]
    printed = [run_command(block.page, line, command, folder, smaller.get(command, "")) for line, command in run]
    return None if any(command in smaller for _, command in run) else "".join(printed)


def walk(page, folder, smaller):
    """Types a page. Its folder is the working directory."""
    furnish(folder)
    names = {"__name__": "__main__", "_same": same}
    before, printed = None, None  # the kind of the block before, and what it printed
    for block in blocks(page):
        if block.kind == SHELL:
            printed = run_shell(block, folder, smaller)
        elif block.text.splitlines()[0] in NOT_RUN:
            pass
        elif block.kind == "python":
            printed = run_python(block, names)
        elif block.kind == "json":
            load_scene(block, folder)
        elif block.kind == "text" and before in (SHELL, "python"):
            if printed is not None:  # else the long walk compares it
                compare(block, printed)
        else:
            raise Wrong(page, block.line, f"no rule for a block of {block.kind or 'no language'} here")
        before = block.kind


@pytest.fixture
def there(tmp_path, monkeypatch):
    """The folder in which a page is typed. A warning about values that are hardly meant is an error."""
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", cama.PlausibilityWarning)
        yield tmp_path


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_walk(page, there):
    walk(page, there, SMALLER)


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_walk_as_typed(page, there):
    walk(page, there, {})


def test_first_steps_lists_what_a_run_writes(there):
    """Every dataset of frames.h5 and every field of summary.json has a row, and every row one of these."""
    furnish(there)
    run_command(FIRST_STEPS, 1, "cama run drape", there, SMALL)
    _, frames, summary, _ = re.split("(?m)^##+ (?:frames.h5|summary.json|The same)", FIRST_STEPS.read_text("utf-8"))
    rows = {name for row in re.findall(r"(?m)^\| (`.*?) \|", frames) for name in re.findall(r"`(\w+)`", row)}
    with h5py.File("out/drape/frames.h5") as recording:
        assert rows == set(recording)
    rows = {name for row in re.findall(r"(?m)^\| (`.*?) \|", summary) for name in re.findall(r"`(\w+)[`.]", row)}
    assert rows == set(json.loads((there / "out/drape/summary.json").read_text(encoding="utf-8")))


# --- The walk itself --------------------------------------------------------------------------------------------------


def test_every_page_is_walked():
    assert set(PAGES) == {ROOT / "README.md", *ROOT.glob("docs/start/*.md"), *ROOT.glob("docs/guide/*.md")}


def entries():
    """What the tables below may name: every command, and the first line of every other block."""
    for page in PAGES:
        for block in blocks(page):
            yield from (command for _, command in typed(block)) if block.kind == SHELL else [block.text.splitlines()[0]]


@pytest.mark.parametrize("table", ["NOT_RUN", "SMALLER", "EXIT"])
def test_no_exception_is_left_over(table):
    assert not set(globals()[table]) - set(entries())


def test_no_file_is_left_over():
    text = "".join(block.text for page in PAGES for block in blocks(page))
    assert not [name for name in FILES if name not in text]


def provoked(name):
    """The message of an error of this class."""
    scene, square = cama.Scene(), np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    for _ in range(2):
        scene.add_cloth(shape={"grid": {"size": [1, 1], "cells": [2, 2]}})
    calls = {
        "MeshError": lambda: scene.add_cloth(square, [[0, 1, 9]]),
        "MaterialError": lambda: cama.Material.fabric("kevlar"),
        "BackendError": lambda: cama.Simulation(scene, backend="cuda"),
        "ArrayError": lambda: scene.add_cloth(square[:, :2], [[0, 1, 2]]),
    }
    with pytest.raises(getattr(cama, name)) as raised:
        calls[name]()
    return f"{name}: {raised.value}"


def test_errors_shown():
    """The messages in the guide are the program's. Which backends there are is the machine's."""
    block = next(block for block in blocks(ROOT / "docs/guide/python.md") if block.kind == "text")
    absent = any(b["name"] == "cuda" and "not in this build" in b["note"] for b in cama.backends())
    for line in block.text.splitlines():
        if absent or not line.startswith("BackendError"):
            shown, said = (re.sub("available: .*", "", text) for text in (line, provoked(line.split(":")[0])))
            assert said == shown


def planted(folder, text):
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        ("# Page\n\n    cama info\n    cama simulate drape\n", 4, "simulate"),
        ("```sh\ncama run drape \\\n  --no-such-option   # a remark\n```\n", 2, "--no-such-option"),
        ("Text.\n\n    cama check drapes\n\n", 3, "drapes"),
        ("```python\nx = 2\n```\n\n```python\n\nx + 2      # -> 5\n```\n", 7, "is 4"),
        ("```python\nimport cama\n\n\ndef f():\n    cama.nothing\n\n\nf()\n```\n", 6, "nothing"),
        ("```python\nx = 1\nx = = 2\n```\n", 3, "SyntaxError"),
        ("```python\nprint(1, 2)\n```\n\n```text\n1 3\n```\n", 6, "1 3"),
        ("Text.\n\n    echo three words\n    echo 3.5 ms\n\n```text\nthree\n4 ms\n```\n", 7, "three words"),
        ("Text.\n\n    echo a; echo b\n\n```text\n...\na\n```\n", 6, "printed was"),
        ("Text.\n\n    script/demo\n\n```text\nvideo\n```\n", 6, "printed was"),
        ('```json\n{"name": "n", "clothes": []}\n```\n', 2, "clothes"),
        ('```json\n"options": {"tolerance": "low"}\n```\n', 2, "tolerance"),
        ("```text\nsaid by nobody\n```\n", 2, "no rule"),
        ("```ruby\nputs 1\n```\n", 2, "ruby"),
    ],
)
def test_what_is_wrong_is_seen(text, line, word, there):
    with pytest.raises(Wrong) as seen:
        walk(planted(there, text), there, {})
    assert str(seen.value).startswith(f"page.md:{line}: ") and word in str(seen.value)


@pytest.mark.parametrize(
    ("printed", "shown"),
    [
        ("a  b\nc 3.5 ms\nd\ne\n", "a b\nc 12.25 ms\n...\ne\n"),
        ("a\nb\n", "a\nb\n...\n"),
        ("a 1 s\n", "a 20 s\n"),
        ("one 7 two\n", "one ... two\n"),
    ],
)
def test_what_is_stable_is_compared(printed, shown, there):
    page = planted(there, f"```python\nprint({printed!r}, end='')\n```\n\n```text\n{shown}```\n")
    walk(page, there, {})


def test_what_is_right_passes(there):
    """A command continued over lines, in a folder of its own, whose file the program reads."""
    page = planted(
        there,
        "# Page\n\n    cama run drape --resolution 96 \\\n      --frames 1 -o out/small   # small\n\n"
        '```python\nimport json\njson.load(open("out/small/summary.json"))["intersections"]    # -> 0\n```\n',
    )
    walk(page, there, {})
