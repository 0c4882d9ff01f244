"""Optimizers by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

from stoop.errors import IdentificationError
from stoop.optimize.adapters.cma_bipop import cma
from stoop.optimize.adapters.pygmo_sade import pygmo_sade
from stoop.optimize.adapters.pymoo_loop import pymoo_ga, pymoo_pso
from stoop.optimize.adapters.scipy_de import scipy_de
from stoop.optimize.adapters.scipy_least_squares import scipy_least_squares
from stoop.optimize.methods.asmde import asmde
from stoop.optimize.methods.de_best_2_bin import de_best_2_bin
from stoop.optimize.methods.de_rand_1_bin import de_rand_1_bin
from stoop.optimize.methods.derl import derl
from stoop.optimize.methods.ga import GeneticAlgorithm
from stoop.optimize.methods.hybrid import hybrid
from stoop.optimize.methods.jso import jso
from stoop.optimize.methods.l_shade import l_shade
from stoop.optimize.methods.multi_population import multi_population
from stoop.optimize.methods.ordered_shade import OrderedShade
from stoop.optimize.methods.ps_gde import ps_gde
from stoop.optimize.methods.ps_gde_lm import PsGdeLm
from stoop.optimize.methods.pso import ParticleSwarm
from stoop.optimize.methods.sacpmde import sacpmde
from stoop.optimize.methods.trigonometric import trigonometric
from stoop.optimize.methods.weighted_centroid import weighted_centroid
from stoop.optimize.state import Optimizer

DEFAULT: Final = "ps-gde-lm"


@dataclass(frozen=True)
class Entry:
    """One optimizer.

    Attributes
    ----------
    make : from the evaluations planned (None: not said) to the optimizer
    residuals : whether it asks for residuals, not only for costs
    """

    make: Callable[[float | None], Optimizer[Any]]
    residuals: bool = False


def _plain(make: Callable[[], Optimizer[Any]]) -> Callable[[float | None], Optimizer[Any]]:
    """Return a maker that does not plan ahead."""
    return lambda budget: make()


_ENTRIES: Final[dict[str, Entry]] = {
    "ps-gde-lm": Entry(_plain(PsGdeLm), residuals=True),
    "ps-gde": Entry(_plain(ps_gde)),
    "de-rand-1-bin": Entry(_plain(de_rand_1_bin)),
    "de-best-2-bin": Entry(_plain(de_best_2_bin)),
    "weighted-centroid": Entry(_plain(weighted_centroid)),
    "multi-population": Entry(_plain(multi_population)),
    "hybrid": Entry(_plain(hybrid)),
    "trigonometric": Entry(_plain(trigonometric)),
    "sacpmde": Entry(_plain(sacpmde)),
    "asmde": Entry(_plain(asmde)),
    "derl": Entry(_plain(derl)),
    "ga": Entry(_plain(GeneticAlgorithm)),
    "pso": Entry(_plain(ParticleSwarm)),
    "ordered-shade": Entry(_plain(OrderedShade)),
    "l-shade": Entry(l_shade),
    "jso": Entry(jso),
    "scipy-de": Entry(_plain(scipy_de)),
    "scipy-least-squares": Entry(_plain(scipy_least_squares), residuals=True),
    "pymoo-ga": Entry(_plain(pymoo_ga)),
    "pymoo-pso": Entry(_plain(pymoo_pso)),
    "cma": Entry(_plain(cma)),
    "pygmo-sade": Entry(_plain(pygmo_sade)),
}


def names() -> tuple[str, ...]:
    """Return the names of all optimizers, the default first.

    Those of the extra "compare" are among them, whether its packages are installed or not.
    """
    return tuple(_ENTRIES)


def create(name: str = DEFAULT, budget: float | None = None) -> Optimizer[Any]:
    """Return the optimizer of a name.

    Parameters
    ----------
    name : str
    budget : float, optional
        Evaluations planned, in trajectories of the full record; for those that plan ahead (they shrink their
        population towards its end), ignored by all others. Infinity is as good as not said.

    Raises
    ------
    IdentificationError
        If there is none of that name, or its package is not installed.
    """
    return _entry(name).make(None if budget is None or not isfinite(budget) else budget)


def needs_residuals(name: str) -> bool:
    """Whether an optimizer asks for residuals; such a one cannot be run on a problem that has only costs.

    Raises
    ------
    IdentificationError
        If there is none of that name.
    """
    return _entry(name).residuals


def _entry(name: str) -> Entry:
    """Return what is registered under a name."""
    if name not in _ENTRIES:
        raise IdentificationError(
            f"optimizer {name}: there is none of that name; use one of {', '.join(_ENTRIES)}"
        )
    return _ENTRIES[name]
