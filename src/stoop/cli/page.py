"""What verbs print on: rich on a terminal, plain text in a pipe, with the same words."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, final

from stoop.cli.printable import printable
from stoop.cli.tables import Column, fit, plain

if TYPE_CHECKING:
    from rich.console import Console


class Page(ABC):
    """Somewhere to print on.

    Whatever is printed may come from a hostile file: it is made printable and never read as markup.
    """

    width: int  #: characters in a line

    @abstractmethod
    def heading(self, text: str) -> None:
        """Print a blank line and a heading."""

    @abstractmethod
    def line(self, text: str = "") -> None:
        """Print one line, wrapped where the page is narrower."""

    @abstractmethod
    def command(self, start: str, command: Sequence[str]) -> None:
        """Print a command to copy, quoted for the shell and never broken into lines."""

    @abstractmethod
    def bullets(self, items: Iterable[str]) -> None:
        """Print a list, one item a line."""

    @abstractmethod
    def table(self, columns: Sequence[Column]) -> None:
        """Print a table."""


@final
class PlainPage(Page):
    """A pipe or a file: nothing is wrapped or cut, so that other programs can read it."""

    width = 10_000

    def heading(self, text: str) -> None:
        """Print a blank line and a heading."""
        print(f"\n{printable(text)}")

    def line(self, text: str = "") -> None:
        """Print one line."""
        print(printable(text))

    def command(self, start: str, command: Sequence[str]) -> None:
        """Print a command to copy."""
        self.line(f"{start}{shlex.join(command)}")

    def bullets(self, items: Iterable[str]) -> None:
        """Print a list, one item a line."""
        for item in items:
            print(f"- {printable(item)}")

    def table(self, columns: Sequence[Column]) -> None:
        """Print a table with two blanks between columns."""
        print(plain(columns))


@final
class TerminalPage(Page):
    """A terminal: headings stand out, long lines wrap below themselves, tables fit."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.width = console.width

    def heading(self, text: str) -> None:
        """Print a blank line and a bold heading."""
        from rich.text import Text

        self._console.print()
        self._console.print(Text(printable(text), style="bold"))

    def line(self, text: str = "") -> None:
        """Print one line, wrapped at words."""
        from rich.text import Text

        self._console.print(Text(printable(text)))

    def command(self, start: str, command: Sequence[str]) -> None:
        """Print a command to copy; the terminal breaks it where it likes, a copy of it stays whole."""
        from rich.text import Text

        self._console.print(Text(printable(f"{start}{shlex.join(command)}")), soft_wrap=True)

    def bullets(self, items: Iterable[str]) -> None:
        """Print a list; what does not fit goes on below the text, not below the dash."""
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 1, 0, 0))
        for item in items:
            grid.add_row("-", Text(printable(item)))
        self._console.print(grid)

    def table(self, columns: Sequence[Column]) -> None:
        """Print a table; a last column of words goes on below itself, is cut, or left out where it must."""
        from rich.text import Text

        head, *rows = plain(fit(columns, self.width)).split("\n")
        self._console.print(Text(head, style="dim"), soft_wrap=True)
        self._console.print(Text("\n".join(rows)), soft_wrap=True)


def page() -> Page:
    """Return the page that fits the output."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return PlainPage()
    from rich.console import Console

    return TerminalPage(Console(markup=False, highlight=False, emoji=False))


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
