# SPDX-License-Identifier: Apache-2.0
"""A value that is hardly meant, and the warnings that are made of it."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable
from dataclasses import dataclass

PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__))) + os.sep


class PlausibilityWarning(UserWarning):
    """A scene can be simulated, but a value in it is hardly meant: in other units than SI, for example.

    `cama.Simulation` gives these warnings at the caller's line, and the command `cama run` prints them. Python's own
    filters silence them: `warnings.simplefilter("ignore", cama.PlausibilityWarning)`; with "error" in place of "ignore"
    they become exceptions.
    """

    __module__ = "cama"


@dataclass(frozen=True)
class Finding:
    """One value that is hardly meant."""

    kind: str  #: "size", "density", ...: findings of one kind have one cause
    object: str  #: "cloth 'shirt'", "the scene"
    element: str  #: "vertices", "material.density", "time_step"
    seen: str  #: what is there
    remedy: str

    def __str__(self) -> str:
        return f"{self.object}: {self.element}: {self.seen}; {self.remedy}"


def texts(found: Iterable[Finding]) -> list[str]:
    """Returns one line for each kind of finding: the first one's, with the number of others like it."""
    kinds: dict[str, list[Finding]] = {}
    for finding in found:
        kinds.setdefault(finding.kind, []).append(finding)
    lines = []
    for first, *others in kinds.values():
        objects = len({finding.object for finding in others} - {first.object})
        more = f" (and {objects} {'object' if objects == 1 else 'objects'} like it)" if objects else ""
        lines.append(f"{first.object}{more}: {first.element}: {first.seen}; {first.remedy}")
    return lines


def warn(found: Iterable[Finding]) -> None:
    """Gives a PlausibilityWarning for each kind of finding, at the line outside the package that led here."""
    lines = texts(found)
    if not lines:
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and os.path.abspath(frame.f_code.co_filename).startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, PlausibilityWarning, stacklevel=level)


def number(value: float) -> str:
    """A value as findings write it."""
    return f"{value:.4g}"
