"""Lags, a delay and errors of thrust that every vehicle has and a file may leave out become free, with priors."""

from __future__ import annotations

from dataclasses import replace

from stoop.base.notices import paragraph
from stoop.estimate import methods
from stoop.strategy.command_delays import with_found_delays
from stoop.strategy.decision import Change, Decision, Setup
from stoop.vehicle.assumptions import with_assumptions


def assume(setup: Setup) -> Change | None:
    """Return the fit with what the file leaves out among its unknowns; regressions of aircraft take lags as they are."""
    if not (methods.find(setup.options.method).simulates or setup.vehicle.rotors):
        return None
    vehicle, notices = with_assumptions(setup.vehicle, 1.0 / setup.flights[setup.fitted[0].flight].rate)
    vehicle, late = with_found_delays(setup, vehicle)
    notices = (*notices, *late)
    if not notices:
        return None
    free = sum(p.free for p in vehicle.parameters) - sum(p.free for p in setup.vehicle.parameters)
    done = f"priors, and {free} more free numbers" if free else "priors"
    return Change(replace(setup, vehicle=vehicle).noting(*notices), paragraph(notices), done)


ASSUMPTIONS = Decision(
    "assumptions", "Does the file leave out lags, delays or the accuracy of thrust?", problem=assume
)
