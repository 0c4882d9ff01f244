"""Pages of the notebooks in `examples`, written when the documentation is built: text, code and committed outputs.

Nothing is executed here: `scripts/execute_notebooks.py` executes notebooks, and a test holds code and outputs together.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from sphinx.application import Sphinx

EXAMPLES: Final = Path(__file__).parents[1] / "examples"
FOLDER: Final = "gallery"  #: in the source folder; not part of the repository
CARDS: Final = "cards.txt"  #: what docs/gallery.md includes
LINK: Final = re.compile(r"\]\((\w+)\.ipynb\)")  #: to another notebook


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before any is read."""
    app.connect("builder-inited", lambda app: write(Path(app.srcdir) / FOLDER))
    return {"parallel_read_safe": True}


def write(folder: Path) -> None:
    """Write a page for each notebook, its pictures and its file to download, and the cards of all."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    entries = tomllib.loads((EXAMPLES / "index.toml").read_text(encoding="utf-8"))["example"]
    cards = []
    for entry in entries:
        name = entry["name"]
        path = EXAMPLES / f"{name}.ipynb"
        content = json.loads(path.read_text(encoding="utf-8"))
        shutil.copy(path, folder)
        text, pictures = page(name, content, entry)
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
        for file, picture in pictures.items():
            (folder / file).write_bytes(picture)
        cards.append(card(name, content, entry))
    listed = "\n".join(f"{FOLDER}/{entry['name']}" for entry in entries)
    grid = "::::{grid} 1 1 2 2\n:gutter: 3\n\n" + "\n\n".join(cards) + "\n::::\n"
    (folder / CARDS).write_text(f"{grid}\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n", encoding="utf-8")


def title(content: Mapping[str, Any]) -> str:
    """Return the heading of a notebook."""
    return "".join(content["cells"][0]["source"]).splitlines()[0].removeprefix("# ")


def card(name: str, content: Mapping[str, Any], entry: Mapping[str, Any]) -> str:
    """Return a card: what a notebook shows, and the picture of it that its entry names."""
    return (
        f":::{{grid-item-card}} {title(content)}\n:link: {FOLDER}/{name}\n:link-type: doc\n"
        f":img-bottom: {FOLDER}/{name}-{entry['picture']}.png\n\n{entry['summary']}\n:::"
    )


def drawings(content: Mapping[str, Any]) -> Iterator[bytes]:
    """Give the pictures among the outputs of a notebook."""
    for cell in content["cells"]:
        for output in cell.get("outputs", ()):
            if "image/png" in output.get("data", {}):
                yield base64.b64decode(output["data"]["image/png"])


def page(name: str, content: Mapping[str, Any], entry: Mapping[str, Any]) -> tuple[str, dict[str, bytes]]:
    """Return the page of a notebook, and its pictures by file."""
    pictures = {f"{name}-{i}.png": p for i, p in enumerate(drawings(content), 1)}
    unused, heading = iter(pictures), ""
    parts = []
    for cell in content["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(LINK.sub(r"](\1.md)", source))
            heading = (re.findall(r"^#+ (.*)", source, re.MULTILINE) or [heading])[-1]
        else:
            parts.append(f"```python\n{source}\n```")
            parts += [shown(output, unused, heading) for output in cell["outputs"]]
    files = ", ".join(f"`{file}`" for file in entry.get("files", ()))
    note = (
        f"{{download}}`Download this notebook <{name}.ipynb>`, or copy it{f' with {files}' if files else ''} by "
        f"`stoop example {name}`."
    )
    return "\n\n".join([parts[0], note, *parts[1:]]) + "\n", pictures


def shown(output: Mapping[str, Any], pictures: Iterator[str], heading: str) -> str:
    """Return an output as Markdown: a picture, a table, or text."""
    if output["output_type"] == "stream":
        return f"```text\n{''.join(output['text']).rstrip()}\n```"
    data = output["data"]
    if "image/png" in data:
        return f"```{{image}} {next(pictures)}\n:alt: {heading}: plot of the cell above.\n:class: notebook-output\n```"
    if "text/html" in data:
        return f"```{{raw}} html\n{''.join(data['text/html'])}\n```"
    return f"```text\n{''.join(data['text/plain']).rstrip()}\n```"
