# SPDX-License-Identifier: Apache-2.0
"""Pages of the site that must not fall behind the program: troubleshooting, gallery, notebooks, versions."""

import ast
import importlib
import json
import os
import pkgutil
import re
import sys

import nbclient
import nbformat
import pytest

import cama
from pages import ROOT

TROUBLESHOOTING = ROOT / "docs/guide/troubleshooting.md"


def section(heading):
    """The text of a section of the second level."""
    return re.split(rf"(?m)^## {heading}$", TROUBLESHOOTING.read_text("utf-8"))[1].split("\n## ")[0]


def errors():
    """Names of all exception classes of the package that users may meet."""
    for module in pkgutil.walk_packages(cama.__path__, "cama."):
        if not module.name.startswith(("cama.torture", "cama.io.hdf5_process", "cama.io.reader_process")):
            importlib.import_module(module.name)
    found, open_ones = set(), [cama.Error]
    while open_ones:
        one = open_ones.pop()
        found.add(one)
        open_ones += one.__subclasses__()
    return {one.__name__ for one in found if one.__module__.startswith("cama")}


def kinds():
    """Kinds of the findings that cama.plausibility makes."""
    sources = [ast.parse(path.read_text("utf-8")) for path in (ROOT / "bindings/python/cama/plausibility").glob("*.py")]
    for call in (node for source in sources for node in ast.walk(source)):
        if not (isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Finding"):
            continue
        kind = call.args[0]
        if isinstance(kind, ast.Constant):
            yield kind.value
        else:  # f"unwelded {kind}" of cloth and obstacles
            word = kind.values[0].value
            yield from (f"{word}cloth", f"{word}obstacle")


def test_every_error_is_explained():
    assert set(re.findall(r"(?m)^### (\w+)$", section("Errors by name"))) == errors()


def test_every_warning_is_explained():
    rows = re.findall(r"(?m)^\| ([^|]+?) \|", section("Warnings by kind"))[1:]
    assert sorted(word for row in rows for word in row.split(", ")) == sorted(set(kinds()))


def notebooks():
    return sorted((ROOT / "examples/notebooks").glob("*.ipynb"))


def said(notebook):
    """What the cells print, and the number of pictures that they draw."""
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    printed = [output.text for output in outputs if output.output_type == "stream" and output.name == "stdout"]
    return "".join(printed), sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("path", notebooks(), ids=lambda path: path.stem)
def test_notebooks_run_and_print_what_they_show(path, tmp_path, monkeypatch):
    """In a kernel of their own, from their first cell to the last."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    shown, run = (nbformat.read(path, as_version=4) for _ in range(2))
    for cell in run.cells:
        cell["outputs"] = []
    nbclient.NotebookClient(run, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert said(run) == said(shown)
    assert path.stat().st_size < 100_000 and not list(tmp_path.iterdir())


@pytest.fixture
def hook(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    return importlib.import_module("notebooks")


def test_pages_of_notebooks_have_all_that_is_in_them(hook):
    for path in notebooks():
        text, pictures = hook.page_of(path)
        assert text.startswith("# ") and text.count("![") == len(pictures)
        assert all(content.startswith(b"\x89PNG") for content in pictures.values())
        cells = json.loads(path.read_text("utf-8"))["cells"]
        assert all("".join(cell["source"]) in text for cell in cells if cell["cell_type"] == "code")
        for link in re.findall(r"\]\(\.\./([\w/-]+\.md)\)", text):
            assert (ROOT / "docs" / link).is_file()


def test_pictures_of_the_gallery_are_small_and_there_is_a_film_of_every_scene():
    """A picture below 200 KB, a film below 300 KB, all below 5 MB: they are loaded over slow lines and kept in git."""
    text = (ROOT / "docs/gallery.md").read_text("utf-8")
    sizes = {name: (ROOT / "docs" / name).stat().st_size for name in re.findall(r"\]\((images/\S+)\)", text)}
    assert all(size < (300_000 if name.endswith(".webp") else 200_000) for name, size in sizes.items())
    assert sum(sizes.values()) < 5_000_000
    assert set(re.findall(r"cama run (\w+) ", text)) == set(cama.scenes())
    assert {f"images/{scene}.webp" for scene in cama.scenes()} <= set(sizes)


def test_sections_of_docstrings_become_lists(monkeypatch):
    pytest.importorskip("griffe")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    markdown = importlib.import_module("docstrings").markdown
    said = markdown(
        "Adds.\n\nArgs:\n    a, b: Two numbers,\n        in m.\n    c: One.\n\n"
        "Raises:\n    FileError, MeshError\n\nEnd."
    )
    assert said == (
        "Adds.\n\n**Arguments**\n\n- `a`, `b`: Two numbers, in m.\n- `c`: One.\n\n"
        "**Raises**\n\n- FileError, MeshError\n\n"
        "End."
    )
    assert markdown("Nothing here.\n\nArguments are numbers:\n\n    x = 2") == (
        "Nothing here.\n\nArguments are numbers:\n\n    x = 2"
    )
