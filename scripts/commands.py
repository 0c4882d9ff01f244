"""Write the tables of docs/commands.md from those of the verbs: src/stoop/data/verbs.toml, and stoop.toml of packages."""

from __future__ import annotations

import re
from pathlib import Path

from stoop.base.verbs import Option, Verb, verbs

PAGE = Path(__file__).parents[1] / "docs" / "commands.md"


def page(text: str) -> str:
    """Return the page with its tables as they follow from the verbs; the text around them stays."""
    known = verbs()
    rows = (
        f"| [`{name}`](#stoop-{name.replace(' ', '-')}) | {verb.summary} |" for name, verb in known.items()
    )
    text = _replaced(text, "", ("| verb | purpose |", "| --- | --- |", *rows))
    for name, verb in known.items():
        text = _replaced(text, f"## `stoop {name}`\n", options_table(verb))
    return text


def options_table(verb: Verb) -> tuple[str, ...]:
    """Return the table of a verb's options."""
    rows = (
        f"| {_called(one)} | {one.meaning} | {_usual(one)} |".replace("|  |", "| |") for one in verb.options
    )
    return ("| option | meaning | default |", "| --- | --- | --- |", *rows)


def _called(option: Option) -> str:
    """Return how an option is written, each choice apart where there is no name for them."""
    name = option.metavar if isinstance(option.metavar, str) else " ".join(option.metavar)
    many = {"?": f"[{name}]", "*": f"[{name} ...]"}.get(str(option.many), name)
    if option.positional:
        return f"`{name}`"
    values = list(option.choices) if option.choices and not name else [many]
    flags = filter(None, (option.short, option.name))
    return ", ".join(f"`{flag} {value}`".replace(" `", "`") for flag in flags for value in values)


def _usual(option: Option) -> str:
    needed = option.required or (option.positional and option.many not in ("?", "*"))
    bare = "`" if isinstance(option.default, str) and not option.otherwise and option.default else ""
    return "required" if needed else f"{bare}{option.usual}{bare}"


def _replaced(text: str, heading: str, table: tuple[str, ...]) -> str:
    """Return a text with the first table below a heading, of the same head, replaced."""
    place = re.compile(
        rf"({re.escape(heading)}(?:(?!^## ).*\n)*?){re.escape(table[0])}\n(?:\|.*\n)*", re.MULTILINE
    )
    out, count = place.subn(lambda m: m[1] + "\n".join(table) + "\n", text, count=1)
    if not count:
        raise LookupError(f"{PAGE.name}: no table '{table[0]}' below '{heading.strip()}'")
    return out


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text("utf-8")), encoding="utf-8")
