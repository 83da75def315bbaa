# SPDX-License-Identifier: Apache-2.0
"""Sentences that stay true: what the documentation names exists, what it shows runs, and its links lead somewhere."""

import fnmatch
import functools
import importlib
import json
import re
import shlex
import sys
import unicodedata
from pathlib import Path

import pytest
import typer.main

import cama
from cama.cli.main import app
from pages import PAGES, ROOT, commands, name_of, python_blocks, without_blocks

Refused = next(
    c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException"
)  # what Typer's parser raises, its own Click's or Click's
GENERATED = {
    "options.md",
    "report.md",
    "command-line.md",
    "scene-file.md",
    "cpp-api.md",
}  # in docs/reference, made by docs/generate.py
SOURCES = (
    "libcama",
    "backends",
    "bindings",
    "benchmarks",
    "tests",
    "script",
    "scenes",
    "materials",
    "cmake",
    "examples",
    "results",
    ".ci",
)
TEXT = {".py", ".cpp", ".hpp", ".h", ".cu", ".cl", ".c", ".def", ".json", ".txt", ".cmake", ".in", ".sh", ".toml", ""}

# Names that are not the project's, with the reason why the documentation has them.
FOREIGN = {
    "the shell and its programs": "apt-get sudo source pip venv ctest perf",
    "Python and its packages": "multiprocessing get_context spawn fork",
    "build tools": "CMAKE_CUDA_ARCHITECTURES CMAKE_PREFIX_PATH CMAKE_ARGS all-major find_package",
    "options of drivers and loaders": "CUDA_VISIBLE_DEVICES OCL_ICD_VENDORS OCL_ICD_FILENAMES libnvidia-opencl.so.1",
    "names of devices and drivers": "NVIDIA Portable gfx",
    "the licence, which is named in comments": "SPDX-License-Identifier Apache-2.0",
    "words that stand for others": "NAME VALUE SCENE SCENE.png OUT FILE CASE outer/inner stage/part",
}
FOREIGN_PATHS = (
    "~/",
    "/usr/",
    "/etc/",
    "out/",
    "OUT/",
    "build/",
    "build-",
    "$",
    ".venv/",
)  # of the reader's machine, or made by a run
WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def files():
    for folder in SOURCES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                yield path
    yield from (path for path in sorted(ROOT.iterdir()) if path.is_file())
    yield from (path for path in sorted((ROOT / "docs").rglob("*")) if path.is_file())


def without_comments(path, text):
    """Code alone: comments are prose, which the names in the documentation are not checked against."""
    if path.suffix in (".cpp", ".hpp", ".h", ".cu", ".cl", ".c", ".def"):
        return re.sub(r"//[^\n]*|/\*.*?\*/", " ", text, flags=re.S)
    if path.suffix in (".py", ".sh", ".txt", ".cmake", ".toml", ".in", ""):
        text = re.sub(r'"""(?:.|\n)*?"""', " ", text) if path.suffix == ".py" else text
        return re.sub(r"(?m)(^|\s)#[^\n]*", " ", text)
    return text


@functools.lru_cache(None)
def code():
    """(all code as one text, all names in it). A string is a name where it is one word: error texts lend no names."""
    texts, names = [], set()
    for path in files():
        names.update(WORD.findall(path.stem))
        if path == Path(__file__).resolve() or path.suffix not in TEXT or path.is_relative_to(ROOT / "docs"):
            continue
        text = without_comments(path, path.read_text(encoding="utf-8", errors="replace"))
        texts.append(text)
        for literal in re.findall(r'"((?:[^"\\\n]|\\.)*)"', text):
            if " " not in literal.strip():
                names.update(WORD.findall(literal))
        names.update(WORD.findall(re.sub(r'"(?:[^"\\\n]|\\.)*"', " ", text)))
    return "\n".join(texts), names


@functools.lru_cache(None)
def paths():
    return [name_of(path) for path in files()]


