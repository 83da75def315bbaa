# SPDX-License-Identifier: Apache-2.0
"""Every kernel waits for the launch before it (AWAIT_LAUNCHES in dialect/lang.h) before it reads what that one may have
written, and before it writes. FOR_EACH and FOR_EACH_TEAM wait. waits.py KERNELS: the folder of the kernels."""

import re
import sys
from pathlib import Path

HEAD = re.compile(r"^KERNEL(?:_OF\([^)]*\))?\s+(\w+)\(([^{]*)\)\s*\n\{(.*?)^\}", re.M | re.S)
LOOP = re.compile(r"\bFOR_EACH(_UNEVEN|_LISTED|_LANES)?(_TEAM)?(_EARLY)?\(")


def faults(text):
    """What is wrong, a sentence for each kernel of a header, and the number of kernels."""
    wrong, count = [], 0
    for name, parameters, body in HEAD.findall(re.sub(r"/\*.*?\*/", "", text, flags=re.S)):
        count += 1
        body = re.sub(r"TEAM_LOCAL\w*\([^;]*;", "", body)
        written = re.findall(r"GLOBAL (?!const)\w+ \*\s*(?:RESTRICT )?(\w+)", parameters)
        pointers = re.findall(r"\*\s*(?:RESTRICT )?(\w+)", parameters)
        loop = LOOP.search(body)
        if not loop:
            wrong.append(f"{name} has no FOR_EACH")
            continue
        before = body[: loop.start()].split("AWAIT_LAUNCHES")[0]
        before = re.sub(r"if \(!BEGINS_EARLY &&[^;]*;", "", before)
        if any(re.search(rf"\b{p}\b", before) for p in pointers):
            wrong.append(f"{name} reads memory before it waits")
        if not loop.group(3):
            continue
        early, wait, _ = body[loop.end() :].partition("AWAIT_LAUNCHES")
        if not wait:
            wrong.append(f"{name} does not wait")
        if any(re.search(rf"\b{p}\b", early) for p in written):
            wrong.append(f"{name} uses what it writes before it waits")
    if count != len(re.findall(r"^KERNEL", text, re.M)):
        wrong.append("a kernel is not written as this check expects")
    return wrong, count


def main():
    kernels, seen, early = 0, [], ""
    for header in sorted(Path(sys.argv[1]).glob("*/*.h")):
        text = header.read_text()
        wrong, count = faults(text)
        kernels += count
        seen += [f"{header}: {fault}" for fault in wrong]
        if header.name == "schwarz.h":
            early = text
    if seen:
        sys.exit("\n".join(seen))
    # The check itself is seen to fail.
    for old, new, fault in (
        ("  if (!BEGINS_EARLY && scalar", "  if (scalar", "reads memory before"),
        ("AWAIT_LAUNCHES;", "", "does not wait"),
        ("      AWAIT_LAUNCHES;\n", "      total[i] = z[i];\n      AWAIT_LAUNCHES;\n", "uses what it writes"),
        ("KERNEL combine_levels(", "KERNEL\ncombine_levels (", "not written as"),
    ):
        assert any(fault in f for f in faults(early.replace(old, new))[0]), fault
    print(f"{kernels} kernels wait before they read; four edits were noticed")


main()
