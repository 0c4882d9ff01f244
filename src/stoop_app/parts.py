"""Parts of the page: text that is always escaped, buttons, commands, tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any, Final

import panel as pn
from tornado.escape import url_escape

from stoop.extend.errors import StoopError
from stoop.extend.text import printable
from stoop.extend.verbs import Option
from stoop_app.steps import Step

BAR: Final = "<div class='bar'><i></i></div>"  #: work goes on
CODE: Final[dict[str, Any]] = {
    "sizing_mode": "stretch_width",
    "auto_grow": True,
    "max_length": 1_000_000,
    "stylesheets": ["textarea { font: 12px/1.5 ui-monospace, Menlo, Consolas, monospace; }"],
}  #: options of a field for a file
#: options of what takes the rest of the window, or more where it needs more
FILLING: Final[dict[str, Any]] = {
    "sizing_mode": "stretch_both",
    "margin": 0,
    "styles": {"flex": "1 0 auto", "height": "auto"},
}
_OPTION: Final = re.compile(r"(?<![\w-])--([a-z][a-z-]*)")
DIGITS: Final = frozenset(("", *"0123456789-−.±"))  #: with which a cell of a number begins
STATES: Final = {"running": "running", "done": "done", "failed": "not done"}


@cache
def style(name: str) -> str:
    """Return a style sheet of the app."""
    return (files("stoop_app") / name).read_text("utf-8")


def html(text: str = "", **options: Any) -> pn.pane.HTML:
    """Return a pane of markup that was made by this module; see `escaped`."""
    options = {"sizing_mode": "stretch_width", "margin": (0, 0), **options}
    return pn.pane.HTML(text, stylesheets=[style("content.css")], **options)


def escaped(text: object) -> str:
    """Return text of anybody as markup that shows it."""
    return escape("\n".join(map(printable, str(text).split("\n"))))


def spoken(text: str) -> str:
    """Return a text with options of a command as the things that they name: ``--wing-area`` is wing area."""
    return _OPTION.sub(lambda found: found[1].replace("-", " "), text)


def error(text: object) -> str:
    """Return an error in words."""
    return f'<div class="error" role="alert">{escaped(spoken(str(text)))}</div>' if text else ""


def note(text: object) -> str:
    """Return a remark."""
    return f'<div class="note">{escaped(text)}</div>' if text else ""


def soft(text: object) -> str:
    """Return a remark in small."""
    return f"<p class='soft'>{escaped(text)}</p>" if text else ""


def fold(summary: object, inside: str, is_open: bool = False) -> str:
    """Return markup that is folded below a line."""
    return f"<details{' open' if is_open else ''}><summary>{escaped(summary)}</summary>{inside}</details>"


def printed(text: str, summary: str = "what it printed") -> str:
    """Return what a command has printed, folded."""
    return fold(summary, f"<pre>{escaped(text)}</pre>") if text else ""


def bullets(items: Iterable[object]) -> str:
    """Return a list."""
    rows = "".join(f"<li>{escaped(item)}</li>" for item in items)
    return f"<ul>{rows}</ul>" if rows else ""


def chip(step: Step) -> str:
    """Return the state of a step in a word."""
    state = step.state
    return f'<span class="chip {state}">{STATES[state]}</span>'


def busy(step: Step, doing: str) -> str:
    """Return that a step goes on."""
    return f"{soft(doing)}{BAR}{command(step)}"


def command(step: Step) -> str:
    """Return the command of a step, folded."""
    return printed(step.command, f"command of {step.name}")


def failed(step: Step) -> pn.pane.HTML:
    """Return what a step that failed says is wrong, and its command."""
    return html(error(step.error) + command(step))


def table(heads: Sequence[str], rows: Iterable[Sequence[object]], wide: Sequence[int] = ()) -> str:
    """Return a table; columns of numbers are flush right, those named by `wide` may wrap."""
    body = list(rows)
    cells_of = [[str(row[i]).strip()[:1] for row in body] for i in range(len(heads))]
    numeric = {i for i, own in enumerate(cells_of) if own and all(c in DIGITS for c in own)}
    kinds = ["number" if i in numeric else "wide" if i in wide else "" for i in range(len(heads))]
    head = "".join(
        f'<th class="{kind}">{escaped(text)}</th>' for kind, text in zip(kinds, heads, strict=True)
    )
    cells = (
        "".join(f'<td class="{kind}">{escaped(cell)}</td>' for kind, cell in zip(kinds, row, strict=True))
        for row in body
    )
    rows_text = "".join(f"<tr>{row}</tr>" for row in cells)
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows_text}</tbody></table></div>'
    )


def button(name: str, act: Callable[[], Any], kind: str = "default", **options: Any) -> pn.widgets.Button:
    """Return a button."""
    made = pn.widgets.Button(label=printable(name), button_type=kind, **{"margin": (4, 8, 4, 0), **options})
    made.on_click(lambda _: act())
    return made


def field(option: Option, label: str = "", **settings: Any) -> Any:
    """Return a field for an option of a verb, with its unit, help and default; empty where the verb chooses by itself."""
    unit = f", {option.unit}" if option.unit else ""
    shared: dict[str, Any] = {
        "label": f"{label or option.key.replace('_', ' ')}{unit}",
        "description": spoken(Option.plain(option.meaning)),
    }
    shared |= {"margin": (0, 12, 4, 0), **settings}
    if option.choices:
        titles = {title or name: name for name, title in option.choices.items()}
        return pn.widgets.Select(options=titles, **shared)
    shared["placeholder"] = spoken(Option.plain(option.usual))
    if option.kind == "positive":
        return pn.widgets.FloatInput(value=option.default, start=0.0, **shared)
    return pn.widgets.TextInput(value=option.default or "", **shared)


def given(option: Option, value: Any) -> list[str]:
    """Return the words of a command that give an option a value of its field; none for an empty field.

    Raises
    ------
    StoopError
        A word would be an option of its own.
    """
    if value is None or value == "":
        return []
    words = [f"{value:g}"] if isinstance(value, float) else str(value).split()
    for word in words:
        if word.startswith("-") and not re.fullmatch(r"-[\d.]+(e[-+]?\d+)?", word):
            raise StoopError(
                f"{option.key}: {word} is no value of it; write numbers or names, separated by blanks"
            )
    return [option.name, *words]


def card(title: str, *inside: Any) -> pn.Card:
    """Return what is folded below a title."""
    frame = {"border": "1px solid var(--line)", "border-radius": "6px", "box-shadow": "none"}
    return pn.Card(*inside, title=title, collapsed=True, sizing_mode="stretch_width", margin=(8, 0), styles=frame,
                   header_background="var(--card)", header_color="var(--ink)", title_css_classes=["title"])  # fmt: skip


def address(place: str) -> str:
    """Return where the page finds a file of the folder."""
    return f"files/{url_escape(place, plus=False)}"


def opened(place: str, title: str) -> str:
    """Return a link to a page that a verb wrote, which opens beside the app."""
    return f'<p><a href="{address(place)}" target="_blank" rel="noopener">{escaped(title)}</a></p>'


def downloads(places: Iterable[str]) -> str:
    """Return links to files of the folder."""
    rows = (f'<li><a href="{address(p)}" download>{escaped(p)}</a></li>' for p in places)
    return f"<ul>{''.join(rows)}</ul>"


def framed(place: str, title: str) -> pn.pane.HTML:
    """Return a page that a verb wrote, apart from the app, in the rest of the window: it scrolls, and not the app's."""
    text = f'{BAR}<iframe src="{address(place)}" title="{escaped(title)}" sandbox="allow-scripts allow-downloads"></iframe>'
    return html(
        text,
        sizing_mode="stretch_both",
        min_height=360,
        styles={"flex": "1 0 auto", "position": "relative"},
    )
