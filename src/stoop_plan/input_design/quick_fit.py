"""Quick fits of windows: one to linearize about, then that of `stoop identify` by the method that it takes by itself.

The error bars of the latter are those that identification publishes: with the color and the level of the flight's own
residuals, priors, unknown initial states and biases, and the scatter of the maneuvers. Nothing of what the fit will say is
worked out twice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from stoop import Flight, Options, Strategy, Vehicle
from stoop.extend.errors import FlightError, IdentificationError
from stoop.extend.fits import ErrorBars, assume, setup_of
from stoop.extend.fits import fit as fit_by
from stoop.extend.flights import Window

#: of a vehicle that is complete, and data that are clean
FIT_ALONE: Final = Strategy.default().without("faults", "assumptions", "sensor-delays")
#: a search that has not ended by then finds several optima, and which of them would not make other windows worth more
QUICK: Final = Options(budget=15_000.0)
#: of a fit about whose estimates windows are linearized: it need not be the best one, and its error bars are not asked for
FIRST: Final = FIT_ALONE.without("gusts", "bounds")


@dataclass(frozen=True)
class QuickFit:
    """Estimates and standard errors of free numbers by name, SI; none where the fit failed, with the reason.

    A number at a bound has NaN as estimate and an infinite error.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    failure: str = ""


def with_assumptions(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> Vehicle:
    """Return the vehicle with what its file leaves out free, as identification has it: from another delay no fit converges."""
    setup = setup_of(FIT_ALONE, vehicle, _used(flights, windows), windows)
    found = assume(setup)
    return vehicle if found is None else found.setup.vehicle


def first_fit(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> dict[str, float]:
    """Return estimates (SI) of free numbers by name, in calm air; none of what a bound holds, or where it fails."""
    try:
        fit = fit_by(FIRST, vehicle, _used(flights, windows), windows, options=QUICK).estimate
    except (FlightError, IdentificationError):
        return {}
    held = {one.name for one in fit.unknowns if one.fixed == "bound"}
    return {name: value for name, value in fit.start.items() if name not in held}


def quick_fit(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], known: Mapping[str, float]
) -> QuickFit:
    """Fit the free numbers of a vehicle to windows of flights as identification does, from known estimates (SI) by name.

    A fit that fails is a value.
    """
    options = replace(QUICK, start=known)
    try:
        fit = fit_by(FIT_ALONE, vehicle, _used(flights, windows), windows, options=options).estimate
        bars = ErrorBars.of(fit)
    except (FlightError, IdentificationError) as error:
        return QuickFit(failure=str(error))
    held = dict(zip(fit.estimates, bars.at_bound, strict=False))
    values = {name: math.nan if held[name] else value for name, value in fit.estimates.items()}
    errors = {n: math.inf if held[n] else float(std) for n, std in zip(values, bars.std, strict=False)}
    return QuickFit(values, errors)


def _used(flights: Mapping[str, Flight], windows: Sequence[Window]) -> dict[str, Flight]:
    """Return the flights of windows."""
    return {name: flight for name, flight in flights.items() if any(w.flight == name for w in windows)}
