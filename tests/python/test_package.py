# SPDX-License-Identifier: Apache-2.0
"""The package as a whole: no module imports itself through others, tools load on first use, its types are right."""

import ast
import os
import posixpath
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cama

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "bindings" / "python" / "cama"
TYPED = Path(__file__).parent / "typed"
PROGRAMS = sorted(path.name for path in TYPED.glob("*.py") if path.name != "mistakes.py")


def module_names(package):
    """{name: path} of all modules below a package's folder; the compiled one is there by its stub."""
    names = {}
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.pyi")]):
        parts = (package.name, *path.relative_to(package).with_suffix("").parts)
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def is_for_type_checkers(node):
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def imports(tree):
    """Import statements that run when a module is loaded: those of functions and `if TYPE_CHECKING` are not."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif is_for_type_checkers(node):
            yield from imports(ast.Module(body=node.orelse, type_ignores=[]))
        elif not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            yield from imports(node)


def imported(name, path, names):
    """Modules of the package that a module imports when it is loaded."""
    for node in imports(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)
            continue
        base = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
        base = base[: len(base) - node.level + 1] if node.level else []
        source = ".".join([*base, *([node.module] if node.module else [])])
        for alias in node.names:
            inner = f"{source}.{alias.name}"
            if inner in names or source in names:
                yield inner if inner in names else source


def circles(package):
    """Lists of modules each of which imports the next, the last one the first."""
    names = module_names(package)
    return circles_of({name: sorted(set(imported(name, path, names)) - {name}) for name, path in names.items()})


def circles_of(edges):
    found, done = [], set()

    def visit(name, trail):
        if name in trail:
            found.append(trail[trail.index(name) :])
            return
        if name in done:
            return
        for other in edges.get(name, ()):
            visit(other, [*trail, name])
        done.add(name)

    for name in edges:
        visit(name, [])
    return found


def test_no_module_imports_itself_through_others():
    names = module_names(PACKAGE)
    assert {"cama", "cama.scene", "cama.cli.run", "cama.measuring.tune", "cama.torture.table"} <= names.keys()
    simulation = set(imported("cama.simulation", names["cama.simulation"], names))
    assert {"cama.scene", "cama.io.checkpoint", "cama.options"} <= simulation  # imports are seen at all
    assert circles(PACKAGE) == []


@pytest.mark.parametrize(
    ("file", "line", "expected"),
    [
        ("scene.py", "from .simulation import Simulation", {"cama.scene", "cama.simulation"}),
        ("measuring/reference.py", "from . import grid", {"cama.measuring.reference", "cama.measuring.grid"}),
        (
            "options.py",
            "try:\n    import cama.scene_values\nexcept ImportError:\n    pass",
            {"cama.options", "cama.scene_values"},
        ),
    ],
)
def test_a_planted_circle_is_seen(file, line, expected, tmp_path):
    package = tmp_path / "cama"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("*.so", "__pycache__", "scenes"))
    path = package / file
    path.write_text(f"{path.read_text(encoding='utf-8')}\n{line}\n", encoding="utf-8")
    assert expected in [set(circle) for circle in circles(package)]


def test_imports_of_functions_and_type_checkers_make_no_circle(tmp_path):
    package = tmp_path / "cama"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "a.py").write_text("from . import b\n")
    (package / "b.py").write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .a import A\ndef late():\n    from . import a\n"
    )
    assert circles(package) == []
    (package / "b.py").write_text("class B:\n    from . import a\n")
    assert circles(package) == [["cama.a", "cama.b"]]


def loaded_after(statement):
    """Names of the modules that are loaded after a statement in a new process."""
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_tools_are_loaded_on_first_use():
    late = {"scipy", "matplotlib", "pyvista", "ray", "typer", "rich", "ipctk", "h5py"}
    late |= {f"cama.{wing}" for wing in ("measuring", "torture", "cli", "io.render", "io.recording")}
    plain = loaded_after("import cama")
    assert {"cama", "cama.simulation", "numpy"} <= plain
    assert not late & plain
    assert "cama.measuring.accuracy" in loaded_after("import cama\ncama.accuracy.strain")
    assert "cama.measuring.tune" in loaded_after("from cama import tune")
    with pytest.raises(AttributeError, match="no attribute 'accurracy'"):
        cama.accurracy  # noqa: B018
    assert {"accuracy", "tradeoff", "tune", "Scene", "__version__"} <= set(dir(cama))


def run(*words):
    """What a module of Python says: CompletedProcess. Its types are those of the cama that these tests import."""
    source = str(Path(cama.__file__).parents[1])
    path = {} if "site-packages" in source else {"MYPYPATH": source}
    return subprocess.run(
        [sys.executable, "-m", *map(str, words)], capture_output=True, text=True, env={**os.environ, **path}
    )


def test_user_programs_have_the_types_that_mypy_expects(tmp_path):
    assert len(PROGRAMS) == 7
    done = run(
        "mypy", "--strict", "--follow-imports=silent", "--cache-dir", tmp_path, *(TYPED / name for name in PROGRAMS)
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", PROGRAMS)
def test_user_programs_run(name):
    done = subprocess.run([sys.executable, TYPED / name], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_mistakes_of_user_programs_are_reported(tmp_path):
    """Where mypy is expected to report an error it does, of that kind, and nowhere else."""
    file = TYPED / "mistakes.py"
    expected = {
        number: re.findall(r"[\w-]+", line.partition("# expect:")[2])
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if "# expect:" in line
    }
    done = run("mypy", "--strict", "--follow-imports=silent", "--hide-error-context", "--cache-dir", tmp_path, file)
    seen = {}
    for line, kind in re.findall(r"mistakes\.py:(\d+): error: .*\[([\w-]+)\]", done.stdout):
        seen.setdefault(int(line), []).append(kind)
    assert seen == expected and len(expected) > 10


def test_the_stub_is_of_the_compiled_module(tmp_path):
    """Every name of `_core` is in the stub and the other way. Left out: pybind11's metaclass and constructors that only
    raise, and names of types that annotations alone use.
    """
    classes = (
        "Character|Cloth|Contact|Gas|LentArray|Material|Mesh|Motion|Obstacle|OptionOverrides|Received|Rigid|Scene|"
        "Simulation|Wind|Worlds"
    )
    allowed = tmp_path / "allowed"
    allowed.write_text(
        rf"cama\._core\.({classes})(\.__init__)?" + "\n" + r"cama\._core\.(AccuracyLevel|StepReport)" + "\n"
    )
    done = run("mypy.stubtest", "cama._core", "--concise", "--ignore-unused-allowlist", "--allowlist", allowed)
    assert done.returncode == 0, done.stdout + done.stderr


def test_python_code_keeps_the_rules_of_ruff():
    for words in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *words, ROOT / "bindings/python", ROOT / "tests", ROOT / "benchmarks"],
            capture_output=True,
            text=True,
            cwd=ROOT,
        )
        assert done.returncode == 0, done.stdout + done.stderr


def include_graph(root):
    """{header or source: included files of the library} of C++ files below a folder, as paths relative to it."""
    files = {
        p.relative_to(root).as_posix(): p
        for folder in ("libcama", "backends")
        for p in (root / folder).rglob("*")
        if p.suffix in (".hpp", ".cpp", ".cu", ".h")
    }
    graph = {}
    for name, path in files.items():
        found = re.findall(r'^#include "([^"]+)"', path.read_text(encoding="utf-8"), flags=re.M)
        places = [Path(name).parent, Path("libcama/src"), Path("libcama/include"), Path("libcama")]
        graph[name] = {
            next((c for c in (posixpath.normpath((p / f).as_posix()) for p in places) if c in files), f) for f in found
        }
    return graph


def test_cpp_includes_have_no_circles(tmp_path):
    def copied(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    assert not circles_of(include_graph(ROOT))
    copied("libcama/src/model/a.hpp", '#include "run/b.hpp"\n')
    copied("libcama/src/run/b.hpp", '#include "model/a.hpp"\n')
    assert circles_of(include_graph(tmp_path))


def test_backends_take_one_inner_header():
    """And nothing of the library includes a backend: backends/backends.cpp alone knows which there are."""
    for name, included in include_graph(ROOT).items():
        if name.startswith("backends/"):
            inner = {i for i in included if i.startswith("libcama/src/")}
            assert inner <= {"libcama/src/device/for_backends.hpp"}, name
        if name.startswith("libcama/"):
            assert not {i for i in included if i.startswith("backends/")}, name


def test_the_package_says_who_made_it_and_for_what():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    project = text[text.index("[project]") : text.index("[project.optional")]
    assert 'authors = [{ name = "cama developers" }]' in project
    assert '"Topic :: Scientific/Engineering :: Physics"' in project and "License ::" not in project


def test_all_and_dev_name_the_other_extras():
    """`all` is what users may want; `dev` is what contributors need besides Ray, which its test does without."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    table = text[text.index("[project.optional-dependencies]\n") : text.index("[project.scripts]")]
    extras = {name: re.findall(r'"([^"]+)"', line) for name, line in re.findall(r"^(\w+) = (.*)$", table, re.M)}
    named = {
        extra: set(re.fullmatch(r"cama\[(.*)\]", next(w for w in words if w.startswith("cama[")))[1].split(","))
        for extra, words in extras.items()
        if extra in ("all", "dev")
    }
    assert named["all"] == set(extras) - {"test", "browser", "docs", "wheel", "all", "dev"}
    assert named["dev"] >= {"test", "docs", "wheel", "render", "tradeoff"} and named["dev"] <= set(extras)


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("readelf"), reason="reads an ELF file with readelf")
def test_the_compiled_module_links_no_driver():
    """OpenCL's loader and CUDA's driver are opened when they are used, so the package loads where they are absent."""
    said = subprocess.run(["readelf", "-d", cama._core.__file__], capture_output=True, text=True, check=True).stdout
    needed = re.findall(r"\(NEEDED\).*\[(.+)\]", said)
    assert any(name.startswith("libc.so") for name in needed)
    assert not [name for name in needed if name.startswith(("libOpenCL", "libcuda", "libnvidia"))]


