# SPDX-License-Identifier: Apache-2.0
"""checkpoint.h5: all that later steps of a run depend on, beside its scene and options.

What the state carries from step to step: the group `vectors` [vertices, 3] (position, m, velocity, m/s, ...) and the
attributes of the group `numbers` (time, s, ...). The group `driving`: tables of numbers of what was set between steps
(cama/checkpoint.hpp). Datasets tangled [pairs, 2] vertices and let_go [pairs, 2] vertex and object, that may pass
each other; friction_pair [contacts, 3] (0, vertex, face or 1, edge, edge) and friction_force [contacts, 3], N: the
friction that each contact had; matching_order [rows] and, for every level, matching_parent_L [nodes] and
matching_start_L [blocks + 1]: the preconditioner's blocks (docs/theory/linear-solve.md); scene_parts, JSON: digests
of all that the scene says, part by part. Attributes: `format`; scene (of meshes and masses, 16 hexadecimal digits),
step, time_step, released, matching_step, matching_terms, matching_first_iterations, matching_last_iterations; for
people and for `cama run --resume`: scene_name, options (JSON), cama_version. Checkpoints of `cama run` also have the
group `run`: what its summary has counted so far. Behind the HDF5 file the digest of all before it follows. Nothing in
it is executed; every value is checked before it is used.

A run keeps two of them, so that one is there whatever happens while the next is written.
"""

import contextlib
import hashlib
import io
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Optional

from .._core import __version__
from ..arrays import integers, reals
from ..errors import FileError, SceneError
from ..types import PathLike
from . import reading
from .journal import sync_folder

NAME = "checkpoint.h5"
BEFORE = "checkpoint-before.h5"  # the one before
FORMAT = "cama checkpoint 4"
SEAL = b"cama sha256:"  # before the digest, behind what HDF5 reads
EARLIER = ("cama checkpoint 3", "cama checkpoint 2")  # without friction; without `driving`
PAIRS = ("tangled", "let_go")
FRICTION = ("friction_pair", "friction_force")
INTEGERS = (
    "step",
    "matching_step",
    "matching_terms",
    "matching_first_iterations",
    "matching_last_iterations",
)
TIMES = ("time_step", "released")
EXTREMES = ("largest ", "smallest ", "min_", "max_", "last gap")  # of `run`: infinite where there was nothing yet
MOST_LEVELS = 16
NOT_OF_STEPS = (
    "name",
    "description",
    "frames",
    "frame_time",
    "time_step",
    "options",
)  # in a scene; the time step is among the options
MOST_PARTS = 100  # of one kind that are told apart


def options_of(simulation: Any) -> dict[str, Any]:
    """Returns the options that the bits of later steps depend on: all but those of where it is computed."""
    options = {k: v for k, v in simulation.options.items() if k not in ("backend", "device", "threads", "audit")}
    return {**options, "frame_time": simulation.scene.seconds_per_frame} if simulation.error else options


def parts_of(scene: Any) -> dict[str, str]:
    """Returns {part: digest} of a scene, for example {"gravity": ..., "obstacle[ball].friction": ...}."""

    def digest(value: object) -> str:
        return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]

    found = {}
    for key, value in json.loads(scene.to_json()).items():
        if key in NOT_OF_STEPS:
            continue
        if isinstance(value, list) and len(value) <= MOST_PARTS and all(isinstance(entry, dict) for entry in value):
            for number, entry in enumerate(value):
                found.update(
                    {f"{key}[{entry.get('name', number)}].{field}": digest(inner) for field, inner in entry.items()}
                )
        else:
            found[key] = digest(value)
    return found


class SceneChanged(SceneError):
    """The scene differs from the checkpoint's in more than can be left to chance."""

    __module__ = "cama"

    def __init__(self, changed: list[str], remedy: str) -> None:
        self.changed = changed  #: names of the parts that differ
        super().__init__(
            f"checkpoint: is of a scene that differs in {', '.join(changed[:8])}{' and more' * (len(changed) > 8)}; "
            + remedy
        )


def check_scene(simulation: Any, parts: Optional[dict[str, str]]) -> None:
    """Raises SceneError that names the parts in which the scene differs from the checkpoint's (None: not known)."""
    own = simulation.scene_parts()
    changed = (
        sorted(name for name in own.keys() | parts.keys() if own.get(name) != parts.get(name))
        if parts is not None
        else []
    )
    if changed:
        raise SceneChanged(
            changed,
            "load the scene that it was taken of, start anew, or let load_checkpoint(path, changed_scene=True) go on "
            "with this one",
        )


