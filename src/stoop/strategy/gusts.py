"""Filter error where air data and inertial sensors show gusts; the method of calm air where it does not explain them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from stoop.base.notices import Notice, notice
from stoop.errors import IdentificationError
from stoop.estimate import methods
from stoop.estimate.filter_likelihood import SCORING
from stoop.estimate.gusts import doubt, exceed_sensors, gust_bias, gust_levels, unexplained, with_turbulence
from stoop.results.decisions import DecisionRecord
from stoop.strategy.decision import Change, Decision, Fitted, Fitter, Setup
from stoop.strategy.instability import late_sensors
from stoop.vehicle.channels import AIR_FRAME

NAME: Final = "gusts"
IN_GUSTS: Final = "filter-error"
#: take the effect of gusts for that of the aircraft
CALM: Final = frozenset({methods.DEFAULT, "multiple-shooting"})
#: notices of the method that a filter replaces
REPLACED: Final = frozenset({"unstable"})


def look_for_gusts(setup: Setup) -> Change | None:
    """Return the fit by filter error with gusts among the unknowns, if there are any; a named method stays."""
    calm = setup.options.method
    if setup.vehicle.frame != AIR_FRAME or not setup.fitted or not (setup.free_method or calm in CALM):
        return None
    levels = gust_levels(setup.vehicle, setup.flights, setup.fitted)
    if not exceed_sensors(setup.vehicle, levels):
        return None
    gusts = dict(zip("uvw", levels.tolist(), strict=True))
    found = f"gusts of {gusts['u']:.2f}, {gusts['v']:.2f} and {gusts['w']:.2f} m/s rms (u, v, w)"
    if not setup.free_method or late_sensors(setup):
        ignored = notice("gusts-ignored", **gusts, method=calm, other=IN_GUSTS)
        return Change(setup.noting(ignored), found, f"{calm} kept, which takes no gusts")
    why = notice("gusts-filtered", **gusts, method=IN_GUSTS, other=calm)
    kept = tuple(one for one in setup.notices if one.code not in REPLACED)
    changed = replace(setup, in_calm=calm, notices=(*kept, why)).by(IN_GUSTS)
    return Change(changed, found, f"{IN_GUSTS}, with gusts among the unknowns")


def fit_in_gusts(setup: Setup, fit: Fitter) -> Fitted:
    """Return the fit with gusts; by the method of calm air where the filter diverges or does not explain the residuals."""
    if not setup.in_calm:
        found = fit(setup)
        if not any(n.code == "gusts-ignored" for n in found.setup.notices):
            return found
        return found.noting(*gust_bias(found.estimate, found.setup.flights))
    began, calm = time.perf_counter(), None
    filtered, doubts = None, tuple[Notice, ...]()
    resumed = _calm_search(setup) is not None
    if not resumed or setup.options.start:
        filtered, doubts = _filtered(setup, fit, setup.options.start, gives_up=True)
    if (resumed or doubts) and not setup.options.start:  # the estimates in calm air are another start
        with suppress(IdentificationError):  # a filter may follow what no simulation does
            calm = fit(_in_calm_air(setup))
        if calm is not None and calm.estimate.outcome.status == "interrupted":
            return calm
        known = {} if calm is None else calm.estimate.start
        filtered, doubts = _filtered(setup, fit, known, gives_up=bool(known))
    if filtered is not None and not doubts:
        return filtered
    record = replace(
        setup.records.get(NAME, DecisionRecord(NAME, "applied")),
        found="; ".join(map(str, doubts)),
        done=f"{setup.in_calm} instead of {setup.options.method}",
        seconds=time.perf_counter() - began,
    )
    calm = calm or fit(_in_calm_air(setup))
    return replace(calm, setup=calm.setup.noting(*doubts)).recorded(record)


def _filtered(
    setup: Setup, fit: Fitter, start: Mapping[str, float], gives_up: bool
) -> tuple[Fitted | None, tuple[Notice, ...]]:
    """Return the fit by the filter from a start, by default the file's values and the regression, and what speaks against it."""
    treatment = replace(setup.options.treatment, gives_up=gives_up)
    options = replace(setup.options, treatment=treatment, start=start)
    filtered = replace(setup, vehicle=with_turbulence(setup.vehicle), options=options)
    if _calm_search(setup) is not None:  # that goes on, and not by the filter
        filtered = replace(filtered, callback=None, state=None)
    try:
        found = fit(filtered)
        return found, unexplained(found.estimate, setup.options.method, setup.in_calm)
    except IdentificationError as error:
        return None, (doubt(error, setup.options.method, setup.in_calm),)


def _calm_search(setup: Setup) -> Any:
    """Return the state of an interrupted search in calm air."""
    return None if setup.state is None or setup.state.optimizer == SCORING else setup.state


def _in_calm_air(setup: Setup) -> Setup:
    """Return the fit by the method of calm air; the state of a filter's search is none of its."""
    kept = tuple(one for one in setup.notices if one.code != "gusts-filtered")
    return replace(setup, in_calm="", state=_calm_search(setup), notices=kept).by(setup.in_calm)


GUSTS = Decision(
    NAME, "Do air data and inertial sensors show gusts?", problem=look_for_gusts, around=fit_in_gusts
)
