# SPDX-License-Identifier: Apache-2.0
"""A hook of mkdocs (mkdocs.yml): the notebooks of examples/notebooks/ become pages of the site, with their outputs.

Links in a notebook are those from its own folder, `../../docs/FOLDER/PAGE.md`.
"""

import base64
import json
from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[1] / "examples" / "notebooks"


def joined(text):
    """Text of a notebook, which may be a list of its lines."""
    return "".join(text)


def page_of(path):
    """(Markdown of a notebook, {name of a picture beside it: its bytes})."""
    notebook, pictures = json.loads(path.read_text(encoding="utf-8")), {}
    parts = [f"*This page is the notebook `examples/notebooks/{path.name}`.*"]
    for cell in notebook["cells"]:
        source = joined(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source.replace("](../../docs/", "](../"))
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            if output["output_type"] == "stream":
                parts.append(f"```text\n{joined(output['text']).rstrip()}\n```")
            elif "image/png" in output.get("data", {}):
                name = f"{path.stem}-{len(pictures)}.png"
                pictures[name] = base64.b64decode(joined(output["data"]["image/png"]))
                parts.append(f"![Output of the cell above]({name})")
    head, _, rest = parts[1].partition("\n")  # the title, then where the page comes from
    return "\n\n".join([head, parts[0], rest.strip(), *parts[2:]]) + "\n", pictures


def on_files(files, config):
    """Adds the pages and their pictures."""
    from mkdocs.structure.files import File

    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        text, pictures = page_of(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files
