"""Optimizers by name; packages add theirs (`stoop.base.packages`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import isfinite
from typing import Any, Final, runtime_checkable

from stoop.base.packages import guarded, made
from stoop.errors import IdentificationError
from stoop.optimize.state import Optimizer

DEFAULT: Final = "ps-gde-lm"


@dataclass(frozen=True)
class Entry:
    """One optimizer; its module is imported when it is created."""

    make: str  #: ``module:function`` that returns the optimizer
    residuals: bool = False  #: whether it asks for residuals, not only for costs
    plans: bool = False  #: whether `make` takes the number of planned evaluations, None where it is not known
    #: ``module:class`` of its state, so that saved ones can be loaded; empty for the states of this package
    state: str = ""


@cache
def _entries() -> Mapping[str, Entry]:
    """Return the built-in optimizers and those of packages."""
    return made("optimizers", Entry)


def names() -> tuple[str, ...]:
    """Return the names of all optimizers, the default first.

    Those of the extra "compare" are among them, whether its packages are installed or not.
    """
    return tuple(_entries())


def state_classes() -> dict[str, str]:
    """Return class and module of the states of other packages' optimizers."""
    places = (entry.state.partition(":") for entry in _entries().values() if entry.state)
    return {name: module for module, _, name in places}


def create(name: str = DEFAULT, budget: float | None = None) -> Optimizer[Any]:
    """Return the optimizer of a name.

    The budget, evaluations planned in trajectories of the full record, is for those that plan ahead (they shrink their
    population towards its end), and ignored by all others. Infinity is the same as None.

    Raises
    ------
    IdentificationError
        If there is none of that name, or its package is not installed.
    """
    entry = _entry(name)
    planned = None if budget is None or not isfinite(budget) else budget
    make = guarded(entry.make, runtime_checkable(Optimizer))
    optimizer: Optimizer[Any] = make(planned) if entry.plans else make()
    return optimizer


def needs_residuals(name: str) -> bool:
    """Whether an optimizer asks for residuals; such a one cannot be run on a problem that has only costs."""
    return _entry(name).residuals


def _entry(name: str) -> Entry:
    """Return what is registered under a name."""
    entry = _entries().get(name)
    if entry is None:
        raise IdentificationError(
            f"optimizer {name}: there is none of that name; use one of {', '.join(_entries())}"
        )
    return entry
