# SPDX-License-Identifier: Apache-2.0
"""Makes what the Python package takes from the tables of the compiled module: generate.py MODULE_FOLDER SCHEMA OUT.

OUT/_options.pyi: types of all options and of the report of a step, for editors and type checkers.
OUT/schema.json: the schema of scene.json with the options that a scene may set.
"""

import json
import sys
from pathlib import Path

TYPES = {"boolean": "bool", "integer": "int", "number": "float", "text": "str"}
OWN = ("backend", "device", "threads", "accuracy", "precision")  # parameters of Simulation, by name


def literal(words):
    return "Literal[" + ", ".join(f'"{word}"' for word in words) + "]"


def type_of(row):
    return literal(row["words"]) if row["type"] == "choice" else TYPES[row["type"]]


def typed_dict(name, doc, fields, total=False):
    head = f"class {name}(TypedDict{'' if total else ', total=False'}):\n" + f'    """{doc}"""\n\n'
    return head + "".join(f"    {field}: {kind}\n" for field, kind in fields)


def options_stub(core):
    table = core.option_table()
    words = {row["name"]: row["words"] for row in table}
    single = [(row["name"], type_of(row)) for row in table if "." not in row["name"] and row["name"] not in OWN]
    paper = [(row["name"].split(".")[1], type_of(row)) for row in table if row["name"].startswith("paper.")]
    backends = ["auto", *(backend["name"] for backend in core.list_backends())]
    return "\n".join(
        [
            "# Made from the table of options when cama is built.",
            "from typing import Literal, TypedDict",
            "",
            f"AccuracyLevel = {literal(words['accuracy'])}",
            f"BackendName = {literal(backends)}",
            f"Precision = {literal(words['precision'])}",
            "",
            typed_dict("PaperOptions", "Options that serve the reproduction of the paper alone.", paper),
            typed_dict("Overrides", "Options of a Simulation, as keywords.", [*single, ("paper", "PaperOptions")]),
            typed_dict(
                "StepReport",
                "What a step reports.",
                [(row["name"], TYPES[row["type"]]) for row in core.report_table()],
                total=True,
            ),
        ]
    )


def schema_of(row):
    kinds = {"boolean": "boolean", "integer": "integer", "number": "number", "text": "string"}
    kind = {"enum": row["words"]} if row["type"] == "choice" else {"type": kinds[row["type"]]}
    unit = f" [{row['unit']}]" if row["unit"] else ""
    return {**kind, "description": row["help"] + unit}


def scene_schema(core, schema):
    """The schema with `options` as the table has them."""
    rows = [row for row in core.option_table() if row["set_by"] == "scene"]
    paper = {row["name"].split(".")[1]: schema_of(row) for row in rows if row["name"].startswith("paper.")}
    single = {row["name"]: schema_of(row) for row in rows if "." not in row["name"]}
    group = {"type": "object", "properties": paper, "additionalProperties": False}
    group["description"] = "Options that serve the reproduction of the paper alone."
    options = schema["properties"]["options"]
    options["properties"] = {**single, "paper": group}
    options["additionalProperties"] = False
    return schema


def main(folder, schema, out):
    sys.path.insert(0, folder)
    import _core

    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    (out / "_options.pyi").write_text(options_stub(_core))
    whole = scene_schema(_core, json.loads(Path(schema).read_text()))
    (out / "schema.json").write_text(json.dumps(whole, indent=1) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
