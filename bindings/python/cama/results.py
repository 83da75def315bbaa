# SPDX-License-Identifier: Apache-2.0
"""What a simulation returns: frames, wrenches, gas, contacts, times of stages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .types import Reals

if TYPE_CHECKING:
    from ._options import StepReport

CONTACT = np.dtype(
    [
        ("vertices", np.int32, 4),
        ("weights", np.float64, 4),
        ("normal", np.float64, 3),
        ("distance", np.float64),
        ("kind", np.int32),
    ]
)
FORCES = [("normal_force", np.float64), ("tangential_force", np.float64, 3)]  # with the option forces


@dataclass
class Frame:
    """One recorded moment of a simulation."""

    index: int  #: frames since the start, 1 for the first that was computed
    time: float  #: s
    positions: Reals = field(repr=False)  #: [vertices, 3] m, cloths then obstacles
    contacts: int  #: contacts in the last step's matrix
    intersections: int  #: edges through faces, -1 where not audited
    report: StepReport = field(repr=False)  #: of the last step, see `Simulation.report`


@dataclass(frozen=True)
class GasState:
    """The gas that a cloth encloses, as `Simulation.gas` has it."""

    volume: float  #: m^3
    pressure: float  #: above that outside, Pa
    amount: float  #: absolute pressure times volume, J
    ambient: float  #: absolute pressure outside, Pa


@dataclass(frozen=True)
class Wrench:
    """What cloth exerts, as `Simulation.force_on` returns it; of `Worlds.force_on` each is [worlds, 3]."""

    force: Reals  #: [3] N, mean over the last step
    torque: Reals  #: [3] N m, mean over the last step
    impulse: Reals  #: [3] N s, over the last call of `step`
    angular_impulse: Reals  #: [3] N m s, over the last call of `step`


def contact_rows(columns: Sequence[npt.NDArray[Any]], forces: bool) -> npt.NDArray[np.void]:
    """Returns contacts as a structured array, as `Simulation.contacts`."""
    rows = np.empty(len(columns[0]), CONTACT.descr + FORCES if forces else CONTACT)
    for name, column in zip(rows.dtype.names or (), columns):
        rows[name] = column
    return rows


def stage_paths(rows: Iterable[tuple[str, int, float]]) -> dict[str, float]:
    """Turns rows (name, depth, ms) in the order of the pipeline into {"outer/inner": ms}.

    The pipeline that surrounds all stages is left out. Equal names beside each other are added.
    """
    rows = list(rows)
    if len(rows) > 1 and sum(depth == 0 for _, depth, _ in rows) == 1:
        rows = [(name, depth - 1, milliseconds) for name, depth, milliseconds in rows[1:]]
    result: dict[str, float] = {}
    path: list[str] = []
    for name, depth, milliseconds in rows:
        path[depth:] = [name]
        key = "/".join(path)
        result[key] = result.get(key, 0.0) + milliseconds
    return result
