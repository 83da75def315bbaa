# SPDX-License-Identifier: Apache-2.0
"""Pages of the site that must not fall behind the program: troubleshooting, gallery, notebooks, versions."""

import ast
import importlib
import pkgutil
import re

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
    """Kinds of the findings that plausibility.py makes."""
    source = ast.parse((ROOT / "bindings/python/cama/plausibility.py").read_text("utf-8"))
    for call in ast.walk(source):
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
