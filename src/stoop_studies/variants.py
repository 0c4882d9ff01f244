"""Optimizers by name, and variants of the paper's PS-GDE: ``ps-gde:scale=0.5:mutation=unordered:search=none``.

That is PS-GDE with F = 0.5, without sorting and without local search. What is left out is as the paper has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize.population import latin_hypercube
from stoop.optimize.state import Optimizer
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.evolution import chaos, uniform
from stoop_studies.optimizers.local_search import LevenbergMarquardt, PreySchedule, SteepestDescent
from stoop_studies.optimizers.mutation import ordered, unordered

#: what can be chosen by a word
PIECES: Final[Mapping[str, Mapping[str, Any]]] = {
    "mutation": {"ordered": ordered, "unordered": unordered},
    "initialization": {"chaos": chaos, "uniform": uniform, "latin-hypercube": latin_hypercube},
    "search": {"steepest": SteepestDescent(), "levenberg": LevenbergMarquardt(), "none": None},
    "swapped": {"no": False, "yes": True},
}
#: what is a number
NUMBERS: Final = {"scale": float, "rate": float, "members": int, "period": int, "share": float}
_SCHEDULED: Final = ("search", "period", "share", "swapped")


def build(name: str, budget: float | None = None) -> Optimizer[Any]:
    """Return the optimizer of a name, or a variant of PS-GDE.

    Parameters
    ----------
    name : str
    budget : float, optional
        Evaluations planned; for optimizers that plan ahead.

    Raises
    ------
    IdentificationError
        There is no such optimizer, or a variant of another one or of something else than these pieces.
    """
    base, *changes = name.split(":")
    if not changes:
        return optimize.create(name, budget)
    if base != "ps-gde":
        raise IdentificationError(f"optimizer {name}: there are variants of ps-gde only")
    given = dict(_piece(name, *change.partition("=")[::2]) for change in changes)
    scheduled = {"search": SteepestDescent(), **{k: given.pop(k) for k in _SCHEDULED if k in given}}
    prey = None if scheduled["search"] is None else PreySchedule(**scheduled)
    return ps_gde(prey=prey, **given)


def needs_residuals(name: str) -> bool:
    """Whether an optimizer or a variant asks for residuals; such a one cannot be run on a problem that has only costs."""
    return optimize.needs_residuals(name.partition(":")[0]) or "search=levenberg" in name.split(":")


def _piece(variant: str, key: str, word: str) -> tuple[str, Any]:
    """Return the field and the value of a change."""
    if key in NUMBERS:
        try:
            return key, NUMBERS[key](word)
        except ValueError:
            raise IdentificationError(f"optimizer {variant}: {key} is a number, not '{word}'") from None
    if key not in PIECES:
        known = ", ".join((*PIECES, *NUMBERS))
        raise IdentificationError(f"optimizer {variant}: no {key} can be chosen; use one of {known}")
    if word not in PIECES[key]:
        raise IdentificationError(
            f"optimizer {variant}: no {key} {word}; use one of {', '.join(PIECES[key])}"
        )
    return key, PIECES[key][word]
