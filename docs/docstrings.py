# SPDX-License-Identifier: Apache-2.0
"""An extension of griffe, which reads the package for mkdocstrings: sections of docstrings become lists in Markdown.

griffe's own parser knows one name and one type a line; docstrings here also write "Raises: FileError, SceneError".
"""

import re

import griffe

TITLES = {"Args": "Arguments", "Raises": "Raises", "Returns": "Returns", "Yields": "Yields"}
SECTION = re.compile(rf"^({'|'.join(TITLES)}):\n((?:(?: {{4}}.*)?(?:\n|\Z))+)", re.M)
NAMES = re.compile(r"^(\w+(?:, \w+)*): ")


def listed(section):
    """Markdown of a section: a list item for every line that is indented once, with the lines below it."""
    items = []
    for line in section[2].splitlines():
        if re.match(r" {4}\S", line):
            items.append(line.strip())
        elif line.strip():
            items[-1] += f" {line.strip()}"
    lines = [NAMES.sub(lambda names: f"`{names[1]}`: ".replace(", ", "`, `"), item) for item in items]
    return "\n".join([f"**{TITLES[section[1]]}**", "", *(f"- {line}" for line in lines), "", ""])


def markdown(docstring):
    """A docstring, as `inspect.cleandoc` gives it, with its sections as lists."""
    return SECTION.sub(listed, docstring).rstrip()


class Sections(griffe.Extension):
    """Applies `markdown` to every docstring of the package."""

    def on_object(self, *, obj, **_):
        if obj.docstring and obj.docstring.value:
            obj.docstring.value = markdown(obj.docstring.value)
