"""The table of verbs: parsers, help, completion, ``docs/commands.md`` and fields of the app follow from ``data/verbs.toml``.

Packages add theirs (`stoop.base.packages`).
"""

from __future__ import annotations

import argparse
import functools
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from stoop.base import packages
from stoop.base.numbers import MAX_NUMBER
from stoop.base.text import nearest

#: of verbs, in the order of their list
GROUPS: Final = ("flights", "models", "uses", "fleets", "studies", "help")
MOST_EXPLAINED = 16  #: choices with titles that the help of an option lists
#: largest whole number of an option that has no range of its own: any generator of random numbers takes it as a seed
MAX_COUNT: Final = 2**32 - 1
_LINK = re.compile(r"\[([^\]]*)\]\((?:([\w-]+\.md)[^)]*|[^)]*)\)")
_PLACE = re.compile(r"[\w.]+:\w+")  #: a text that stands for an object of a module


def plain(markdown: str) -> str:
    """Return a text without the marks of Markdown: a link to another page becomes the name of its file."""
    told = _LINK.sub(lambda m: m[1] + (f" (docs/{m[2]})" if m[2] else ""), markdown)
    return told.replace("`", "")


@dataclass(frozen=True)
class Option:
    """An argument of a verb; ``data/packages.toml`` describes its fields, and has `allowed` as ``choices``."""

    name: str
    help: str
    kind: str = "text"
    metavar: str | tuple[str, ...] = ""
    unit: str = ""
    range: tuple[float, float] | None = None
    default: Any = None
    otherwise: str = ""
    allowed: tuple[str, ...] | str = ()
    required: bool = False
    many: int | str = ""
    repeat: bool = False
    const: Any = None
    short: str = ""
    group: str = ""
    dest: str = ""
    parameter: str = ""
    run: str = ""

    plain = staticmethod(plain)

    @property
    def positional(self) -> bool:
        """Whether it is an argument without a name."""
        return not self.name.startswith("-")

    @property
    def key(self) -> str:
        """Name of the value in the program."""
        return self.dest or self.name.lstrip("-").replace("-", "_")

    @property
    def choices(self) -> dict[str, str]:
        """Choices, each with its title, which is empty for most."""
        found = _resolved(self.allowed, Collection, dict)
        titles = found if isinstance(found, Mapping) else {}
        return {str(name): str(getattr(titles.get(name), "title", "")) for name in found}

    @property
    def usual(self) -> str:
        """What holds when it is not given, as Markdown; empty if nothing does."""
        value = self.default
        if self.otherwise or value is None or value == "" or value == float("-inf"):
            return self.otherwise
        values = value if isinstance(value, tuple) else (value,)
        return " ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in values)

    @property
    def meaning(self) -> str:
        """What it is, with unit and choices (if they are not too many for a line), as Markdown."""
        unit = f" [{self.unit}]" if self.unit else ""
        listed = self.choices if self.metavar and len(self.choices) <= MOST_EXPLAINED else ()
        named = [f"`{name}`" + (f" ({self.choices[name]})" * bool(self.choices[name])) for name in listed]
        return self.help + unit + (f"; one of {', '.join(named)}" if named else "")


@dataclass(frozen=True)
class Verb:
    """A verb of the command line; ``data/packages.toml`` describes its fields, and has `closing` as ``epilog``."""

    name: str
    summary: str
    run: str
    options: tuple[Option, ...] = ()
    python: str = ""
    closing: str = ""
    group: str = GROUPS[2]

    @property
    def epilog(self) -> str:
        """Text at the end of its help."""
        return str(_resolved(self.closing, str, str)).strip("\n").replace("%(", "% (")

    def option(self, key: str) -> Option:
        """Return the option whose value has this name in the program."""
        return next(one for one in self.options if one.key == key)