def foreign():
    return {word for words in FOREIGN.values() for word in words.split()}


def spans(page):
    """Backticked texts of a page, but for names of the past: those left of an arrow."""
    text = re.sub(r"`[^`\n]+` →", "", without_blocks(page.read_text(encoding="utf-8")))
    return [span.replace("\\|", "|") for span in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text)]


# --- Names ------------------------------------------------------------------------------------------------------------


@functools.lru_cache(None)
def application():
    return typer.main.get_command(app)


@functools.lru_cache(None)
def flags():
    """Options of all commands, those of groups too."""
    commands = list(application().commands.values())
    commands += [inner for group in commands for inner in getattr(group, "commands", {}).values()]
    return {
        flag
        for command in commands
        for parameter in command.params
        for flag in (*parameter.opts, *parameter.secondary_opts)
    }


def attribute_is_there(dotted):
    """Whether cama.A.b, or A.b with A a class of the package, leads to something; None for words of other worlds."""
    first, *rest = dotted.split(".")
    if first != "cama" and not (rest and first in cama.__all__ and first[0].isupper()):
        return None
    thing = cama
    for word in rest if first == "cama" else (first, *rest):
        if not hasattr(thing, word):
            try:
                thing = importlib.import_module(f"{thing.__name__}.{word}")
            except (AttributeError, ImportError):
                return False
        else:
            thing = getattr(thing, word)
            if isinstance(thing, property):
                break
    return True


@functools.lru_cache(None)
def path_ends():
    """Every file's name with the folders before it: c.py, b/c.py, a/b/c.py."""
    return {"/".join(path.split("/")[i:]) for path in paths() for i in range(path.count("/") + 1)}


def is_path(token):
    """Whether a file or folder ends like this; `<topic>` stands for any name."""
    tail = re.sub(r"<\w+>", "*", token).strip("/")
    return tail in path_ends() or tail in folders() or ("*" in tail and bool(fnmatch.filter(path_ends(), tail)))


@functools.lru_cache(None)
def folders():
    """Every run of folders on the way to a file."""
    found = set()
    for path in paths():
        parts = path.split("/")[:-1]
        found.update("/".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1))
    return found


@functools.lru_cache(None)
def in_code(text):
    """Whether a text stands in the code, not as a part of longer words."""
    whole, _ = code()
    return text in whole and re.search(r"(?<![\w-])" + re.escape(text) + r"(?!\w)", whole) is not None


@functools.lru_cache(None)
def missing(span):
    """The words of a backticked text that name nothing."""
    _, names = code()
    if span.startswith("cama ") or re.fullmatch(r"[0-9a-f]{16}", span):
        return []  # a command, which has a test of its own; a hash
    if len(span) > 3 and not WORD.fullmatch(span) and in_code(span):
        return []
    wrong = []
    for token in re.findall(r"[^\s,;(){}\[\]=\"'!|]+", span if "/" in span else re.sub("[<>]", " ", span)):
        token = token.rstrip(".:+?&").lstrip(":+?&*").split("#")[0]
        if (
            not re.search(r"[A-Za-z_]{2}", token)
            or not token.isascii()
            or token in foreign()
            or token.startswith(FOREIGN_PATHS)
        ):
            continue
        words = [word for word in WORD.findall(token) if len(word) > 2 and word not in foreign()]
        if token.startswith("-"):
            wrong += [token] if token not in flags() and not in_code(token) else []
        elif re.fullmatch(r"[\w.-]+\.(cpp|hpp|h|py|json|md|csv|def|cu|cl|sh|txt|cmake|toml|png|h5|cff)|.*/.*", token):
            wrong += (
                [token] if not is_path(token) and not in_code(token) and not re.fullmatch(r"\d+/\d+", token) else []
            )
        elif "*" in token:
            parts = [part for part in re.split(r"[.:]+", token) if re.search(r"\w", part)]
            wrong += [token] if not all(fnmatch.filter(names, part) for part in parts) else []
        elif re.fullmatch(r"_\w+_?|\w+_", token):  # a piece of a name
            wrong += [token] if not any(token in name for name in names) else []
        else:
            there = attribute_is_there(token)
            wrong += (
                [token] if there is False else [word for word in words if word not in names] if there is None else []
            )
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_exist(page):
    found = {span: missing(span) for span in dict.fromkeys(spans(page))}
    assert not {span: wrong for span, wrong in found.items() if wrong}


