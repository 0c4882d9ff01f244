"""Identification in one call: fit, uncertainty, prediction, and the folder that holds them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop import optimize
from stoop.assessment.assessment import Assessment
from stoop.assessment.verdict import verdict
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice
from stoop.base.text import printable, printable_lines
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.estimate.predict import ForceFigures, force_figures, identified_vehicle
from stoop.flight import Flight, load, without, without_faults
from stoop.flight.flight import from_columns
from stoop.problem.prepare import decoupled, prepare
from stoop.problem.windows import Window, Windows, as_windows
from stoop.results.result import Identification, ParameterEstimate, Result
from stoop.results.verdict import Verdict
from stoop.vehicle import Vehicle
from stoop.vehicle.assumptions import with_assumptions
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.fit_result import identification
from stoop.workflow.outputs import by_name, check_folder, flight_files, input_hashes, place_outputs
from stoop.workflow.sensor_delays import CheckedFit, with_sensor_delays

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from stoop.report.identification import Plots

    Flights = Flight | str | Path | xr.Dataset | Sequence[Flight | str | Path | xr.Dataset]

DEFAULTS = Options()


@dataclass(frozen=True, eq=False)
class Job:
    """A finished identification.

    Attributes
    ----------
    identification : Identification
        Result and traces: what the report shows.
    vehicle : Vehicle
        With its free numbers at their estimates.
    flights : tuple of Flight
        As they were used, air data reconstructed.
    fit : Estimate
    files : tuple of Path
        Files that were read; :meth:`save` never writes over them.
    attachments : mapping of str to bytes
        Further files for the folder, by name.
    forces : tuple of ForceFigures
        Of a vehicle with rotors: the specific force beside the flight, window by window.
    """

    identification: Identification
    vehicle: Vehicle
    flights: tuple[Flight, ...]
    fit: Estimate
    files: tuple[Path, ...] = ()
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    forces: tuple[ForceFigures, ...] = ()

    def assess(self, *assessments: Assessment, watch: Callable[[str], None] | None = None) -> Job:
        """Return this job with the uncertainty by further methods.

        `watch` is called with the progress of each: :class:`stoop.workflow.Bootstrap`, :class:`stoop.workflow.Posterior`,
        :class:`stoop.workflow.Profile`, or your own.
        """
        from stoop.assessment.assessment import assess

        result, files = assess(self.result, self.fit, assessments, watch or (lambda text: None))
        return replace(self.with_result(result), attachments={**self.attachments, **files})

    def with_result(self, result: Result) -> Job:
        """Return this job with another result, its verdict made anew."""
        result = replace(result, verdict=verdict(result, result.verdict.uses))
        return replace(self, identification=replace(self.identification, result=result))

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write ``result.json``, ``vehicle.toml``, ``flight.nc`` and ``report.html`` into a folder."""
        names, place = [flight.name for flight in self.flights], Path(folder)
        check_folder(place, names, overwrite, self.files, tuple(self.attachments))
        return place_outputs(self, place, overwrite)

    @property
    def result(self) -> Result:
        """The numbers, as ``result.json`` holds them."""
        return self.identification.result

    @property
    def verdict(self) -> Verdict:
        """Whether to use the model, for what, and why."""
        return self.result.verdict

    @property
    def parameters(self) -> Mapping[str, ParameterEstimate]:
        """Estimates by name, such as ``fit.parameters["Clp"].std_error``."""
        return self.result.parameters

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Findings about the data and the fit."""
        return self.result.notices

    @property
    def plot(self) -> Plots:
        """Plots, such as ``fit.plot.maneuvers()``."""
        from stoop.report.identification import Plots

        return Plots(self.identification)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each parameter, indexed by its name."""
        return self.result.to_dataframe()

    def to_xarray(self) -> xr.Dataset:
        """Return estimates, covariance, measured and simulated readings, labelled; see `stoop.results.labelled`."""
        from stoop.results.labelled import to_xarray

        return to_xarray(self.identification)

    def to_arviz(self) -> Any:
        """Return the draws of the posterior as `arviz.InferenceData`, once one was drawn."""
        from stoop.results.labelled import to_arviz

        return to_arviz(self.attachments)

    def __repr__(self) -> str:
        """Return vehicle, size and status on one line."""
        r = self.result
        vehicle = self.identification.vehicle
        return printable(f"<Fit of {vehicle}: {len(r.parameters)} parameters, {r.method}, {r.status}>")

    def _repr_html_(self) -> str:
        return self.result._repr_html_()

    def __str__(self) -> str:
        """Return the estimates as a table, and the verdict."""
        from stoop.workflow.summary import estimates_table

        return printable_lines(
            f"{estimates_table(self.result.parameters)}\n\nverdict: {self.result.verdict.headline}"
        )


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


def as_flight(given: Flight | str | Path | xr.Dataset) -> Flight:
    """Return a flight from a flight, a log, or a dataset over ``time`` (s) with variables of the registry in SI."""
    if isinstance(given, Flight):
        return given
    if isinstance(given, str | Path):
        return load(given)
    columns = {str(name): column.to_numpy() for name, column in given.data_vars.items()}
    name = str(given.attrs.get("name", "flight"))
    return from_columns(name, given["time"].to_numpy(), columns, source="dataset")


def as_flights(given: Flights) -> list[Flight]:
    """Return one or several flights, see :func:`as_flight`."""
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return [as_flight(one) for one in several]


def identify(
    vehicle: Vehicle | str | Path,
    flights: Flights,
    maneuvers: Windows,
    validate: Windows = (),
    options: Options = DEFAULTS,
    callback: Callable[[optimize.Progress], None] | None = None,
    extend: bool = False,
) -> Job:
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
    Job
        ``fit.parameters["Clp"].std_error``, ``fit.to_dataframe()``, ``fit.plot.maneuvers()``, ``fit.save(folder)``.

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
def finish(done: Search) -> Job:
    """Add error bars, predictions and goodness of fit to a finished search."""
    fit, flights, predicted = done.fit, done.flights, done.predicted
    found = identification(
        done.checked, flights, predicted, done.options, done.inputs, done.began, done.command
    )
    forces = force_figures(fit, flights, predicted)
    return Job(found, identified_vehicle(fit), tuple(flights.values()), fit, done.files, forces=forces)
