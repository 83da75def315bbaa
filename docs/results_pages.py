# SPDX-License-Identifier: Apache-2.0
"""A hook of mkdocs (mkdocs.yml): the pages of results/ become part of the site, and their pictures are drawn.

Pages link to each other as they lie in the repository, so that links work there too: `../../results/NAME.md` from a
page of a folder of docs, `../docs/FOLDER/PAGE.md` from a page of results. In the site results/ lies beside
those folders.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def on_pre_build(config):
    """Draws the pictures of results/ into docs/images/generated; needs matplotlib."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import plot_results

    plot_results.plot_all()


def on_files(files, config):
    """Adds the pages and data of results/."""
    from mkdocs.structure.files import File

    for path in sorted((ROOT / "results").glob("*")):
        if path.suffix in (".md", ".csv"):
            files.append(File(f"results/{path.name}", str(ROOT), config["site_dir"], config["use_directory_urls"]))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links between docs/ and results/ as they are in the site."""
    if page.file.src_uri.startswith("results/"):
        return markdown.replace("](../docs/", "](../")
    return re.sub(r"\]\(\.\./((?:\.\./)*)results/", r"](\1results/", markdown)
