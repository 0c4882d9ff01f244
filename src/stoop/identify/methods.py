"""Methods of identification by name: who fits, and who says how well it is known.

A method is two functions that are composed by `stoop.job`; neither knows the other methods.

``fit(vehicle, flights, windows, options, callback, state) -> Fit``
    Turns windows of flights into estimates. It lies in `identify`. `stoop.identify.fit.pose` gives the problem:
    pieces, layout of the unknowns, nuisances. Whatever the method, the returned `Fit` holds

    - ``problem``: a `Misfit`, or something that has its ``layout``, ``pieces``, ``weights`` and ``outputs(z, i)``,
      with which the fitted windows are simulated open loop for curves, figures and the baseline beside them;
    - ``z``: parameters in the unit box, then nuisances in prior sigmas (zeros: the start as it was guessed);
    - ``outcome``: how it ended; ``warnings``: what is doubtful; ``statements``: how to read it.

    A regression has no search: `stoop.identify.regressed.regressed_fit` makes its `Fit` from estimates and their
    covariance (kept in ``Fit.covariance``), with initial states and biases found for the simulation.
    `callback` and `state` belong to searches that can be resumed; others pass them over.

``error_bars(fit, color) -> ErrorBars``
    Lies in `job`. Sensitivities of the simulation (``stoop.job.errorbars:error_bars``), those of the innovations
    of a filter, or a covariance that came with the estimates (``stoop.job.givenbars:error_bars``).

To add a method, write the two functions, or take those that are there, and add one line to `_METHODS`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from stoop.errors import IdentificationError
from stoop.flight.variables import nearest
from stoop.vehicle import Vehicle

DEFAULT: Final = "output-error"
HOVERING: Final = "multiple-shooting"  #: of vehicles with rotors: open loop they fall before a record ends
_SENSITIVITIES = "stoop.job.errorbars:error_bars"
_INNOVATIONS = "stoop.job.filterbars:error_bars"
_GIVEN = "stoop.job.givenbars:error_bars"


@dataclass(frozen=True)
class Method:
    """One method; its functions are imported when they are first used.

    Attributes
    ----------
    fit, error_bars : str
        ``"module:function"``, see the head of this module.
    purpose : str
        What it is for, in a few words.
    """

    fit: str
    error_bars: str
    purpose: str

    def fitter(self) -> Callable[..., Any]:
        """Return the function that fits."""
        return _imported(self.fit)

    def judge(self) -> Callable[..., Any]:
        """Return the function that gives error bars."""
        return _imported(self.error_bars)


_METHODS: Final[dict[str, Method]] = {
    DEFAULT: Method("stoop.identify.fit:fit", _SENSITIVITIES, "flights in calm air"),
    "filter-error": Method(
        "stoop.identify.filter_error.method:steady", _INNOVATIONS, "flights in turbulence"
    ),
    "filter-error-ekf": Method(
        "stoop.identify.filter_error.method:varying",
        _INNOVATIONS,
        "likewise, with a gain that follows large maneuvers",
    ),
    "multiple-shooting": Method(
        "stoop.identify.shooting.method:fit",
        _INNOVATIONS,
        "vehicles that are unstable or hover: short windows",
    ),
    "equation-error": Method(
        "stoop.identify.regression.methods:equation_error",
        _GIVEN,
        "a first look without a simulation: smoothed samples",
    ),
    "frequency-domain": Method(
        "stoop.identify.regression.methods:frequency_domain",
        _GIVEN,
        "likewise, on the Fourier coefficients of a band",
    ),
}


def names() -> tuple[str, ...]:
    """Return the names of all methods."""
    return tuple(_METHODS)


def chosen(name: str, vehicle: Vehicle) -> str:
    """Return the name of the method that is meant: the one named, or the vehicle's own where none is."""
    return name or (HOVERING if vehicle.hovers else DEFAULT)


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
