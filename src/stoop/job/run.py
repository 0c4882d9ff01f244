"""Fit, uncertainty and validation in one call."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from stoop import optimize
from stoop.errors import FlightError
from stoop.flight import Flight, load, without
from stoop.identify.fit import Fit, Options, fit
from stoop.identify.predict import identified_vehicle
from stoop.identify.result import Identification
from stoop.identify.windows import Window, parse_window
from stoop.job.assemble import assemble
from stoop.vehicle import Vehicle, load_vehicle

DEFAULTS = Options()


@dataclass(frozen=True, eq=False)
class Job:
    """A finished identification.

    Attributes
    ----------
    identification : Identification
        Result, traces and statements: what the report shows.
    vehicle : Vehicle
        With its free numbers at their estimates.
    flights : tuple of Flight
        As they were used, air data reconstructed.
    fit : Fit
    """

    identification: Identification
    vehicle: Vehicle
    flights: tuple[Flight, ...]
    fit: Fit

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write ``result.json``, ``vehicle.toml``, ``flight.nc`` and ``report.html`` into a folder."""
        from stoop.job.outputs import write_outputs

        return write_outputs(self, Path(folder), overwrite)

    def __str__(self) -> str:
        """Return the estimates as a table."""
        from stoop.job.summary import estimates_table

        return estimates_table(self.identification.result)


def identify(
    vehicle: Vehicle | str | Path,
    flights: Flight | str | Path | Sequence[Flight | str | Path],
    maneuvers: Sequence[str],
    validate: Sequence[str] = (),
    options: Options = DEFAULTS,
    callback: Callable[[optimize.Progress], None] | None = None,
    state: optimize.State | None = None,
    command: str = "",
) -> Job:
    """Identify a vehicle from maneuvers of one or more flights, and predict others.

    Parameters
    ----------
    vehicle : Vehicle or path
        Which numbers are free, their bounds, priors and starting values.
    flights : Flight, path, or a sequence of them
    maneuvers : sequence of str
        ``[FLIGHT@]START:STOP[#LOADING]``, seconds of the log's own clock; fitted jointly.
    validate : sequence of str
        Likewise; predicted, nothing is fitted there.
    options : Options
    callback : callable, optional
        Sees an :class:`stoop.optimize.Progress` after each generation.
    state : optional
        Of an interrupted search, to go on from.
    command : str
        For the report: how this was called.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    began = time.perf_counter()
    vehicle = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    known = _by_name(_each(flights))
    if not maneuvers:
        raise FlightError(
            "identify: no maneuver is given; name at least one window START:STOP, see stoop info"
        )
    fitted = [parse_window(text, known) for text in maneuvers]
    predicted = [parse_window(text, known) for text in validate]
    known = {name: without(flight, _spans(name, predicted)) for name, flight in known.items()}
    found = fit(vehicle, known, fitted, options, callback, state)
    identification = assemble(found, known, predicted, options, began, command)
    return Job(identification, identified_vehicle(found), tuple(known.values()), found)


def _each(flights: Flight | str | Path | Sequence[Flight | str | Path]) -> list[Flight]:
    several = [flights] if isinstance(flights, Flight | str | Path) else list(flights)
    return [f if isinstance(f, Flight) else load(f) for f in several]


def _by_name(flights: Sequence[Flight]) -> dict[str, Flight]:
    out: dict[str, Flight] = {}
    for flight in flights:
        if flight.name in out:
            raise FlightError(f"identify: two flights are called '{flight.name}'; rename one of the files")
        out[flight.name] = flight
    rates = sorted({f"{flight.rate:g}" for flight in out.values()})
    if len(rates) > 1:
        raise FlightError(
            f"identify: the flights are sampled at {' and '.join(rates)} Hz; bring them to one rate first"
        )
    return out


def _spans(name: str, windows: Sequence[Window]) -> list[tuple[float, float]]:
    return [(w.start, w.stop) for w in windows if w.flight == name]
