"""Optimizers by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from stoop.errors import IdentificationError
from stoop.optimize.methods.ps_gde_lm import PsGdeLm
from stoop.optimize.pieces.evolution import de_best_2_bin, de_rand_1_bin, ps_gde
from stoop.optimize.state import Optimizer

DEFAULT: Final = "ps-gde-lm"

_MAKERS: Final[dict[str, Callable[[], Optimizer[Any]]]] = {
    "ps-gde-lm": PsGdeLm,
    "ps-gde": ps_gde,
    "de-rand-1-bin": de_rand_1_bin,
    "de-best-2-bin": de_best_2_bin,
}


def names() -> tuple[str, ...]:
    """Return the names of all optimizers, the default first."""
    return tuple(_MAKERS)


def create(name: str = DEFAULT) -> Optimizer[Any]:
    """Return the optimizer of a name.

    Raises
    ------
    IdentificationError
        If there is none of that name.
    """
    if name not in _MAKERS:
        raise IdentificationError(
            f"optimizer {name}: there is none of that name; use one of {', '.join(_MAKERS)}"
        )
    return _MAKERS[name]()
