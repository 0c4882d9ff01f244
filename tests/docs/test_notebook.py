"""Notebooks: outputs are those of code and files, each has a page, short ones run. Pictures: each is on a page."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from docs.pages import DOCS, ROOT

sys.path[:0] = [str(ROOT / "scripts"), str(DOCS)]
import execute_notebooks  # noqa: E402

SHORT = (
    "identify", "look", "modes", "own_mutation", "quadrotor", "compatibility", "loop", "fleet", "paper_figures",
)  # fmt: skip


def notebook(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text("utf-8")))


def printed(content: dict[str, Any]) -> list[str]:
    outputs = [o for c in content["cells"] for o in c.get("outputs", ()) if o["output_type"] == "stream"]
    return "".join("".join(o["text"]) for o in outputs).splitlines()


def kinds(content: dict[str, Any]) -> list[list[list[str]]]:
    cells = [c for c in content["cells"] if c["cell_type"] == "code"]
    return [[sorted(o.get("data", {"text": ""})) for o in c["outputs"]] for c in cells]


def test_notebooks_are_small_and_their_outputs_are_those_of_code_and_files() -> None:
    """Else run ``python scripts/execute_notebooks.py``."""
    index = execute_notebooks.index()
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(index)
    assert {name for name, one in index.items() if one["run"] == "short"} == set(SHORT)
    for name, one in index.items():
        path = execute_notebooks.place(name)
        content = notebook(path)
        assert all((ROOT / "examples" / file).is_file() for file in one.get("files", ())), name
        assert path.stat().st_size < 300_000, name
        assert "".join(content["cells"][0]["source"]).startswith("# "), name
        outputs = [o for c in content["cells"] if c["cell_type"] == "code" for o in c["outputs"]]
        assert outputs, name
        assert not [o for o in outputs if o["output_type"] == "error"], name
        assert not re.search(r"/(home|root|tmp|work|Users)/", path.read_text("utf-8")), name
        assert not execute_notebooks.has_data(name) or not execute_notebooks.stale(name), name


@pytest.mark.parametrize("name", SHORT)
def test_short_notebooks_run(name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "execute_notebooks.py"), name, "--into", str(tmp_path)]
    environment = {**os.environ, "TMPDIR": str(tmp_path), "IPYTHONDIR": str(tmp_path / "ipython")}
    run = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr[-3000:]
    found, committed = notebook(tmp_path / f"{name}.ipynb"), notebook(execute_notebooks.place(name))
    assert kinds(found) == kinds(committed)
    assert len(printed(found)) == len(printed(committed))


def test_pages_show_text_code_and_outputs(tmp_path: Path) -> None:
    import gallery_pages  # of Sphinx

    gallery_pages.write(tmp_path / "gallery")
    cards, index = (tmp_path / "gallery" / "cards.txt").read_text("utf-8"), execute_notebooks.index()
    for name in index:
        content = notebook(execute_notebooks.place(name))
        page = (tmp_path / "gallery" / f"{name}.md").read_text("utf-8")
        sources = ["".join(c["source"]) for c in content["cells"] if c["cell_type"] == "code"]
        assert all(source in page for source in sources), name
        pictures = re.findall(r"\{image\} (\S+)", page)
        assert len(pictures) == sum(1 for _ in gallery_pages.drawings(content)) >= 1, name
        assert all((tmp_path / "gallery" / file).stat().st_size > 1000 for file in pictures), name
        assert f":link: gallery/{name}\n" in cards
        assert set(re.findall(r"\]\((\w+)\.md\)", page)) <= set(index), name


SHOWN = re.compile(r"^```\{picture\} (\S+)\n((?::[^\n]*\n)*)(.*?)^```", re.MULTILINE | re.DOTALL)


def test_every_picture_is_on_a_page_with_a_caption_and_a_text() -> None:
    from pictures import registry

    shown = [found for page in sorted(DOCS.glob("*.md")) for found in SHOWN.findall(page.read_text("utf-8"))]
    known = registry.pictures()
    explained = {n for n, options, _ in shown if ":bare:" not in options or n.startswith("door-")}
    assert {name for name, _, _ in shown} == set(known) == explained
    assert all(len(p.alternative) > 20 and p.alternative.endswith(".") for p in known.values())
    assert all(c.strip().endswith((".", ":")) for name, _, c in shown if not name.startswith("door-"))
