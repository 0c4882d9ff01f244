"""Optimizers as a plan writes them: a name, or a table of what differs from the paper's PS-GDE."""

from __future__ import annotations

from typing import Any

from stoop import optimize
from stoop.optimize.state import Optimizer


def build(variant: Any, budget: float | None = None) -> Optimizer[Any]:
    """Return the optimizer that a plan names.

    Parameters
    ----------
    variant : str
    budget : float, optional
        Evaluations planned; for optimizers that plan ahead.

    Raises
    ------
    IdentificationError
        There is no such optimizer.
    """
    return optimize.create(variant)
