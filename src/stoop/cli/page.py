"""What verbs print on: rich on a terminal, plain text in a pipe, with the same words."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from stoop.cli.printable import printable
from stoop.cli.tables import Column, fit, plain

if TYPE_CHECKING:
    from rich.console import Console

UNLIMITED: Final = (
    10_000  #: characters in a line of a pipe: nothing is wrapped or cut, so that programs can read it
)


class Page:
    """Somewhere to print on: a terminal, where long lines wrap and tables fit, or a pipe.

    Whatever is printed may come from a hostile file: it is made printable and never read as markup.

    Parameters
    ----------
    console : Console, optional
        Of a terminal; without it everything is plain text on stdout.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console
        self.width = UNLIMITED if console is None else console.width

    def heading(self, text: str) -> None:
        """Print a blank line and a heading."""
        self.line()
        self._print(printable(text), style="bold")

    def line(self, text: str = "") -> None:
        """Print one line, wrapped where the page is narrower."""
        self._print(printable(text))

    def command(self, start: str, command: Sequence[str]) -> None:
        """Print a command to copy, quoted for the shell and never broken into lines."""
        self._print(printable(f"{start}{shlex.join(command)}"), whole=True)

    def bullets(self, items: Iterable[object]) -> None:
        """Print a list; on a terminal, what does not fit goes on below the text, not below the dash."""
        texts = [printable(str(item)) for item in items]
        if self._console is None:
            for text in texts:
                print(f"- {text}")
            return
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 1, 0, 0))
        for text in texts:
            grid.add_row("-", Text(text))
        self._console.print(grid)

    def table(self, columns: Sequence[Column]) -> None:
        """Print a table; on a terminal a last column of words goes on below itself, is cut, or left out where it must."""
        head, _, rows = plain(fit(columns, self.width)).partition("\n")
        self._print(head, style="dim", whole=True)
        if rows:
            self._print(rows, whole=True)

    def text(self, lines: str) -> None:
        """Print lines that are laid out already."""
        self._print("\n".join(map(printable, lines.split("\n"))), whole=True)

    def _print(self, text: str, style: str = "", whole: bool = False) -> None:
        if self._console is None:
            print(text)
            return
        from rich.text import Text

        self._console.print(Text(text, style=style), soft_wrap=whole)


def page() -> Page:
    """Return the page that fits the output."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return Page()
    from rich.console import Console

    return Page(Console(markup=False, highlight=False, emoji=False))


@contextmanager
def busy(what: str) -> Iterator[None]:
    """Show on a terminal that work goes on; a pipe sees nothing of it."""
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(printable(what))):
        yield


def print_json(document: Mapping[str, Any]) -> None:
    """Print a document as strict JSON, see :func:`to_json`."""
    print(to_json(document))


def to_json(document: Mapping[str, Any]) -> str:
    """Return strict JSON: a number that is not finite becomes null."""
    return json.dumps(_strict(document), indent=2, allow_nan=False)


def _strict(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return value
