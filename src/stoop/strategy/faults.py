"""Samples of clipped and stuck sensors are treated as not measured."""

from __future__ import annotations

from dataclasses import replace

from stoop.strategy.decision import Change, Decision, Setup


def drop_faults(setup: Setup) -> Change | None:
    """Return the fit without faulty samples."""
    flights = {name: flight.without_faults() for name, flight in setup.flights.items()}
    lost = [name for name, flight in flights.items() if flight is not setup.flights[name]]
    if not lost:
        return None
    found = f"samples at a limit or held constant in {', '.join(lost)}"
    return Change(replace(setup, flights=flights), found, "treated as not measured")


FAULTS = Decision("faults", "Are samples at a limit or held constant?", data=drop_faults)