@functools.cache
def shared_options(package: str = "stoop") -> dict[str, Option]:
    """Return the options that several verbs of a package may share, by name: those of stoop, and its own."""
    own = packages.packages()[package].get("options", {})
    shared = {} if package == "stoop" else shared_options()
    return shared | {name: _option(row, {}) for name, row in own.items()}


@functools.cache
def verbs() -> dict[str, Verb]:
    """Return all verbs by name, in the order of `GROUPS`, those of stoop before those of packages.

    A row of a package of which no parser can be made is left out, with a warning.
    """
    found = dict[str, Verb]()
    for package, name, row in packages.rows("verbs"):
        with packages.left_out(package, f"verbs.{name}"):
            found[name] = read_verb(name, row, package)
    for package, more in packages.tables("more"):
        for name, row in more.items():
            with packages.left_out(package, f"more.{name}"):
                if name in found:
                    found[name] = _with_options(found[name], row["options"], package)
                elif package not in packages.OWN:  # of stoop: the package of the verb is absent
                    raise ValueError(f"there is no such verb; {nearest(name, found)}")
    return {one.name: one for one in sorted(found.values(), key=lambda verb: GROUPS.index(verb.group))}


def read_verb(name: str, row: Mapping[str, Any], package: str = "stoop") -> Verb:
    """Return the verb of a row."""
    fields = row.get("python", ""), row.get("epilog", ""), row.get("group", GROUPS[2])
    return _with_options(Verb(name, row["summary"], row["run"], (), *fields), row["options"], package)


def _with_options(verb: Verb, rows: Iterable[Any], package: str) -> Verb:
    """Return a verb with further options; raise `ValueError` where no parser can be made of those of somebody else."""
    added = [_option(row, shared_options(package)) for row in rows]
    if package not in packages.OWN:
        _try(verb.options, added)
    return replace(verb, options=(*verb.options, *added))


def _try(options: Iterable[Option], added: Sequence[Option]) -> None:
    """Make a parser of options, and of those added to them, without choices, which may import a package."""
    parser, keys, at = argparse.ArgumentParser(), {"run", "complain", "help", "debug"}, "its help"
    parser.add_argument("--debug")
    try:
        for option in (*options, *added):
            at = option.name or "an option without a name"
            if not (option.name and option.help):
                raise ValueError("name or help is missing; write both")
            if option.key in keys:
                raise ValueError("the name is taken; rename it")
            if options and option in added and (option.positional or option.required):
                raise ValueError("what is added to a verb is no option that can be left out; make it one")
            known = option.allowed if isinstance(option.allowed, tuple) else ()
            add_options(parser, [replace(option, allowed=known)])
            for value in (one for one in (option.default, option.const) if isinstance(one, str)):
                reader(option)(value)
            keys.add(option.key)
        at = "its help"
        parser.format_help()
    except Exception as error:
        raise ValueError(f"{at}: {error}") from error


def _option(row: str | Mapping[str, Any], shared: Mapping[str, Option]) -> Option:
    """Return the option of a row: the name of a shared one, changes of one, or all fields of its own."""
    like = row if isinstance(row, str) else row.get("like", "")
    if like and like not in shared:
        raise ValueError(f"there is no shared option '{like}'; {nearest(like, shared)}")
    if isinstance(row, str):
        return shared[row]
    own = [(k, v) for k, v in row.items() if k != "like"]
    fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in own}
    if "choices" in fields:
        fields["allowed"] = fields.pop("choices")
    return replace(shared[like] if like else Option("", ""), **fields)


def _resolved(value: Any, kind: Any, instead: Callable[[], Any]) -> Any:
    """Return a value, or what the place ``module:NAME`` holds: an object, or a function that returns it."""
    if not isinstance(value, str) or not _PLACE.fullmatch(value):
        return value
    found = packages.guarded(value, kind, instead)
    return found() if callable(found) else found


