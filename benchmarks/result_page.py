# SPDX-License-Identifier: Apache-2.0
"""Dated pages of measurements, results/NAME-YYYY-MM-DD.md: made where there is none yet, sections in them replaced.

A section is what stands between <!-- section NAME --> and <!-- end NAME -->; nothing there is written by hand. What a
page says outside of its sections is: of which machine, under which circumstances, what follows from it.
"""

import datetime
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"


def path_of(name):
    """Of today's page."""
    return RESULTS / f"{name}-{datetime.date.today().isoformat()}.md"


def commit():
    """The commit of the working tree, and whether it has changes."""
    git = ["git", "-C", str(ROOT)]
    try:
        name = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
        changed = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "not known"
    return name.stdout.strip() + (", with changes" if changed.stdout.strip() else "")


def head(title, command, date=None):
    """Text of a new page before its first section."""
    rows = [("Date", date or datetime.date.today().isoformat()), ("Commit", commit()), ("Command", f"`{command}`")]
    return f"# {title}\n\n| | |\n|---|---|\n" + "".join(f"| {name} | {text} |\n" for name, text in rows)


def replace_section(page, name, text):
    """The page with the section's text replaced. Throws ValueError where it has no such section."""
    pattern = re.compile(rf"(<!-- section {re.escape(name)} -->\n).*?(<!-- end {re.escape(name)} -->)", re.S)
    if not pattern.search(page):
        raise ValueError(f"the page has no section '{name}'")
    return pattern.sub(lambda m: m.group(1) + "\n" + text.strip() + "\n\n" + m.group(2), page)


def write_section(path, name, text, title, command):
    """Puts a section into the page at `path`, which is made, and given the section, where there is none."""
    path = Path(path)
    page = path.read_text(encoding="utf-8") if path.exists() else head(title, command)
    if f"<!-- section {name} -->" not in page:
        page += f"\n<!-- section {name} -->\n<!-- end {name} -->\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(replace_section(page, name, text), encoding="utf-8")