@pytest.mark.parametrize(
    "span",
    [
        "start_solver_of_old",
        "Simulation.scene_key",
        "cama.Simulation.steps",
        "--no-such-flag",
        "docs/no-such-page.md",
        "src/nothing.cpp",
        "no_such_thing_*",
        'report["never_reported"]',
        "Backend::is_a_cpu",
        "CAMA_NO_SUCH_VARIABLE",
        "tests/unit/test_nothing.cpp:12",
    ],
)
def test_a_false_name_is_seen(span):
    assert missing(span)


@pytest.mark.parametrize(
    "span",
    [
        "Simulation.step",
        "cama.collision.vertex_face_ccd",
        "--resolution",
        "tests/python/conftest.py",
        "triangle_*",
        'Simulation(scene, intersections="untangle")',
        "cama::Scene",
        "CAMA_BACKEND",
        "-ffp-contract=off",
        "libcama/kernels/<topic>.h",
        "CITATION.cff",
        "scenes/schema.json",
        '{"grid": {"size": [1, 1]}}',
        "1/960",
        "conftest.py",
    ],
)
def test_a_true_name_is_not(span):
    assert not missing(span)


def test_changelog_says_nothing_is_missing_that_is_there():
    assert "not there yet" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").lower()


# Words that were given up for the field's own, with what is written now: docs/developer/vocabulary.md. Code spans are
# not looked at.
RETIRED = {
    "graphics card": "GPU",
    "said aloud": "reported",
    "refused by name": "refused with an error that says why",
    "a named error": "an error that says what is wrong",
    "knob": "option",
    "preset": "accuracy level",
    "the kernels of now": "a date and a commit",
    "machine that others use": "shared machine",
    "guilty": "intersecting",
}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_retired_words_stay_away(page):
    prose = re.sub(r"`[^`\n]*`", "", without_blocks(page.read_text(encoding="utf-8"))).lower()
    if page.name == "vocabulary.md":
        return  # names what it replaces
    assert not [word for word in RETIRED if re.search(rf"\b{word}", prose)]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_lines_fit(page):
    """120 columns but for tables, pictures and addresses."""
    long = [
        line
        for line in page.read_text(encoding="utf-8").splitlines()
        if len(line) > 120 and not re.match(r"\s*[|!]|.*https?:", line)
    ]
    assert not long


# --- Links ------------------------------------------------------------------------------------------------------------


