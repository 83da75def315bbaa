# SPDX-License-Identifier: Apache-2.0
"""Names that no file can have are errors that say so, wherever a file is named."""

import pytest
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.io.exporting import export
from cama.io.recording import Recording

LONG = "a" * 300  # Linux takes 255 bytes
CALLS = {
    "an OBJ of cloth": lambda: cama.Scene().add_cloth(f"{LONG}.obj"),
    "a PLY of cloth": lambda: cama.Scene().add_cloth(f"{LONG}.ply"),
    "a character": lambda: cama.Scene().add_obstacle(f"{LONG}.glb"),
    "a USD file": lambda: cama.Scene().add_obstacle(f"{LONG}.usda"),
    "a scene": lambda: cama.Scene.load(f"{LONG}.json"),
    "a folder": lambda: cama.Simulation(LONG),
    "a mesh of a scene": lambda: cama.Scene.parse({"cloth": [{"file": f"{LONG}.obj"}]}),
    "a character of a scene": lambda: cama.Scene.parse({"obstacles": [{"character": {"file": f"{LONG}.gltf"}}]}),
    "a recording": lambda: Recording(LONG),
    "an export": lambda: export(LONG, "obj"),
    "a pattern": lambda: cama.SewingPattern.load(f"{LONG}.json"),
}


@pytest.mark.parametrize("what", CALLS)
def test_a_name_that_is_too_long(what):
    with pytest.raises(cama.FileError, match="File name too long") as problem:
        CALLS[what]()
    assert "aaa" in str(problem.value) and len(str(problem.value)) < 200


@pytest.mark.parametrize("words", ["run", "check", "render", "explain", "view", "export --to obj", "dress"])
def test_commands_say_it_in_a_line(words):
    command, *options = words.split()
    done = CliRunner().invoke(app, [command, LONG, *options])
    assert done.exit_code == 2 and not isinstance(done.exception, OSError)
    assert "Error" in done.output and "Traceback" not in done.output
