"""Read Markdown: fenced blocks, commands, tables under their headings, links."""

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LOG_PAGES = ("px4", "px4-fixed-wing", "ardupilot", "crazyflie", "betaflight", "other-logs")
PAGES = [ROOT / n for n in ("README.md", "CONTRIBUTING.md", "examples/README.md")] + sorted(DOCS.glob("*.md"))


@dataclass(frozen=True)
class Table:
    """A table: the heading above it without backticks, its own head, its rows without backticks around a cell."""

    heading: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def column(self, name: str) -> list[str]:
        return [row[self.head.index(name)] for row in self.rows]


def fences(page: Path) -> list[tuple[str, str]]:
    return re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    return [content for kind, content in fences(page) if kind == language]


def commands(page: Path) -> list[str]:
    """Return what stands behind the prompts of console blocks, continued lines joined."""
    lines = "\n".join(blocks(page, "console")).replace("\\\n", " ").splitlines()
    return [re.sub(r"\s+#.*", "", line[2:]).strip() for line in lines if line.startswith("$ ")]


def tables(page: Path) -> list[Table]:
    found, heading = [], ""
    for part in _parts(page.read_text(encoding="utf-8")):
        if isinstance(part, str):
            heading = part.replace("`", "")
        else:
            found.append(Table(heading, part[0], tuple(part[2:])))
    return found


def table(page: Path, heading: str, *head: str) -> Table:
    for t in tables(page):
        if t.heading == heading and t.head[: len(head)] == head:
            return t
    raise LookupError(f"{page.name}: no table {head} under '{heading}'")


def _parts(text: str) -> Iterator[str | list[tuple[str, ...]]]:
    rows: list[tuple[str, ...]] = []
    shown = re.sub(r"^```.*?^```|^<!--.*?-->", "", text, flags=re.MULTILINE | re.DOTALL)
    for line in [*shown.splitlines(), ""]:
        if line.startswith("|"):
            rows.append(tuple(_bare(cell) for cell in line.strip().strip("|").split("|")))
        elif rows:
            yield rows
            rows = []
        if line.startswith("#"):
            yield line.lstrip("# ")


def _bare(cell: str) -> str:
    text = cell.strip().replace("\\*", "*")
    return text[1:-1] if re.fullmatch(r"`[^`]*`", text) else text


def run_python(page: Path, folder: Path, block: int = 0) -> str:
    """Run a Python block of a page in a folder, as its reader would; return what it prints."""
    code = blocks(page, "python")[block]
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{page.name}: {done.stderr}"
    return done.stdout