def opencl_with(library, *lines):
    """What lines of Python print in a new process where CAMA_OPENCL_LIBRARY names a file."""
    code = "\n".join(["import cama", "opencl, = [b for b in cama.backends() if b['name'] == 'opencl']", *lines])
    environment = {**os.environ, "CAMA_OPENCL_LIBRARY": str(library)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


IN_BUILD = "not in this build" not in next(b for b in cama.backends() if b["name"] == "opencl")["note"]


@pytest.mark.skipif(not IN_BUILD, reason="the OpenCL backend is not in this build")
def test_an_absent_opencl_loader_is_said_with_what_to_do(tmp_path):
    said = opencl_with(
        tmp_path / "absent.so",
        "print(opencl['available'], opencl['devices'], opencl['note'])",
        "scene = cama.Scene(thickness=1e-3)",
        "scene.add_cloth([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])",
        "cama.Simulation(scene, backend='cpu').step()",
        "cama.Simulation(scene, backend='auto').step()",
        "try:",
        "    cama.Simulation(scene, backend='opencl')",
        "except cama.BackendError as error:",
        "    print(error)",
    )
    listed, raised = said.splitlines()
    assert listed.startswith("False [] OpenCL loader not found: CAMA_OPENCL_LIBRARY is '")
    assert raised.startswith("OpenCL loader not found: ") and "absent.so" in raised and "unset it" in raised


@pytest.mark.skipif(not IN_BUILD or sys.platform != "linux", reason="needs the OpenCL backend on Linux")
def test_a_library_that_is_not_opencl_is_refused():
    said = opencl_with("libm.so.6", "print(opencl['available'], opencl['note'])")
    assert said.startswith("False OpenCL loader without clBuildProgram: it is older than OpenCL 1.2; install")
