"""Optimizers as a plan writes them: a name, or a table of what differs from the paper's PS-GDE.

``{"name": "ps-gde", "scale": 0.5, "mutation": "unordered", "search": "none"}`` is PS-GDE with F = 0.5, without
sorting and without local search. What is left out is as the paper has it.
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

PIECES: Final[Mapping[str, Mapping[str, Any]]] = {
    "mutation": {"ordered": ordered, "unordered": unordered},
    "initialization": {"chaos": chaos, "uniform": uniform, "latin-hypercube": latin_hypercube},
    "search": {"steepest": SteepestDescent(), "levenberg": LevenbergMarquardt(), "none": None},
}  #: what a table may name
_COMPOSED: Final = ("mutation", "initialization", "scale", "rate", "members")
_SCHEDULED: Final = ("search", "period", "share", "swapped")
Variant = str | Mapping[str, Any]


def build(variant: Variant, budget: float | None = None) -> Optimizer[Any]:
    """Return the optimizer that a plan asks for.

    Parameters
    ----------
    variant : str or mapping
    budget : float, optional
        Evaluations planned; for optimizers that plan ahead.

    Raises
    ------
    IdentificationError
        There is no such optimizer, or a table says something else than these pieces.
    """
    if isinstance(variant, str):
        return optimize.create(variant, budget)
    changes = {k: _piece(k, v) for k, v in variant.items() if k != "name"}
    unknown = set(changes) - {*_COMPOSED, *_SCHEDULED}
    if variant.get("name") != "ps-gde" or unknown:
        wrong = min(unknown, default=f"name {variant.get('name')}")
        raise IdentificationError(f"variant: no {wrong} can be chosen; variants are of ps-gde and its pieces")
    scheduled = {"search": PIECES["search"]["steepest"]} | {
        k: v for k, v in changes.items() if k in _SCHEDULED
    }
    prey = None if scheduled["search"] is None else PreySchedule(**scheduled)
    return ps_gde(prey=prey, **{k: v for k, v in changes.items() if k in _COMPOSED})


def _piece(key: str, value: Any) -> Any:
    """Return the piece of a name, or the number itself."""
    if key not in PIECES:
        return value
    if value not in PIECES[key]:
        raise IdentificationError(f"variant: no {key} {value}; use one of {', '.join(PIECES[key])}")
    return PIECES[key][value]
