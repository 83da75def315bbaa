# SPDX-License-Identifier: Apache-2.0
"""The documentation as the tests read it: pages, their blocks, and the commands and Python programs in these."""

import re
import textwrap
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("scenes/*/README.md"),
    ]
)
SHELL = "sh"


class Block(NamedTuple):
    """A fenced block of a page, or an indented one, which is taken for commands of a shell."""

    page: Path
    line: int  # of its first line of text
    kind: str  # the language behind the fence
    text: str


def name_of(page):
    return str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name


FENCED = r"^(?P<fence> *```)(?P<kind>\w*)\n(?P<fenced>.*?)^(?P=fence)$"
INDENTED = r"(?<=\n\n)(?P<indented>(?: {4}[^\n]*\n)+)"
BLOCK = re.compile(f"{FENCED}|{INDENTED}", re.M | re.S)


def blocks(page):
    """All blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        part = "indented" if found["indented"] else "fenced"
        kind = SHELL if found["indented"] else found["kind"]
        yield Block(page, text.count("\n", 0, found.start(part)) + 1, kind, textwrap.dedent(found[part]))


def without_blocks(text):
    """Markdown without blocks and HTML comments."""
    return re.sub(r"(?s)<!--.*?-->", "", BLOCK.sub("", text))


def without_remark(words):
    return re.sub(r"(^|\s+)#.*", "", words).strip()


def typed(block):
    """(line, command) for every command of a block; a backslash at the end of a line continues it."""
    lines = block.text.splitlines()
    at = 0
    while at < len(lines):
        first, words = at, lines[at]
        while words.endswith("\\") and at + 1 < len(lines):
            at += 1
            words = words[:-1] + " " + lines[at].strip()
        at += 1
        if without_remark(words):
            yield block.line + first, without_remark(words)


def commands(page):
    """The arguments of every command `cama` of a page, without variables in front; none with a part left out."""
    lines = [words for block in blocks(page) if block.kind == SHELL for _, words in typed(block)]
    found = [re.fullmatch(r"(?:[A-Z_]+=\S+ )*(?:\S*/)?cama ([a-z].*)", words) for words in lines]
    return [words for words in dict.fromkeys(m[1] for m in found if m) if not re.search(r"[\[…]", words)]


def python_blocks(page):
    return [block for block in blocks(page) if block.kind == "python"]


def same(value, text, line):
    """What `expression   # -> value` says."""
    assert " ".join(repr(value).split()) == text, f"{line.strip()!r} is {value!r}"


def checked(block):
    """The program of a block, on the lines that it has in the page; `expression   # -> value` is checked by `same`."""
    lines = []
    for line in block.text.splitlines():
        said = re.fullmatch(r"(\S.*?)\s*# -> (.*)", line)
        lines.append(f"_same({said[1]}, {said[2]!r}, {line!r})" if said else line)
    return compile("\n" * (block.line - 1) + "\n".join(lines), name_of(block.page), "exec")
