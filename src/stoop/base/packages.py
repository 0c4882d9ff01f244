"""Packages that extend stoop, and what they offer: entry points that are data.

A package is an importable ``stoop_NAME`` with a file ``stoop.toml`` in its folder. The file holds places ``module:name``, which
are imported at their first use: rows of ``verbs`` and of ``options`` that several of them share, as ``data/verbs.toml`` has them;
rows of ``more``, options added to a verb of stoop; ``functions`` of ``import stoop``; ``methods`` of a fitted model;
``optimizers``, ``estimators`` and ``decisions`` of a fit, ``targets`` of an export; and ``hooks``, functions that stoop calls.
"""

from __future__ import annotations

import importlib
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

from stoop.errors import PackageWarning, StoopError

PREFIX: Final = "stoop_"
FILE: Final = "stoop.toml"
INTERFACE: Final = 1  #: version of what a package may build on; that of its file must be the same
Made = TypeVar("Made")
LARGEST: Final = 1_000_000  #: bytes of a file


@cache
def packages() -> Mapping[str, Mapping[str, Any]]:
    """Return the content of each package's file by name, those of stoop's wheel first; what cannot be read costs a warning."""
    own, found = Path(__file__).parents[2], dict[str, Mapping[str, Any]]()
    for folder in [str(own), *sys.path]:
        with suppress(OSError, TypeError, ValueError):  # an entry of the path may be no folder
            for path in sorted(Path(folder).glob(f"{PREFIX}*/{FILE}")):
                if path.parent.name not in found and path.is_file():
                    found[path.parent.name] = _content(path)
    return {name: content for name, content in found.items() if content}


def _content(path: Path) -> Mapping[str, Any]:
    """Return the content of a package's file; nothing, with a warning, where it cannot be used."""
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"larger than {LARGEST} bytes")
        content = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        warn(path.parent.name, f"{path} cannot be read ({error})")
        return {}
    made_for = content.get("interface")
    if repr(made_for) != repr(INTERFACE):
        warn(path.parent.name, f"it is made for interface {made_for} of stoop, which has {INTERFACE}")
        return {}
    return content


def tables(kind: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield package and table of all that offer a kind; what is no table costs a warning."""
    for package, content in packages().items():
        table = content.get(kind, {})
        if isinstance(table, Mapping):
            yield package, table
        else:
            warn(package, f"'{kind}' is no table")


def rows(kind: str, taken: Iterable[str] = ()) -> Iterator[tuple[str, str, Any]]:
    """Yield package, name and row of all that packages offer of a kind.

    Of two rows of one name the first is taken, with a warning; names that are `taken` are those of stoop.
    """
    known = dict.fromkeys(taken, "stoop")
    for package, table in tables(kind):
        for name, row in table.items():
            if name in known:
                warn(package, f"'{name}' of its {kind} is one of {known[name]} already")
            else:
                known[name] = package
                yield package, name, row


def made(kind: str, what: str, make: Callable[..., Made], taken: Iterable[str]) -> dict[str, Made]:
    """Return what packages offer of a kind by name, each made of the keys of its row; see `rows`."""
    out = dict[str, Made]()
    for package, name, row in rows(kind, taken):
        with guarded(package, f"its {what} '{name}'"):
            out[name] = make(**row)
    return out


def places(kind: str, taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the places of all functions, or methods, that packages offer, by name; see `rows`."""
    return {n: str(place) for _, n, place in rows(kind, taken) if n.isidentifier() and n[0] != "_"}


def hooks(name: str) -> list[Callable[..., Any]]:
    """Return the functions of all packages that stoop calls under a name; one that cannot be imported costs a warning."""
    offered = ((package, table[name]) for package, table in tables("hooks") if name in table)
    return [one for package, place in offered for one in found(package, f"its hook '{name}'", place)]


def found(package: str, what: str, place: str) -> list[Any]:
    """Return the object of a place; nothing, with a warning, where it cannot be imported."""
    try:
        return [resolved(place)]
    except (StoopError, ImportError) as error:
        warn(package, f"{what} is left out: {error}")
        return []


def hook(name: str, needed_by: str) -> Callable[..., Any]:
    """Return the first function that stoop calls under a name; raises `StoopError` where no package has one."""
    if known := hooks(name):
        return known[0]
    raise StoopError(f"{needed_by} needs a package that this installation lacks; install stoop anew")


def resolved(place: str) -> Any:
    """Import the object of a place ``module:name``; raises `StoopError` where that of a package cannot be imported."""
    module, _, name = str(place).partition(":")
    package = module.partition(".")[0]
    try:
        return getattr(importlib.import_module(module), name)
    except Exception as error:
        missing = str(getattr(error, "name", None) or package).partition(".")[0]
        library = isinstance(error, ModuleNotFoundError) and missing != package and missing[:5] != "stoop"
        if library or package == "stoop":
            raise  # of an extra, or an error of stoop's own
        raise StoopError(
            f"{package}: '{place}' cannot be imported ({error}); update, install or remove the package"
        ) from error


@contextmanager
def guarded(package: str, what: str) -> Iterator[None]:
    """Leave a part of a package out, with a warning, where it cannot be read."""
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        warn(package, f"{what} cannot be read ({error!r})")


def warn(package: str, what: str) -> None:
    """Warn that a package, or a part of it, is left out, and why."""
    warnings.warn(f"{package}: {what}; update or remove the package", PackageWarning, stacklevel=3)
