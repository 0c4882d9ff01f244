"""Identification in one call: fit, uncertainty and prediction."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal

from stoop import optimize
from stoop.base.blas import on_one_blas_thread
from stoop.base.text import nearest
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.flight import without
from stoop.problem.windows import Window, Windows
from stoop.strategy import Strategy, run
from stoop.strategy.decision import Fitted, Provenance
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow.fit_result import fitted_model
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.flights import Flights, as_flights
from stoop.workflow.outputs import by_name, flight_files, input_hashes

DEFAULTS = Options()
STRATEGY = Strategy.default()


def fit(
    vehicle: Vehicle | str | Path,
    flights: Flights,
    maneuvers: Windows = (),
    validate: Windows = (),
    options: Options = DEFAULTS,
    callback: Callable[[optimize.Progress], None] | None = None,
    extend: bool = False,
    strategy: Strategy | Literal["default", "textbook"] = STRATEGY,
    **settings: Any,
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
        Whether the model gains what the data ask for: the decision ``extensions``.
    strategy : Strategy, "default" or "textbook"
        Decisions that the fit takes by itself, see :class:`stoop.Strategy`; ``"textbook"`` takes none.
    **settings
        Fields of :class:`stoop.Options` by name, in place of those of `options`: ``method="equation-error"``, ``seed=1``.

    Returns
    -------
    FittedModel
        ``model.parameters["Clp"].std_error``, ``model.to_dataframe()``, ``model.plot.maneuvers()``, ``model.save(folder)``.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    options = with_settings(options, settings, "fit", fit)
    decisions = Strategy.named(strategy)
    decisions = decisions.including("extensions") if extend else decisions
    return finish(search(vehicle, flights, maneuvers, validate, options, callback, strategy=decisions))


def with_settings(
    options: Options, settings: Mapping[str, Any], verb: str, function: Callable[..., Any]
) -> Options:
    """Return options with some of their fields replaced; raises `TypeError` about a keyword that there is not."""
    known = [item.name for item in fields(options) if item.name != "treatment"]  # a strategy decides it
    own = [name for name in inspect.signature(function).parameters if name != "settings"]
    for name in settings:
        if name not in known:
            raise TypeError(f"{verb}() has no keyword '{name}'; {nearest(name, [*own, *known])}")
    return replace(options, **settings)


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
    strategy: Strategy = STRATEGY,
    watch: Callable[[str], None] = lambda text: None,
) -> Fitted:
    """Do the long part of :func:`fit`; wrong input raises its error before the search.

    Further arguments: the `state` of an interrupted search to resume; the `command` line, for the report; other `files` that
    were read (mapping, noise covariance), for the result's ``inputs``; `watch` is told what is fitted.
    """
    began = time.perf_counter()
    vehicle = load_vehicle(vehicle)
    methods.find(options.method)
    known = by_name(as_flights(flights), "identify")
    rates = sorted({f"{flight.rate:g}" for flight in known.values()})
    if len(rates) > 1:
        text = " and ".join(rates)
        raise FlightError(f"identify: the flights are sampled at {text} Hz; bring them to one rate first")
    fitted, predicted = Window.several(maneuvers, known), Window.several(validate, known)
    if not fitted:
        raise FlightError(
            "fit: no maneuver is given; name at least one window START:STOP, see stoop.look or stoop info"
        )
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
        known[name] = without(flight, [(w.start, w.stop) for w in predicted if w.flight == name])
    found = run.fit(strategy, vehicle, known, fitted, predicted, options, callback, state, watch)
    read = (Path(vehicle.where), *flight_files(known.values()), *files)
    return replace(run.with_tests(found), provenance=Provenance(inputs, read, command, began))


finish = on_one_blas_thread(fitted_model)
