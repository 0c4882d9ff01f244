"""Packages that extend stoop, and what they offer: entry points that are data.

A package is an importable ``stoop_NAME`` with a file ``stoop.toml`` in its folder, in the tables of ``data/packages.toml``;
``data/verbs.toml`` has those of stoop. Places ``module:name`` in them are imported at their first use.

A package of somebody else cannot break stoop: rows of other forms are left out, and `guarded` calls its functions.
"""

from __future__ import annotations

import importlib
import re
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from traceback import walk_tb
from typing import Any, Final, TypeVar, get_args, get_origin

from stoop.base.text import nearest
from stoop.errors import PackageError, PackageWarning, StoopError, one_line, raised_at

PREFIX: Final = "stoop_"
FILE: Final = "stoop.toml"
INTERFACE: Final = 1  #: version of what a package may build on; that of its file must be the same
LARGEST: Final = 1_000_000  #: bytes of a file
#: stoop and the packages of its wheel, whose errors are its own
OWN: Final = (
    "stoop", "stoop_analysis", "stoop_app", "stoop_draft", "stoop_export", "stoop_fleet", "stoop_plan", "stoop_studies",
    "stoop_tune",
)  # fmt: skip
Made = TypeVar("Made")


@cache
def packages() -> Mapping[str, Mapping[str, Any]]:
    """Return the tables of each package by name, those of stoop and its wheel first; what is wrong with them costs warnings."""
    found: dict[str, Mapping[str, Any]] = {"stoop": _table("verbs")}
    for folder in [str(Path(__file__).parents[2]), *sys.path]:
        with suppress(OSError, TypeError, ValueError):  # an entry of the path may be no folder
            for name, path in sorted(_files(Path(folder)), key=lambda one: (one[0] not in OWN, *one)):
                if name not in found and path.is_file():
                    found[name] = _content(name, path)
    return found


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield names and files of the packages in a folder, and of those of which only the installation is recorded in it."""
    for path in folder.glob(f"{PREFIX}*"):
        if path.suffix != ".dist-info":
            yield path.name, path / FILE
            continue
        name = path.name.partition("-")[0]
        with suppress(Exception):  # of the finder by which the package is imported
            for place in find_spec(name).submodule_search_locations:  # type: ignore[union-attr]
                yield name, Path(place, FILE)


def _content(package: str, path: Path) -> Mapping[str, Any]:
    """Return the tables of a package's file without rows that are not of the forms of ``data/packages.toml``."""
    kept = dict[str, dict[str, Any]]()
    with left_out(package):
        if path.stat().st_size > LARGEST:
            raise ValueError(f"it is larger than {LARGEST} bytes; make it smaller")
        content = tomllib.loads(path.read_text("utf-8"))
        if repr(made_for := content.pop("interface", None)) != repr(INTERFACE):
            raise ValueError(f"interface is {made_for!r}, and this stoop has interface = {INTERFACE}")
        if package in OWN:
            return content
        known = _table("packages")["tables"]
        for kind, table in content.items():
            with left_out(package):
                if kind not in known:
                    raise ValueError(f"stoop reads no [{kind}]; {nearest(kind, known)}")
                check("table", table, package, kind)
                for name, row in table.items():
                    with left_out(package):
                        check(known[kind][0], name, package, f"a name in [{kind}]")
                        check(known[kind][1], row, package, f"{kind}.{name}")
                        kept.setdefault(kind, {})[name] = row
    return kept


@cache
def _table(name: str) -> Mapping[str, Any]:
    """Return a file of stoop's data: ``packages`` with the forms of what a package's file may hold, or ``verbs``."""
    return tomllib.loads((Path(__file__).parents[1] / "data" / f"{name}.toml").read_text("utf-8"))


def check(form: str, value: Any, package: str, where: str) -> None:
    """Raise a `ValueError`, which says what to write, where a value is not of a form of the schema."""
    forms, rows, words = form.split("|"), _table("packages")["rows"], []
    if isinstance(value, list) and "*" in form:
        for one in value:
            check("|".join(one[:-1] for one in forms if one[-1] == "*"), one, package, where)
        return
    for row in (rows[one] for one in forms if one in rows and isinstance(value, Mapping)):
        keys = {key.rstrip("!"): of for key, of in row.items()}
        for key in (*value, *(key.rstrip("!") for key in row if key[-1] == "!")):
            if key not in keys:
                raise ValueError(f"{where}.{key} is unknown; {nearest(key, keys)}")
            if key not in value:
                raise ValueError(f"{where}.{key} is missing; add it")
            check(keys[key], value[key], package, f"{where}.{key}")
        return
    for one in forms:
        types, pattern, said = _table("packages")["forms"].get(one.rstrip("*"), ([], "", "a table"))
        known = one[-1] != "*" and type(value).__name__ in types
        if known and (not pattern or re.fullmatch(pattern.replace("PACKAGE", package), value)):
            return
        words.append(f"a list, each {said}" if one[-1] == "*" else said)
    raise ValueError(f"{where} is {value!r}; write {' or '.join(words)}".replace("PACKAGE", package))


