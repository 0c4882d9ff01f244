"""Methods of identification by name.

A method is one function; it knows no other method.

``fit(vehicle, flights, windows, options, callback, state) -> Fit``
    Turns windows of flights into estimates. It lies in `identify`. `stoop.estimate.fit.pose` gives the problem:
    pieces, layout of the unknowns, nuisances. Whatever the method, the returned `Fit` holds

    - ``problem``: a `Misfit`, or something that has its ``layout``, ``pieces``, ``weights`` and ``outputs(z, i)``,
      with which the fitted windows are simulated open loop for curves, figures and the baseline beside them;
    - ``z``: parameters in the unit box, then nuisances in prior sigmas (zeros: the start as it was guessed);
    - ``outcome``: how it ended; ``warnings``: what is doubtful; ``statements``: how to read it.

    A regression has no search: `stoop.estimate.regressed.regressed_fit` makes its `Fit` from estimates and their
    covariance (kept in ``Fit.covariance``), with initial states and biases found for the simulation.
    `callback` and `state` belong to searches that can be resumed; others pass them over.

Error bars come from what the fit rests on (``Fit.evidence``), the same way for all methods: `stoop.assess.error_bars`.
``Fit.local_problem`` gives the least-squares problem for refits where it is not ``problem``.

To add a method, write the function and add one line to `_METHODS`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from stoop.base.text import nearest
from stoop.base.variables import VARIABLES
from stoop.errors import IdentificationError
from stoop.flight import Flight
from stoop.vehicle import Vehicle

DEFAULT: Final = "output-error"
HOVERING: Final = "multiple-shooting"  #: of vehicles with rotors: open loop they fall before a record ends
COARSE: Final = "equation-error"  #: of those whose motors were logged at less than `SLOW`
SLOW: Final = 100.0
"""Hz. What moves the motors faster than half the rate of their log looks slow in it, and the vehicle seems to answer less. Of a
made flight with shaken motors (tests/recovery/test_slow_motors.py) multiple shooting makes the inertia 0.39 too large at 50 Hz,
0.13 at 100 Hz and 0.05 at 125 Hz; equation error 0.24, 0.06 and 0.03. Above, only multiple shooting knows its error bars."""
GRIDDED: Final = 0.98  #: of the grid's rate: what was logged faster than that is used as it was logged
FOLDED: Final = (
    "The motors were logged at {rate:.0f} Hz, less than {slow:.0f} Hz: what an autopilot commands between the samples looks "
    "slow in them, and inertia, lag and delay by {hovering} would be wrong. So the fit is by {coarse}, which leaves out moments "
    "that the recorded commands do not explain; --method {hovering} insists."
)


@dataclass(frozen=True)
class Method:
    """One method; its functions are imported when they are first used.

    Attributes
    ----------
    fit : str
        ``"module:function"``, see the head of this module.
    purpose : str
        What it is for, in a few words.
    simulates : bool
        Whether residuals are those of a simulation, so that bootstrap, posterior and profile can refit it.
    """

    fit: str
    purpose: str
    simulates: bool = True

    def fitter(self) -> Callable[..., Any]:
        """Return the function that fits."""
        return _imported(self.fit)


_METHODS: Final[dict[str, Method]] = {
    DEFAULT: Method("stoop.estimate.fit:fit", "flights in calm air"),
    "filter-error": Method("stoop.estimate.filter_error.method:steady", "flights in turbulence"),
    "filter-error-ekf": Method(
        "stoop.estimate.filter_error.method:varying",
        "likewise, with a gain that follows large maneuvers",
    ),
    "multiple-shooting": Method(
        "stoop.estimate.shooting.method:fit",
        "vehicles that are unstable or hover: short windows",
    ),
    "equation-error": Method(
        "stoop.estimate.regression.methods:equation_error",
        "a first look without a simulation: smoothed samples",
        simulates=False,
    ),
    "frequency-domain": Method(
        "stoop.estimate.regression.methods:frequency_domain",
        "likewise, on the Fourier coefficients of a band",
        simulates=False,
    ),
}


def names() -> tuple[str, ...]:
    """Return the names of all methods."""
    return tuple(_METHODS)


@dataclass(frozen=True)
class Chosen:
    """The method that is meant.

    Attributes
    ----------
    name : str
    why : str
        For the user, where neither the user nor the vehicle alone decided.
    """

    name: str
    why: str = ""


def chosen(name: str, vehicle: Vehicle, flights: Iterable[Flight]) -> Chosen:
    """Return the method that is meant: the one named, or the one of vehicle and flights where none is."""
    if name or not vehicle.hovers:
        return Chosen(name or DEFAULT)
    slowest = min((rate for flight in flights for rate in _interpolated(vehicle, flight)), default=SLOW)
    if slowest >= SLOW:
        return Chosen(HOVERING)
    return Chosen(COARSE, FOLDED.format(rate=slowest, slow=SLOW, coarse=COARSE, hovering=HOVERING))


def _interpolated(vehicle: Vehicle, flight: Flight) -> Iterator[float]:
    """Yield the rates, Hz, of the commands of rotors that were logged more slowly than the grid; measured speeds are smooth."""
    for channel in {rotor.channel for rotor in vehicle.file.rotor.values()} & flight.sources.keys():
        rate = flight.sources[channel].rate
        if VARIABLES[channel].kind != "measurement" and 0.0 < rate < GRIDDED * flight.rate:
            yield rate


def find(name: str) -> Method:
    """Return a method by its name; output error where none is named.

    Raises
    ------
    IdentificationError
        There is no such method.
    """
    name = name or DEFAULT
    if name not in _METHODS:
        raise IdentificationError(f"method '{name}': not known; {nearest(name, _METHODS)}")
    return _METHODS[name]


def _imported(place: str) -> Callable[..., Any]:
    module, _, function = place.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found