def write(path: PathLike, simulation: Any, run: Optional[Mapping[str, Any]] = None, before: str = "") -> None:
    """Writes the file completely or not at all.

    Args:
        path: The file.
        simulation: The Simulation.
        run: What the summary of a run has counted (`Summary.state`), to be read by `read_run`.
        before: Name that a file of this path is kept by, in place of the one of that name.

    Raises:
        FileError
    """
    import h5py  # on first use: `import cama` comes without it

    path, fields = Path(path), simulation._core.checkpoint()
    partial, whole = path.with_name(path.name + ".partial"), io.BytesIO()
    with h5py.File(whole, "w") as file:  # in memory: HDF5 itself does not survive a full disk
        file.attrs.update(
            {
                "format": FORMAT,
                "scene": f"{fields['scene']:016x}",
                "scene_name": simulation.scene.name,
                "cama_version": __version__,
                "options": json.dumps(options_of(simulation)),
            }
        )
        file["scene_parts"] = json.dumps(simulation.scene_parts())  # no attribute: those end at 64 KiB
        file.attrs.update({name: fields[name] for name in INTEGERS + TIMES})
        file.create_group("numbers").attrs.update(fields["numbers"])
        vectors = file.create_group("vectors")
        for name, values in fields["vectors"].items():
            vectors[name] = values
        driving = file.create_group("driving")
        for name, values in fields["driving"].items():
            driving[name] = values
        for name in (*PAIRS, *FRICTION, "matching_order"):
            file[name] = fields[name]
        for number, (parent, start) in enumerate(fields["matching_levels"]):
            file[f"matching_parent_{number}"], file[f"matching_start_{number}"] = parent, start
        if run is not None:
            group = file.create_group("run")
            group.attrs.update(run["numbers"])
            group.create_group("stages").attrs.update(run["stages"])
            group["milliseconds"] = run["milliseconds"]
    try:
        with open(partial, "wb") as file:
            file.write(whole.getbuffer())
            file.write(SEAL + hashlib.sha256(whole.getbuffer()).digest())
            file.flush()
            os.fsync(file.fileno())
        if before and path.exists():
            os.replace(path, path.with_name(before))
        os.replace(partial, path)
        sync_folder(path.parent)
    except OSError as problem:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise FileError(f"{path}: writing failed ({problem})") from None


def _is_sealed(path: Path) -> bool:
    """Whether a file ends with the digest of all before it, so that no bit has changed since it was written."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    body, seal = content[: -len(SEAL) - 32], content[-len(SEAL) - 32 :]
    return seal == SEAL + hashlib.sha256(body).digest()


def read(path: PathLike) -> tuple[dict[str, Any], dict[str, Any], Optional[dict[str, str]]]:
    """Returns the fields for the compiled module, the options and the parts of the scene (or None) of a checkpoint.

    Shapes and types are checked here, everything else by Simulation. Raises FileError.
    """
    import h5py

    path = Path(path)
    path = path / NAME if path.is_dir() else path
    if not path.is_file():
        raise FileError(f"{path}: no such file; `cama run` and Simulation.save_checkpoint write it")
    if not _is_sealed(path):
        reading.check_hdf5(path)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") not in (FORMAT, *EARLIER):
                raise ValueError(f"its format is {file.attrs.get('format')!r}, not {FORMAT!r}")
            fields: dict[str, Any] = {name: int(file.attrs[name]) for name in INTEGERS}
            if any(not -(2**31) <= value < 2**31 for value in fields.values()):
                raise ValueError("a count is beyond 32 bits")
            fields.update({name: float(file.attrs[name]) for name in TIMES}, scene=int(file.attrs["scene"], 16) % 2**64)
            fields["numbers"] = {name: float(value) for name, value in file["numbers"].attrs.items()}
            fields["vectors"] = {
                name: reals(name, values[()], (None, 3), finite=False) for name, values in file["vectors"].items()
            }
            fields["driving"] = {
                name: reals(f"driving: {name}", values[()], (None,))
                for name, values in (file["driving"].items() if "driving" in file else ())
            }
            fields.update({name: integers(name, file[name][()], (None, 2)) for name in PAIRS})
            earlier: list[tuple[int, int, int]] = []
            contacts, forces = (file[name][()] if name in file else earlier for name in FRICTION)
            fields["friction_pair"] = integers("friction_pair", contacts, (None, 3))
            fields["friction_force"] = reals("friction_force", forces, (None, 3), finite=False)
            fields["matching_order"] = integers("matching_order", file["matching_order"][()], (None,))
            count = sum(f"matching_parent_{number}" in file for number in range(MOST_LEVELS))
            fields["matching_levels"] = [
                tuple(
                    integers(name, file[name][()], (None,)) for name in (f"matching_parent_{n}", f"matching_start_{n}")
                )
                for n in range(count)
            ]
            options = json.loads(file.attrs["options"])
            parts = json.loads(file["scene_parts"][()]) if "scene_parts" in file else None
            if not isinstance(options, dict) or not isinstance(parts, (dict, type(None))):
                raise ValueError("its options or parts of the scene are not a table")
    except reading.DAMAGED as problem:  # ArrayError is a ValueError
        raise FileError(f"{path}: not a checkpoint of cama: {problem}") from None
    return fields, options, parts


def read_run(path: Path) -> Optional[dict[str, Any]]:
    """Returns the `run` of `write`, or None where the file has none. Raises FileError."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if "run" not in file:
                return None
            group = file["run"]
            numbers = {name: float(value) for name, value in group.attrs.items()}
            stages = {name: float(value) for name, value in group["stages"].attrs.items()}
            milliseconds = reals("milliseconds", group["milliseconds"][()], (None,))
            for name, value in {**numbers, **stages}.items():
                if math.isnan(value) or (math.isinf(value) and not name.startswith(EXTREMES)):
                    raise ValueError(f"{name} is {value}")
            if not numbers["frames"] >= 1:
                raise ValueError(f"frames is {numbers['frames']}")
            return {"numbers": numbers, "stages": stages, "milliseconds": milliseconds}
    except reading.DAMAGED as problem:
        raise FileError(f"{path}: not a checkpoint of cama: {problem}") from None


def differences(simulation: Any, options: Mapping[str, Any]) -> list[str]:
    """Returns texts such as "tolerance 0.001 instead of 0.01" for all options that differ from the checkpoint's."""
    own = options_of(simulation)
    return [
        f"{name} {own.get(name)} instead of {options.get(name)}"
        for name in sorted(own.keys() | options.keys())
        if own.get(name) != options.get(name)
    ]
