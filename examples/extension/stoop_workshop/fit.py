"""An estimator, a decision and an optimizer of fits."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from stoop import Flight, Options, Vehicle
from stoop.extend import fits
from stoop.extend.flights import Window

SHORTEST = 1.0  #: s


def anchored(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options, *more: Any
) -> fits.Estimate:
    """Fit by output error; a free number without a prior gets one of its own size about the file's value."""
    free = [p for p in vehicle.parameters if p.prior is None and vehicle.value(p.name)]
    priors = {p.name: {"prior": abs(vehicle.value(p.name))} for p in free}
    fitter = fits.methods.find("output-error").fitter()
    found: fits.Estimate = fitter(vehicle.with_numbers(priors), flights, windows, options, *more)
    return found


def long_windows(setup: fits.Setup) -> fits.Change | None:
    """Leave windows out that are shorter than a second, unless all are."""
    kept = [one for one in setup.fitted if one.stop - one.start >= SHORTEST]
    if not kept or len(kept) == len(setup.fitted):
        return None
    left = len(setup.fitted) - len(kept)
    return fits.Change(replace(setup, fitted=kept), f"{left} shorter than {SHORTEST:g} s", "left out")


def nelder_mead() -> fits.Library:
    """Return the simplex of Nelder and Mead, from one start after another."""

    def search(ledger: Any, start: np.ndarray, _: np.random.Generator) -> None:
        def cost(x: np.ndarray) -> float:
            return float(min(ledger.costs(x[None], ledger.full)[0], 1e100))

        minimize(cost, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(start))

    return fits.Library("nelder-mead", search)