def _reader(allowed: Callable[[Any], bool], what: str, whole: bool = False) -> Callable[[str], Any]:
    """Return what reads a number and refuses others in one line."""

    def read(text: str) -> Any:
        try:
            value = (int(text) if text.isascii() and text.isdigit() else math.nan) if whole else float(text)
        except ValueError:
            value = math.nan
        if not allowed(value):
            raise argparse.ArgumentTypeError(f"'{text}' is not {what}")
        return value

    return read


def page_path(text: str) -> Path:
    """Return the file of a page: a name without an ending gets ``.html``, unless a folder or device has it; others raise."""
    path = Path(text)
    if path.suffix.lower() not in ("", ".html", ".htm") and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: a page is written as .html; name it so")
    taken = path.exists() and not path.is_file()
    return path if path.suffix or taken or not path.name else path.with_name(f"{path.name}.html")


def names(text: str) -> tuple[str, ...]:
    """Return names that commas separate, each once."""
    found = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise argparse.ArgumentTypeError("names are missing; separate them by commas")
    return found


#: kind of a number -> which are allowed, in code and in words
NUMBERS: Final[Mapping[str, tuple[Callable[[float], bool], str]]] = {
    "positive": (lambda x: 1.0 / MAX_NUMBER <= x <= MAX_NUMBER, "a positive number from 1e-30 to 1e30"),
    "finite": (lambda x: abs(x) <= MAX_NUMBER, "a number up to 1e30"),
}
positive = _reader(*NUMBERS["positive"])
#: kind of a whole number -> the smallest
WHOLE: Final = {"count": 0, "at-least-one": 1}
#: kind of an option's value -> what reads it
READERS: Final[dict[str, Callable[[str], Any]]] = {
    **dict.fromkeys(("text", "vehicle", "source"), str),
    **dict.fromkeys(("file", "data", "folder", "output", "output-or-print"), Path),
    "page": page_path,
    "names": names,
}


def reader(option: Option) -> Callable[[str], Any]:
    """Return what reads a value of an option; an angle within limits is returned in rad."""
    if (least := WHOLE.get(option.kind)) is not None:
        first, last = option.range or (least, MAX_COUNT)
        whole = f"a whole number from {first:.0f} to {last:.0f}"
        return _reader(lambda n: first <= n <= last, whole, whole=True)
    if option.range is None and option.kind not in NUMBERS:
        return READERS[option.kind]
    allowed, what = NUMBERS["positive" if option.kind == "positive" else "finite"]
    base = _reader(allowed, f"{what}; write it in {option.unit}, without the unit" if option.unit else what)
    if option.range is None:
        return base
    low, high = option.range

    def read(text: str) -> Any:
        value = base(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f"{text} is not between {low:g} and {high:g} {option.unit}".rstrip()
            )
        return math.radians(value) if option.unit == "deg" else value

    return read


def add_options(parser: argparse.ArgumentParser, options: Sequence[Option]) -> dict[str, argparse.Action]:
    """Add the options of a verb; return what argparse made of them, by their names in the program."""
    groups: dict[str, Any] = {"": parser}
    for option in options:
        if option.group not in groups:
            groups[option.group] = parser.add_mutually_exclusive_group()
    return {option.key: _add(groups[option.group], option) for option in options}


def _add(parser: Any, option: Option) -> argparse.Action:
    usual = f" (default: {option.usual})" if option.usual else ""
    settings: dict[str, Any] = {"help": plain(option.meaning + usual).replace("%", "%%")}
    if option.kind == "switch":
        settings["action"] = "store_true"
    else:
        default = [] if option.repeat and not option.required else option.default
        settings |= {"type": reader(option), "metavar": option.metavar or None, "default": default}
        settings |= {"choices": tuple(option.choices) or None, "const": option.const}
        settings |= {"nargs": option.many} if option.many else {}
        if option.repeat:
            settings["action"] = "extend" if option.many else "append"
    if not option.positional:
        settings |= {"dest": option.key, "required": option.required}
    added: argparse.Action = parser.add_argument(*filter(None, (option.short, option.name)), **settings)
    return added
