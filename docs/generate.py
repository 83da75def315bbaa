# SPDX-License-Identifier: Apache-2.0
"""Pages of the site that are generated. mkdocs loads this file as a hook (mkdocs.yml): they are as new as the build.

    python docs/generate.py FOLDER        # writes the same pages as files

| page | made from |
|---|---|
| reference/options.md, reference/report.md | the compiled module: `cama._core.option_table()`, `report_table()` |
| reference/command-line.md | help texts of the command `cama`, by Typer |
| reference/scene-file.md | scenes/schema.json |
| reference/cpp-api.md | comments of the public headers, by Doxygen (cpp_reference.py) |

They need the package `cama` in the environment (all but scene-file.md and cpp-api.md) and the program `doxygen`.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import cpp_reference  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
LEVEL = "production"  # whose values are called defaults
ADDS = {"sum": "their sum", "last": "the last one's", "max": "the largest"}


def cell(text):
    """Text inside a cell of a Markdown table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def table(header, rows):
    """Lines of a Markdown table."""
    return [
        "| " + " | ".join(header) + " |",
        "|" + "---|" * len(header),
        *("| " + " | ".join(map(cell, row)) + " |" for row in rows),
    ]


def literal(value):
    """A value as it is written in scene.json and on the command line."""
    if isinstance(value, bool):
        return "`true`" if value else "`false`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


# --- Options and report -----------------------------------------------------------------------------------------------


def option_row(option):
    values = ", ".join(f"`{word}`" for word in option["words"]) or ", ".join(
        filter(None, (option["type"], option["unit"], option["range"]))
    )
    levels = option["levels"]
    default = levels.get(LEVEL)
    others = {}
    for level, value in levels.items():
        if value != default:
            others.setdefault(literal(value), []).append(f"`{level}`")
    set_by = "scene, user" if option["set_by"] == "scene" else "user"
    return (
        f'<span id="{option["name"]}">`{option["name"]}`</span>',
        values,
        literal(default),
        "; ".join(f"{value}: {', '.join(names)}" for value, names in others.items()),
        set_by,
        option["trades"],
        option["help"],
    )


def options_page(rows):
    """Markdown of the table of options; rows as of `_core.option_table()`."""
    header = ("option", "value", "default", "other levels", "set by", "trades", "meaning")
    user = [option_row(row) for row in rows if not row["name"].startswith("paper.")]
    paper = [option_row(row) for row in rows if row["name"].startswith("paper.")]
    return "\n".join(
        [
            "# Options",
            "",
            "An option says how to compute; what to compute is the scene. This page is generated from the library.",
            "",
            "- *C++*: members of `cama::Options`, those of the paper in `Options::paper`.",
            '- *Python*: keywords, `cama.Simulation(scene, tolerance=1e-4, paper={"search": "fronts"})`.',
            "- *Command line*: `--set NAME=VALUE`, for example `--set paper.search=fronts`. `--backend`, `--precision`,"
            " `--accuracy`, `--time-step` and some others have an option of their own.",
            '- *scene.json*: `"options": {"tolerance": 1e-4, "paper": {"search": "fronts"}}`.',
            "",
            f"*Default* is the value at the accuracy level `{LEVEL}`; *other levels* lists those that have another."
            " The level comes first, then the scene's `options`, then what the user gives: the later one wins. A level"
            " that the user names sets the scene's `options` aside. An option that only the user may set is refused in"
            " scene.json. `cama explain SCENE` lists every value and who chose it.",
            "",
            *table(header, user),
            "",
            "## Options that reproduce the paper",
            "",
            "The level `paper` sets these; they exist to compare with the method as Tang et al. 2016 describe it.",
            "",
            *table(header, paper),
            "",
        ]
    )


def report_page(rows):
    """Markdown of the table of a step's report; rows as of `_core.report_table()`."""
    return "\n".join(
        [
            "# Report of a step",
            "",
            "`Simulation.report` (Python: a dict; C++: `cama::StepReport`) says what the last step did. This page is"
            " generated from the library's table. A step that is divided, because obstacles move far or because a solve"
            " failed, has one report: *pieces* says how the values of its pieces are joined.",
            "",
            *table(
                ("field", "type", "unit", "pieces", "meaning"),
                [
                    (
                        f'<span id="{row["name"]}">`{row["name"]}`</span>',
                        row["type"],
                        row["unit"],
                        ADDS.get(row["adds"], row["adds"]),
                        row["help"],
                    )
                    for row in rows
                ],
            ),
            "",
        ]
    )


def of_module(name):
    """A table of the compiled module; a plain message where it is missing."""
    try:
        from cama import _core

        return getattr(_core, name)()
    except (ImportError, AttributeError) as problem:
        raise SystemExit(
            f"docs/generate.py: the options and the report are read from the installed package cama: {problem}"
        ) from None


# --- Command line -----------------------------------------------------------------------------------------------------