def slug(heading):
    """The anchor of a heading, as mkdocs makes it."""
    heading = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
    heading = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def anchors(page):
    text = re.sub(r"(?ms)^```.*?^```", "", page.read_text(encoding="utf-8"))
    found = {slug(heading) for heading in re.findall(r"(?m)^#+ (.*?)\s*$", text)} | set(
        re.findall(r'(?:id|name)="([^"]+)"', text)
    )
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    wrong = []
    for target in re.findall(r"\]\(([^)\s]+)\)", without_blocks(page.read_text(encoding="utf-8"))):
        if target.startswith(("http:", "https:", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        other = (page.parent / path).resolve() if path else page
        generated = other.parent == ROOT / "docs" / "reference" and other.name in GENERATED
        generated |= (
            other.parent == ROOT / "docs" / "notebooks"
            and (ROOT / "examples" / "notebooks" / f"{other.stem}.ipynb").exists()
        )
        if generated and page.parent != ROOT:
            continue  # mkdocs checks them when it builds the site; a page outside docs/ is read without it
        if not other.exists() or (anchor and other.suffix == ".md" and anchor not in anchors(other)):
            wrong.append(target)
    assert not wrong


def test_a_false_link_is_seen(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Head\n\n[there](#head) [gone](gone.md) [no such part](#tail)\n")
    with pytest.raises(AssertionError) as seen:
        test_links_lead_somewhere(page)
    assert "gone.md" in str(seen.value) and "#tail" in str(seen.value) and "#head" not in str(seen.value)


def test_sources_name_pages_that_exist():
    """Comments and texts of the program that send a reader to docs/ or results/."""
    wrong = []
    for path in files():
        if path.suffix in TEXT and path != Path(__file__).resolve() and not path.is_relative_to(ROOT / "docs"):
            for page in re.findall(
                r"\b((?:docs|results)/[\w/.-]+\.md)", path.read_text(encoding="utf-8", errors="replace")
            ):
                if not (ROOT / page).exists() and Path(page).name not in GENERATED and not re.search("DATE|YYYY", page):
                    wrong.append(f"{name_of(path)}: {page}")
    assert not wrong


# --- Scenes -----------------------------------------------------------------------------------------------------------


def fraction(seconds):
    return f"1/{round(1 / seconds)} s" if abs(1 / seconds - round(1 / seconds)) < 1e-6 else f"{seconds:g} s"


def scene_row(scene):
    """The row that scenes/*/README.md begins with, made from scene.json."""
    step = fraction(scene["time_step"]) if "time_step" in scene else "the accuracy level's"
    return f"| {scene['resolution']:,} | {scene['frames']} | {fraction(scene['frame_time'])} | {step} |"


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in ROOT.glob("scenes/*/scene.json")))
def test_scene_pages_agree_with_the_scene(folder):
    text = (ROOT / "scenes" / folder / "README.md").read_text(encoding="utf-8")
    scene = json.loads((ROOT / "scenes" / folder / "scene.json").read_text(encoding="utf-8"))
    assert text.startswith(
        f"# {scene['name']}\n\n| triangles | frames | frame time | time step |\n|---|---|---|---|\n{scene_row(scene)}\n"
    )
    assert f"cama run {folder}" in text


def test_the_list_of_scenes_agrees():
    rows = re.findall(r"(?m)^\| `(\w+)` \| ([\d,]+) \|", (ROOT / "docs/guide/scenes.md").read_text(encoding="utf-8"))
    scenes = {
        path.parent.name: json.loads(path.read_text(encoding="utf-8")) for path in ROOT.glob("scenes/*/scene.json")
    }
    assert {name: count for name, count in rows} == {name: f"{scene['resolution']:,}" for name, scene in scenes.items()}


# --- Code and commands ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", [page for page in PAGES if python_blocks(page)], ids=name_of)
def test_python_blocks_name_what_is_there(page):
    source = "\n".join(block.text for block in python_blocks(page))
    compile(source, str(page), "exec")
    assert not [dotted for dotted in re.findall(r"(?<![\w.])cama(?:\.\w+)+", source) if not attribute_is_there(dotted)]


def named_commands(page):
    """Every command that the text of a page names, with the options that it names."""
    return [span[5:] for span in dict.fromkeys(spans(page)) if re.match(r"cama [a-z]", span)]


def command_of(words):
    """(command, its name, its arguments) of a command line; the command of a group where there is one."""
    name, *arguments = shlex.split(words)
    command = application().commands.get(name)
    if arguments and hasattr(command, "commands"):
        name, *arguments = arguments
        command = command.commands.get(name)
    return command, name, arguments


def parse(words):
    """Lets the application take a command line apart; raises `Refused` for what it does not accept."""
    command, name, arguments = command_of(words)
    if command is None:
        raise typer.BadParameter(f"no command {name}")
    if "--help" not in arguments and (arguments or name == "info"):
        given = command.make_context(name, list(arguments)).params
        for scene in given.get("scenes") or filter(None, [given.get("scene")]):
            if re.fullmatch(r"[a-z]+", scene) and scene not in cama.scenes():
                raise typer.BadParameter(f"no scene {scene}")


def unknown_options(words):
    """The options of a named command that it does not have."""
    command, name, arguments = command_of(words)
    if command is None:
        return [name]
    own = {flag for parameter in command.params for flag in (*parameter.opts, *parameter.secondary_opts)} | {"--help"}
    return [word for word in arguments if word.startswith("-") and word not in own]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page) or named_commands(page)], ids=name_of)