def tables(kind: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield package and table of all that offer a kind."""
    return ((package, content[kind]) for package, content in packages().items() if kind in content)


def rows(kind: str, taken: Iterable[str] = ()) -> Iterator[tuple[str, str, Any]]:
    """Yield package, name and row of all that packages offer of a kind.

    Of two rows of one name the first is taken, with a warning; names that are `taken` are those of stoop.
    """
    known = dict.fromkeys(taken, "stoop")
    for package, table in tables(kind):
        for name, row in table.items():
            if (first := known.setdefault(name, package)) != package:
                warn(str(fault(package, f"'{name}' in [{kind}] is a name of {first} already; rename it")))
            else:
                yield package, name, row


def made(kind: str, make: Callable[..., Made]) -> dict[str, Made]:
    """Return what stoop and packages offer of a kind by name, each made of the keys of its row; see `rows`."""
    return {name: make(**row) for _, name, row in rows(kind)}


def places(kind: str, taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the places of all functions, or methods, that packages offer, by name; see `rows`."""
    return {name: place for _, name, place in rows(kind, taken)}


def resolved(place: str) -> Any:
    """Import the object of a place ``module:name``; raises `PackageError` where that of a package cannot be imported."""
    module, _, name = place.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:
        lacking = (isinstance(error, ModuleNotFoundError) and error.name) or "stoop"
        library = not lacking.startswith("stoop")
        if (package := package_of(place)) == "stoop" or (library and package in OWN):
            raise  # of an extra, or an error of stoop's own
        why = f"without the library {lacking}; install it" if library else f"({described(error)})"
        raise fault(package, f"'{place}' cannot be imported {why}") from error


def found(place: str) -> list[Any]:
    """Return the object of a place; nothing, with a warning, where it cannot be imported."""
    try:
        return [resolved(place)]
    except (PackageError, ImportError) as error:
        warn(str(error))
        return []


def guarded(place: str, kind: Any, instead: Callable[..., Any] | None = None) -> Callable[..., Any]:
    """Return the function of a place; one of somebody else's package fails by a line that names the package.

    Its result is of a `kind`: a type, a union, or ``list[type]``; an object in the place of a function is the result. Where the
    function fails, `instead` is called, and the line is a warning; without it the line is a `PackageError`, and errors and
    exits that are meant for the user pass.
    """
    if (package := package_of(place)) in OWN or not package.startswith(PREFIX):
        return resolved(place)  # type: ignore[no-any-return]

    def call(*given: Any, **options: Any) -> Any:
        try:
            function = resolved(place)
            value = function(*given, **options) if callable(function) else function
            if _is(value, kind):
                return value
            name = kind.__name__ if isinstance(kind, type) else re.sub(r"\w+\.", "", str(kind))
            error = fault(package, f"'{place}' gives a {type(value).__name__} that is no {name}")
        except PackageError as known:
            error = known
        except (Exception, SystemExit) as raised:
            if instead is None and isinstance(
                raised, StoopError | SystemExit | BrokenPipeError | MemoryError
            ):
                raise
            error = fault(package, f"'{place}' failed ({described(raised)})")
            error.__cause__ = raised
        if instead is None:
            raise error
        warn(str(error))
        return instead(*given, **options)

    return call


def _is(value: Any, kind: Any) -> bool:
    """Tell whether a value is of a kind; a tuple is as good as a list."""
    if get_origin(kind) is not list:
        return isinstance(value, kind)
    return isinstance(value, list | tuple) and all(isinstance(one, get_args(kind)[0]) for one in value)


def _usable(name: str) -> list[str]:
    """Return the places under a name in the hooks of all packages, without those that cannot be imported."""
    return [table[name] for _, table in tables("hooks") if name in table and found(table[name])]


@cache
def hooks(name: str, kind: Any) -> list[Callable[..., Any]]:
    """Return the functions of all packages that stoop calls under a name; one that fails returns an empty result of the kind."""
    return [guarded(place, kind, lambda *_, **__: kind()) for place in _usable(name)]


def hook(name: str, needed_by: str, kind: Any) -> Callable[..., Any]:
    """Return the first function that stoop calls under a name; raises `StoopError` where no package has one."""
    if not (usable := _usable(name)):
        raise StoopError(f"{needed_by} needs a package that this installation lacks; install stoop anew")
    used, *others = map(package_of, usable)
    for package in others:
        warn(str(fault(package, f"its {name} is not used, as that of {used} is")))
    return guarded(usable[0], kind)


@contextmanager
def left_out(package: str, where: str = FILE) -> Iterator[None]:
    """Leave a part of a package's file out, with a warning, where an error says what is wrong with it."""
    try:
        yield
    except (OSError, ValueError, RecursionError) as error:
        warn(str(fault(package, f"{where}: {error}")))


def package_of(place: str) -> str:
    """Return the package of a module, or of a place in it."""
    return place.partition(":")[0].partition(".")[0]


def others() -> list[str]:
    """Return the packages of somebody else that were imported."""
    return [name for name in packages() if name in sys.modules and name not in OWN]


def culprit(error: BaseException) -> PackageError | None:
    """Return an error as that of somebody else's package whose code it passed last; None for others, and of the machine."""
    passed = [package_of(str(frame.f_globals.get("__name__"))) for frame, _ in walk_tb(error.__traceback__)]
    last = [] if isinstance(error, OSError | MemoryError) else [name for name in passed if name in others()]
    return fault(last[-1], described(error)) if last else None


def described(error: BaseException) -> str:
    """Return kind, message and place of an error."""
    return f"{type(error).__name__}: {error!s:.400}, {raised_at(error)}"


def fault(package: str, what: str) -> PackageError:
    """Return the error that something is wrong with a package."""
    return PackageError(one_line(f"{package}: {what}; update or remove the package"))


@cache
def warn(line: str) -> None:
    """Warn that a package, or a part of it, is left out, and why; once in a process."""
    warnings.warn(line, PackageWarning, stacklevel=3)