def command_line_page():
    """Markdown of all commands, written by Typer from their help texts."""
    words = [sys.executable, "-m", "typer", "cama.cli.main", "utils", "docs", "--name", "cama"]
    made = subprocess.run(words, capture_output=True, text=True)
    if made.returncode:
        raise SystemExit(f"docs/generate.py: Typer could not describe the commands: {made.stderr.strip()}")
    lines = made.stdout.strip().splitlines()
    return "\n".join(
        [
            "# Command line",
            "",
            "Generated from `cama --help`. [The guide](../guide/command-line.md) shows how the commands are used.",
            *lines[1:],
            "",
        ]
    )


# --- scene.json -------------------------------------------------------------------------------------------------------


def type_text(node):
    """What a value is, in a few words."""
    if "$ref" in node:
        name = node["$ref"].split("/")[-1]
        return f"[{name}](#{name})"
    if "const" in node:
        return f'`"{node["const"]}"`'
    if "enum" in node:
        return ", ".join(f'`"{word}"`' for word in node["enum"])
    if "anyOf" in node:
        return " or ".join(dict.fromkeys(type_text(choice) for choice in node["anyOf"]))
    kind = node.get("type", "")
    if isinstance(kind, list):
        return " or ".join(kind)
    if kind == "array":
        count, item = node.get("minItems"), type_text(node.get("items", {}))
        many = f"{item}s" if item in ("number", "integer", "string", "object") else item
        return f"{count} {many}" if count and count == node.get("maxItems") else f"list of {many}"
    return kind


def bounds_text(node):
    """Default and range of a value."""
    parts = [f"default `{json.dumps(node['default'])}`"] if "default" in node else []
    for key, word in (
        ("minimum", "at least"),
        ("exclusiveMinimum", "above"),
        ("maximum", "at most"),
        ("exclusiveMaximum", "below"),
    ):
        if key in node:
            parts.append(f"{word} {node[key]:g}")
    return ", ".join(parts)


def parts_of(node):
    """The objects inside a node that have keys of their own: the node itself, its items, its alternatives."""
    if "properties" in node:
        yield node
    if "items" in node:
        yield from parts_of(node["items"])
    for choice in node.get("anyOf", ()):
        yield from parts_of(choice)


def object_lines(title, node, path, depth):
    """A section for an object: its keys as a table, then a section for each key that holds an object."""
    required, below, rows = node.get("required", ()), [], []
    for key, value in node["properties"].items():
        needed = "required" if key in required else ""
        rows.append(
            (
                f"`{key}`",
                type_text(value),
                ", ".join(filter(None, (needed, bounds_text(value)))),
                value.get("description", ""),
            )
        )
        below += [(f"{path}.{key}" if path else key, part) for part in parts_of(value)]
    lines = [
        f"{'#' * min(depth, 6)} {title}",
        "",
        node.get("description", ""),
        "",
        *table(("key", "type", "default and range", "meaning"), rows),
        "",
    ]
    for name, part in below:
        lines += object_lines(f"`{name}`", part, name, depth + 1 if depth < 3 else 3)
    return lines


def scene_file_page(schema):
    """Markdown of the scene file's JSON schema."""
    lines = [
        "# Scene file",
        "",
        "The keys of scene.json, generated from `scenes/schema.json`; editors that know `$schema` complete from the"
        " same file. [The guide](../guide/scenes.md) explains what they mean together. Comments are allowed, keys that"
        " start with `$` or `_` are remarks, and any other key that is not listed here is an error. Lengths are in"
        " metres, masses in kilograms, times in seconds.",
        "",
    ]
    lines += object_lines("The file", {**schema, "description": schema.get("description", "")}, "", 2)
    for name, node in schema["$defs"].items():
        lines += [f'<span id="{name}"></span>', ""]
        parts = list(parts_of(node))
        if len(parts) == 1:
            lines += object_lines(name.capitalize(), parts[0], name, 2)
        else:
            lines += [f"## {name.capitalize()}", "", node.get("description", ""), ""]
            for part in parts:
                lines += object_lines(part.get("description", name).rstrip("."), {**part, "description": ""}, name, 3)
    return "\n".join(lines)


# --- All pages --------------------------------------------------------------------------------------------------------


def pages():
    """{path below docs/: Markdown}."""
    return {
        "reference/options.md": options_page(of_module("option_table")),
        "reference/report.md": report_page(of_module("report_table")),
        "reference/command-line.md": command_line_page(),
        "reference/scene-file.md": scene_file_page(
            json.loads((ROOT / "scenes/schema.json").read_text(encoding="utf-8"))
        ),
        "reference/cpp-api.md": cpp_reference.page(ROOT / "libcama/include"),
    }


def version():
    """The project's version, as CMakeLists.txt has it."""
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.search(r"project\(cama VERSION ([0-9.]+)", text)[1]


def on_config(config):
    """mkdocs: every page says of which version it is."""
    config.site_name = f"cama {version()}"
    return config


def on_files(files, config):
    """mkdocs: adds the generated pages to those of the folder docs."""
    from mkdocs.structure.files import File

    for path, text in pages().items():
        files.append(File.generated(config, path, content=text))
    return files


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    for path, text in pages().items():
        target = Path(sys.argv[1]) / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
        print(target)