def test_commands_are_accepted(page):
    wrong = {words: unknown_options(words) for words in named_commands(page) if unknown_options(words)}
    for words in commands(page):
        try:
            parse(words)
        except (Refused, ValueError) as problem:
            wrong[words] = str(problem)
    assert not wrong


@pytest.mark.parametrize(
    "words",
    [
        "simulate drape",
        "run drape --no-such-option 3",
        "run drape --backend abacus",
        "run --frames 3",
        "run drape --frames few",
        "check drapes",
        "fabric weave cotton",
        "fabric test cotton --no-such-option 3",
    ],
)
def test_a_false_command_is_seen(words):
    with pytest.raises(Refused):
        parse(words)


# --- Generated pages --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def generate():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        yield importlib.import_module("generate")
    finally:
        sys.path.remove(str(ROOT / "docs"))


def test_options_page(generate):
    levels = {"preview": 0.1, "production": 1e-3, "paper": 1e-6}
    rows = [
        {
            "name": "tolerance",
            "type": "number",
            "words": [],
            "levels": levels,
            "range": "above 0",
            "unit": "",
            "set_by": "scene",
            "trades": "linear solve",
            "help": "Of the solve | relative.",
        },
        {
            "name": "paper.search",
            "type": "choice",
            "words": ["tree", "fronts"],
            "levels": {"preview": "tree", "production": "tree", "paper": "fronts"},
            "range": "",
            "unit": "",
            "set_by": "user",
            "trades": "",
            "help": "How pairs are found.",
        },
    ]
    user, paper = generate.options_page(rows).split("## Options that reproduce the paper")
    assert (
        '| <span id="tolerance">`tolerance`</span> | number, above 0 | `0.001` '
        "| `0.1`: `preview`; `1e-06`: `paper` | scene, user | linear solve |" in user
    )
    assert "Of the solve \\| relative. |" in user and "paper.search`</span>" not in user
    assert "| `tree`, `fronts` | `tree` | `fronts`: `paper` | user |" in paper


def test_report_page(generate):
    page = generate.report_page(
        [{"name": "contacts", "type": "integer", "unit": "", "adds": "max", "help": "In the matrix."}]
    )
    assert '| <span id="contacts">`contacts`</span> | integer |  | the largest | In the matrix. |' in page


@pytest.mark.skipif(not hasattr(cama._core, "option_table"), reason="the compiled module has no tables yet")
def test_options_page_is_whole(generate):
    page = generate.options_page(cama._core.option_table())
    assert all(f'<span id="{row["name"]}">' in page for row in cama._core.option_table())
    assert all(row["help"] and set(row["levels"]) == set(cama.accuracy_levels()) for row in cama._core.option_table())
    report = generate.report_page(cama._core.report_table())
    assert all(f"`{row['name']}`" in report for row in cama._core.report_table())


def test_scene_file_page_has_every_key(generate):
    schema = json.loads((ROOT / "scenes" / "schema.json").read_text(encoding="utf-8"))
    page = generate.scene_file_page(schema)

    def keys(node):
        if isinstance(node, dict):
            properties = node.get("properties")
            yield from properties if isinstance(properties, dict) else ()
            for value in node.values():
                yield from keys(value)
        elif isinstance(node, list):
            for value in node:
                yield from keys(value)

    assert not [key for key in set(keys(schema)) if f"| `{key}` |" not in page]
