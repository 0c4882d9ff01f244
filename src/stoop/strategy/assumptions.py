"""Lags, a delay and errors of thrust that every vehicle has and a file may leave out become free, with priors.

Delays of commands beyond what is usual are found by a scan of the record, where the search begins. Radio links, loggers on the
ground and simulators delay commands by up to half a second. From the usual start a search ends in a wrong optimum, and the usual
prior pulls the estimate back. A delay that the file fixes, or bounds, decides for itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from stoop.base.notices import Notice, notice, paragraph
from stoop.estimate import methods
from stoop.estimate.regression.command_delay import scan_delays
from stoop.problem.prepare import Prepared, decoupled
from stoop.strategy.decision import Change, Decision, Setup
from stoop.vehicle import Vehicle
from stoop.vehicle.assumptions import with_assumptions
from stoop.vehicle.document import with_entries
from stoop.vehicle.usual import USUAL

WIDTH: Final = 3.0  #: standard deviations of a prior, within which a search finds a delay by itself


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


@dataclass(frozen=True)
class Delay:
    """Input columns that share a delay, and what the vehicle knows of it."""

    name: str  #: of the number, whether it is in the file or not
    columns: tuple[int, ...]
    #: s, up to which a search finds it by itself
    reach: float
    #: what is written where the file has no delay; empty where it has one
    entries: Mapping[tuple[str, ...], Any]


def with_found_delays(setup: Setup, vehicle: Vehicle) -> tuple[Vehicle, tuple[Notice, ...]]:
    """Return a vehicle with the delays of commands that exceed what is usual where the record shows them, and what was found."""
    here = decoupled(vehicle, setup.flights, setup.fitted)
    pieces, found = Prepared.of(here, setup.flights, setup.fitted).pieces, list[Notice]()
    for delay in _delays(here):
        scan = scan_delays(here, pieces, delay.columns)
        late = scan.beyond(delay.reach) if scan else None
        if late is None:
            continue
        own = {"value": late, "prior": USUAL.found_delay_std}
        if delay.entries:
            entries = {keys: own if entry is None else entry for keys, entry in delay.entries.items()}
            vehicle = with_entries(vehicle, entries)
        else:
            vehicle = vehicle.with_numbers({delay.name: {**own, "mean": late}})
        values = {"delay": late, "reach": delay.reach, "std": own["prior"]}
        found.append(notice("command-delay-found", delay.name, **values))
    return vehicle, tuple(found)


def _delays(vehicle: Vehicle) -> Iterator[Delay]:
    """Yield the delays of commands that the file neither fixes nor bounds; one for all where it has none."""
    numbers, columns = vehicle.quantities, dict[int, list[int]]()
    for column, row in vehicle.input_delays():
        columns.setdefault(row, []).append(column)
    for row, own in columns.items():
        parameter = vehicle.parameters[row]
        q = numbers[parameter.name]
        if parameter.free and q.tie is None and q.bounds is None and q.prior is not None:
            reach = q.prior_mean + WIDTH * q.prior
            yield Delay(parameter.name, tuple(own), reach, {})
    if columns:
        return
    places = [("controls", c) for c in vehicle.controls] + ([("rotors",)] if vehicle.rotors else [])
    moved = {c for control in vehicle.controls for c in vehicle.channels_of(control)}
    moved |= {rotor.channel for rotor in vehicle.file.rotor.values()}
    recorded = tuple(i for i, channel in enumerate(vehicle.recorded) if channel in moved)
    if places and recorded:
        first, *others = ((*keys, "delay") for keys in places)
        entries = {first: None} | dict.fromkeys(others, "=" + ".".join(first))
        reach = USUAL.delay + WIDTH * USUAL.delay_std
        yield Delay(".".join(first), recorded, reach, entries)


ASSUMPTIONS = Decision(
    "assumptions", "Does the file leave out lags, delays or the accuracy of thrust?", problem=assume
)
