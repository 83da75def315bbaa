# SPDX-License-Identifier: Apache-2.0
"""Pages of results/: every page is listed and dated, data belong to a page, every link leads somewhere."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
import result_page  # noqa: E402

GENERATED = ("options.md", "report.md", "command-line.md", "scene-file.md", "cpp-api.md")  # docs/generate.py
PAGES = sorted(p for p in (ROOT / "results").glob("*.md") if p.name != "README.md")


def anchors(text):
    """Those of the headings, as GitHub and mkdocs make them."""
    titles = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", t).lower()).strip().replace(" ", "-") for t in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_a_page_of_results_is_listed_and_says_when_and_of_what_it_is(page):
    date = re.search(r"-(\d{4}-\d{2}-\d{2})$", page.stem)
    text = page.read_text(encoding="utf-8")
    assert date and date[1] in text, "the date in its name"
    assert f"({page.name})" in (ROOT / "results" / "README.md").read_text(encoding="utf-8")
    if not page.stem.startswith("stability-"):  # whose page cama stability writes
        assert re.search(r"[Cc]ommits?\b", text)


def test_data_belong_to_a_page():
    texts = "".join(p.read_text(encoding="utf-8") for p in PAGES)
    for path in (ROOT / "results").glob("*.csv"):
        assert path.name in texts, path.name


def test_links_lead_somewhere():
    missing = []
    for page in (ROOT / "results").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        for target, anchor in re.findall(r"\]\((?!\w+:)([^)#\s]*)(?:#([^)\s]*))?\)", text):
            to = (page.parent / target) if target else page
            if to.name in GENERATED or "generated" in to.parts:
                continue
            if not to.exists():
                missing.append(f"{page.name}: {target}")
            elif anchor and to.suffix == ".md" and anchor not in anchors(to.read_text(encoding="utf-8")):
                missing.append(f"{page.name}: {target}#{anchor}")
    assert not missing, "\n".join(missing)


def test_a_page_is_made_and_gets_its_sections(tmp_path):
    page = tmp_path / "speed-2026-01-02.md"
    result_page.write_section(page, "cpu", "| 1 |", "Speed", "measure it")
    result_page.write_section(page, "gpu", "| 2 |", "Speed", "measure it")
    result_page.write_section(page, "cpu", "| 3 |", "Speed", "measure it")
    text = page.read_text()
    assert text.startswith("# Speed\n") and text.count("# Speed") == 1
    assert "| Commit | " in text and "| Command | `measure it` |" in text
    assert text.index("| 3 |") < text.index("| 2 |") and "| 1 |" not in text
