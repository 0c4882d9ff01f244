"""Packages that extend stoop, and what they offer: entry points that are data.

A package is an importable ``stoop_NAME`` with a file ``stoop.toml`` in its folder. The file holds places ``module:name``, which
are imported at their first use: rows of ``verbs`` and of ``options`` that several of them share, as ``data/verbs.toml`` has them;
rows of ``more``, options added to a verb of stoop; ``functions`` of ``import stoop``; ``methods`` of a fitted model;
``optimizers``; and ``hooks``, functions that stoop calls by name.
"""

from __future__ import annotations

import importlib
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

from stoop.errors import PackageWarning, StoopError

PREFIX: Final = "stoop_"
FILE: Final = "stoop.toml"
INTERFACE: Final = 1  #: version of what a package may build on; that of its file must be the same
LARGEST: Final = 1_000_000  #: bytes of a file


@cache
def packages() -> Mapping[str, Mapping[str, Any]]:
    """Return the content of each package's file, by name of the package; one that cannot be read is left out with a warning."""
    places = [path for folder in sys.path for path in Path(folder).glob(f"{PREFIX}*/{FILE}")]
    found = {}
    for name, path in sorted({path.parent.name: path for path in reversed(places)}.items()):
        try:
            with path.open("rb") as file:
                content = tomllib.loads(file.read(LARGEST).decode("utf-8"))
        except (OSError, ValueError) as error:
            warn(name, f"{path} cannot be read ({error})")
            continue
        if content.get("interface") != INTERFACE:
            warn(name, f"it is made for interface {content.get('interface')} of stoop, which has {INTERFACE}")
            continue
        found[name] = content
    return found


def rows(kind: str, taken: Iterable[str] = ()) -> Iterator[tuple[str, str, Any]]:
    """Yield package, name and row of all that packages offer of a kind.

    Of two rows of one name the first is taken, with a warning; names that are `taken` are those of stoop.
    """
    known = dict.fromkeys(taken, "stoop")
    for package, content in packages().items():
        table = content.get(kind, {})
        if not isinstance(table, Mapping):
            warn(package, f"'{kind}' is no table")
            continue
        for name, row in table.items():
            if name in known:
                warn(package, f"'{name}' of its {kind} is one of {known[name]} already")
            else:
                known[name] = package
                yield package, name, row


def places(kind: str, taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the places of all functions, or methods, that packages offer, by name; see `rows`."""
    return {name: str(place) for _, name, place in rows(kind, taken)}


def hooks(name: str) -> list[Callable[..., Any]]:
    """Return the functions of all packages that stoop calls under a name."""
    tables = (content.get("hooks", {}) for content in packages().values())
    return [resolved(table[name]) for table in tables if name in table]


def hook(name: str, needed_by: str) -> Callable[..., Any]:
    """Return the first function that stoop calls under a name; raises `StoopError` where no package has one."""
    found = hooks(name)
    if not found:
        raise StoopError(f"{needed_by} needs a package that this installation lacks; install stoop anew")
    return found[0]


def resolved(place: str) -> Any:
    """Return what a place ``module:name`` holds; raises `StoopError` where it cannot be imported."""
    module, _, name = place.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        if isinstance(error, ModuleNotFoundError) and error.name and not module.startswith(error.name):
            raise  # a library of an extra
        package = module.partition(".")[0]
        raise StoopError(
            f"{package}: '{place}' cannot be imported ({error}); update or remove the package"
        ) from error


def warn(package: str, what: str) -> None:
    """Warn that a package, or a part of it, is left out, and why."""
    warnings.warn(f"{package}: {what}; update or remove the package", PackageWarning, stacklevel=3)
