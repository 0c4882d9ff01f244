"""The table of verbs: parsers, help, completion, ``docs/commands.md`` and fields of the app follow from ``data/verbs.toml``.

Packages add theirs (`stoop.base.packages`).
"""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any, Final

from stoop.base import packages
from stoop.errors import StoopError

#: of verbs, in the order of their list
GROUPS: Final = ("flights", "models", "uses", "fleets", "studies", "help")
KINDS: Final = (
    "text", "switch", "file", "data", "vehicle", "source", "output", "output-or-print", "page", "folder", "names", "count",
    "at-least-one", "positive", "finite",
)  #: of options  # fmt: skip
MOST_EXPLAINED = 16  #: choices with titles that the help of an option lists
_LINK = re.compile(r"\[([^\]]*)\]\((?:([\w-]+\.md)[^)]*|[^)]*)\)")
_PLACE = re.compile(r"[\w.]+:\w+")  #: a text that stands for an object of a module


def plain(markdown: str) -> str:
    """Return a text without the marks of Markdown: a link to another page becomes the name of its file."""
    told = _LINK.sub(lambda m: m[1] + (f" (docs/{m[2]})" if m[2] else ""), markdown)
    return told.replace("`", "")


@dataclass(frozen=True)
class Option:
    """An argument of a verb: one row of the table.

    Attributes
    ----------
    name : str
        Such as ``--airspeed``, or without dashes that of a positional argument.
    help : str
        What it is, as Markdown, without its default.
    kind : str
        What a value is: ``text``; ``switch``, which takes none; what is read: ``file``, ``data`` (a folder), ``vehicle`` (a
        name or a file), ``source`` (a text, or a file that holds it); what is written: ``output`` (a file), ``output-or-print``
        (likewise, or ``-``), ``page`` (an HTML file), ``folder``; ``names``; ``count``, ``at-least-one``, ``positive``,
        ``finite``.
    metavar : str or sequence of str
        A value, or several of a fixed number, as the help calls it.
    unit : str
        Unit of a value on the command line.
    range : sequence of two floats, optional
        Limits of a number, in its unit; an angle with limits becomes rad.
    default : any
        When it is not given.
    otherwise : str
        What holds then, in words, if `default` does not say it; Markdown.
    allowed : sequence, or str
        Choices, or the place ``module:NAME`` of an iterable of them.
    required : bool
    many : int or str
        Number of values: a number, or ``?``, ``*``, ``+`` as in argparse.
    repeat : bool
        Whether it may be given several times; the values are joined.
    const : any
        Value of an option that is given without one.
    short : str
        One-letter form.
    group : str
        Options of one group exclude each other.
    dest : str
        Name in the program, if it is not `name`.
    parameter : str
        Name of the parameter of the verb's Python function, if it is not `dest`.
    run : str
        Place of the function that runs the verb instead where it is given.
    """

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
        try:
            found = _resolved(self.allowed)
        except StoopError as error:  # of a package that is absent or broken
            packages.warn(str(error).partition(":")[0], f"choices of {self.name} are unknown: {error}")
            return {}
        titles = found if isinstance(found, Mapping) else {}
        return {name: str(getattr(titles.get(name), "title", "")) for name in found}

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
    """A verb of the command line.

    Attributes
    ----------
    name : str
        One word, or two.
    summary : str
        What it does, on one line.
    run : str
        Place ``module:function`` of the function that runs it; the module is imported when the verb is chosen.
    options : sequence of Option
    python : str
        Place of the function of the Python interface that does the same; empty if there is none.
    closing : str
        Text at the end of its help, or the place of one.
    group : str
        One of `GROUPS`.
    """

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
        return str(_resolved(self.closing)).strip("\n")

    def option(self, key: str) -> Option:
        """Return the option whose value has this name in the program."""
        return next(one for one in self.options if one.key == key)


@functools.cache
def shared_options() -> dict[str, Option]:
    """Return the options that several verbs share, by the names under which the table has them."""
    return {name: _option(row, {}) for name, row in table()["options"].items()}


@functools.cache
def verbs() -> dict[str, Verb]:
    """Return all verbs by name, in the order of `GROUPS`, those of stoop before those of packages."""
    found = read_verbs({"verbs": table()["verbs"]})
    for package, name, row in packages.rows("verbs", found):
        with packages.guarded(package, f"its verb '{name}'"):
            options = packages.packages()[package].get("options", {})
            found |= read_verbs({"options": options, "verbs": {name: row}})
    for package, content in packages.packages().items():
        with packages.guarded(package, "its options of verbs"):
            for name, row in content.get("more", {}).items():
                added = tuple(_option(one, shared_options()) for one in row["options"])
                if name in found:  # else the package of the verb is absent
                    found[name] = _checked(replace(found[name], options=found[name].options + added))
    return {one.name: one for one in sorted(found.values(), key=lambda verb: GROUPS.index(verb.group))}


def read_verbs(table: Mapping[str, Any]) -> dict[str, Verb]:
    """Return the verbs of a table such as ``data/verbs.toml``, which may name the shared options of that."""
    shared = shared_options() | {n: _option(row, {}) for n, row in table.get("options", {}).items()}
    found = {}
    for name, row in table["verbs"].items():
        options = tuple(_option(one, shared) for one in row["options"])
        more = row.get("python", ""), row.get("epilog", ""), row.get("group", GROUPS[2])
        found[name] = _checked(Verb(name, row["summary"], row["run"], options, *more))
    return found


def _checked(verb: Verb) -> Verb:
    """Return a verb; raise an error where no parser can be made of it."""
    if verb.group not in GROUPS:
        raise ValueError(f"group {verb.group!r}")
    if not isinstance(verb.summary, str) or not re.fullmatch(r"[^%\n]+", verb.summary):
        raise TypeError(f"summary {verb.summary!r}")
    for option in verb.options:
        if not (isinstance(option.name, str) and isinstance(option.help, str) and option.kind in KINDS):
            raise TypeError(f"option {option.name!r}")
    if len({one.key for one in verb.options}) < len(verb.options):
        raise ValueError("two options of one name")
    return verb


@functools.cache
def table() -> dict[str, Any]:
    """Return what stoop offers itself: rows of options and of verbs, and methods of a fitted model."""
    return tomllib.loads((files("stoop.data") / "verbs.toml").read_text("utf-8"))


def _option(row: str | Mapping[str, Any], shared: Mapping[str, Option]) -> Option:
    """Return the option of a row: the name of a shared one, changes of one, or all fields of its own."""
    if isinstance(row, str):
        return shared[row]
    own = [(k, v) for k, v in row.items() if k != "like"]
    fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in own}
    if "choices" in fields:
        fields["allowed"] = fields.pop("choices")
    return replace(shared[row["like"]], **fields) if "like" in row else Option(**fields)


def _resolved(value: Any) -> Any:
    """Return a value, or what the place ``module:NAME`` holds: an object, or a function that returns it."""
    if not isinstance(value, str) or not _PLACE.fullmatch(value):
        return value
    found = packages.resolved(value)
    return found() if callable(found) else found
