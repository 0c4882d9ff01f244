"""Identification in one call: fit, uncertainty and prediction."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stoop import optimize
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight, without, without_faults
from stoop.problem.prepare import decoupled, prepare
from stoop.problem.windows import Window, Windows, as_windows
from stoop.vehicle import Vehicle
from stoop.vehicle.assumptions import with_assumptions
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.fit_result import fitted_model
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.flights import Flights, as_flights
from stoop.workflow.outputs import by_name, flight_files, input_hashes
from stoop.workflow.sensor_delays import CheckedFit, with_sensor_delays

DEFAULTS = Options()


@dataclass(frozen=True, eq=False)
class Search:
    """A finished search; predictions are still to come, see :func:`finish`."""

    checked: CheckedFit
    flights: Mapping[str, Flight]
    predicted: tuple[Window, ...]
    options: Options
    inputs: Mapping[str, str]
    files: tuple[Path, ...]
    began: float
    command: str

    @property
    def fit(self) -> Estimate:
        """The fit."""
        return self.checked.fit


def identify(
    vehicle: Vehicle | str | Path,
    flights: Flights,
    maneuvers: Windows,
    validate: Windows = (),
    options: Options = DEFAULTS,
    callback: Callable[[optimize.Progress], None] | None = None,
    extend: bool = False,
) -> FittedModel:
    """Estimate the free numbers of a vehicle from maneuvers of one or more flights, and predict others.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        Or the name of a built-in one, or a vehicle file.
    flights : Flight, path of a log, xarray.Dataset, or a sequence of them
    maneuvers : windows
        Fitted jointly: ``"[FLIGHT@]START:STOP[#LOADING]"``, ``(start, stop)`` or ``slice(start, stop)`` in seconds of the
        log's own clock; one or several.
    validate : windows
        Likewise; predicted, nothing is fitted there.
    options : Options
        Method, optimizer, seed, budget.
    callback : callable, optional
        Sees a :class:`stoop.optimize.Progress` after each step of the search.
    extend : bool
        Whether the model gains what the data ask for, see :func:`stoop.workflow.extension.extend`.

    Returns
    -------
    FittedModel
        ``model.parameters["Clp"].std_error``, ``model.to_dataframe()``, ``model.plot.maneuvers()``, ``model.save(folder)``.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    return finish(search(vehicle, flights, maneuvers, validate, options, callback, extend=extend))


@on_one_blas_thread
def search(
    vehicle: Vehicle | str | Path,
    flights: Flights,
    maneuvers: Windows,
    validate: Windows = (),
    options: Options = DEFAULTS,
    callback: Callable[[optimize.Progress], None] | None = None,
    state: optimize.State | None = None,
    command: str = "",
    files: Sequence[Path] = (),
    extend: bool = False,
    watch: Callable[[str], None] = lambda text: None,
) -> Search:
    """Do the long part of :func:`identify`; wrong input raises its error before the search.

    Further arguments: the `state` of an interrupted search to resume; the `command` line, for the report; other `files` that
    were read (mapping, noise covariance), for the result's ``inputs``; whether to `extend` the model, of which `watch` is told.
    """
    began = time.perf_counter()
    vehicle = vehicle if isinstance(vehicle, Vehicle) else resolve_vehicle(vehicle)
    methods.find(options.method)
    known = by_name(as_flights(flights), "identify")
    rates = sorted({f"{flight.rate:g}" for flight in known.values()})
    if len(rates) > 1:
        text = " and ".join(rates)
        raise FlightError(f"identify: the flights are sampled at {text} Hz; bring them to one rate first")
    if not maneuvers:
        raise FlightError(
            "identify: no maneuver is given; name at least one window START:STOP, see stoop info"
        )
    fitted, predicted = as_windows(maneuvers, known), as_windows(validate, known)
    twice = "the same samples would count twice; give windows that lie apart"
    both = "nothing may be fitted in a window that is predicted; move one of them"
    for i, window in enumerate((*fitted, *predicted)):
        for other in fitted[:i]:
            if window.flight == other.flight and window.start < other.stop and other.start < window.stop:
                why = twice if i < len(fitted) else both
                raise FlightError(f"maneuver {window}: overlaps the fitted {other}; {why}")
    for name in dict.fromkeys(w.flight for w in (*fitted, *predicted)):
        require_channels(vehicle, known[name])
    inputs = input_hashes(vehicle, known, files)
    for name, flight in known.items():
        spans = [(w.start, w.stop) for w in predicted if w.flight == name]
        known[name] = without_faults(without(flight, spans))
    prepare(
        decoupled(vehicle, known, predicted), known, predicted
    )  # so that its errors come before the search
    choice = methods.choose_method(options.method, vehicle, known.values(), fitted)
    notices: tuple[Notice, ...] = ()
    if methods.find(choice.name).simulates or vehicle.rotors:  # the other regressions take lags as they are
        vehicle, notices = with_assumptions(vehicle, 1.0 / known[fitted[0].flight].rate)
    if extend:
        from stoop.workflow.extension import extend as extended

        named = replace(options, method=choice.name)
        longer = extended(vehicle, known, fitted, predicted, named, watch)
        vehicle, notices = longer.vehicle, (*notices, *longer.notices)
    method, found = choice.fit(vehicle, known, fitted, options, callback, state)
    options = replace(options, method=method)
    checked = with_sensor_delays(
        vehicle, found, lambda longer: choice.fit(longer, known, fitted, options)[1], watch
    )
    checked = replace(checked, fit=replace(checked.fit, notices=(*notices, *checked.fit.notices)))
    read = (Path(vehicle.where), *flight_files(known.values()), *files)
    return Search(checked, known, predicted, options, inputs, read, began, command)


@on_one_blas_thread
def finish(done: Search) -> FittedModel:
    """Add error bars, predictions and goodness of fit to a finished search."""
    return fitted_model(
        done.checked,
        done.flights,
        done.predicted,
        done.options,
        done.inputs,
        done.began,
        done.command,
        done.files,
    )
