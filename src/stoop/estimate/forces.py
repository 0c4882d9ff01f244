"""Measured and modeled specific force of a vehicle with rotors in each window, low-passed.

A hovering vehicle cannot be simulated for long, but its forces can be compared with the accelerometers sample by sample.
Rotors shake them, so both sides are low-passed at `CUTOFF`, with zero phase and per stretch without a hole. Two reference
models stand beside: a constant, and thrust in proportion to the sum of the squared commands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import SPECIFIC_FORCE
from stoop.estimate.fit import Fit
from stoop.estimate.predict import identified_vehicle, mean_biases
from stoop.estimate.regression.rotors import Stretch, lagged_command, stretches
from stoop.flight import Flight
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.simulation import parameter_rows
from stoop.vehicle import Vehicle

CUTOFF: Final = 5.0  #: Hz
ORDER: Final = 2  #: of the Butterworth filter, which runs forward and backward


@dataclass(frozen=True)
class ForceResiduals:
    """Residuals of one axis, rms, m/s2.

    Attributes
    ----------
    model, constant, static : float
        Of the fitted model; of the mean of the fitted windows; of a constant and the sum of squared commands.
    """

    model: float
    constant: float
    static: float


@dataclass(frozen=True)
class ForceFigures:
    """The specific force in one window.

    Attributes
    ----------
    window : Window
    role : str
        "fit" or "validation".
    axes : mapping of str to ForceResiduals
        ``ax``, ``ay``, ``az``.
    seconds : float
        Of flight that was compared.
    """

    window: Window
    role: str
    axes: Mapping[str, ForceResiduals]
    seconds: float


@dataclass(frozen=True, eq=False)
class ForceCurves:
    """Low-passed specific force (n, 3) of one window, m/s2, and the sum of squared commands (n,).

    Attributes
    ----------
    time : (n,) s
    measured, model : (n, 3)
    squares : (n,)
    """

    time: FloatArray
    measured: FloatArray
    model: FloatArray
    squares: FloatArray


def force_figures(
    fit: Fit, flights: Mapping[str, Flight], predicted: Sequence[Window]
) -> tuple[ForceFigures, ...]:
    """Return the residuals of fitted and predicted windows; none of a vehicle without rotors."""
    vehicle = identified_vehicle(fit)
    if not vehicle.rotors:
        return ()
    windows = [*fit.prepared.windows, *predicted]
    curves = [force_curves(vehicle, flights, w, mean_biases(fit, w.flight)) for w in windows]
    fitted = [c for c in curves[: len(fit.prepared.windows)] if c.time.size]
    if not fitted:
        return ()
    reference = ReferenceModels.of(fitted)
    dt = fit.problem.pieces[0].dt
    roles = ["fit"] * len(fit.prepared.windows) + ["validation"] * len(predicted)
    return tuple(
        ForceFigures(w, role, reference.residuals(c), len(c.time) * dt)
        for w, role, c in zip(windows, roles, curves, strict=True)
        if c.time.size
    )


def force_curves(
    vehicle: Vehicle, flights: Mapping[str, Flight], window: Window, biases: Mapping[str, float]
) -> ForceCurves:
    """Return measured and modelled specific force of a window, low-passed.

    Parameters
    ----------
    vehicle : Vehicle
        With its estimates.
    flights : mapping of str to Flight
    window : Window
    biases : mapping of str to float
        Of the sensors and the wind, SI.
    """
    parts = [
        _of_stretch(vehicle, stretch)
        for piece in prepare(vehicle, flights, [window]).pieces
        for stretch in stretches(vehicle, replace(piece, changes={**piece.changes, **biases}))
    ]
    if not parts:
        return ForceCurves(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    return ForceCurves(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _of_stretch(vehicle: Vehicle, stretch: Stretch) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    piece, own = stretch.piece, stretch.samples
    rows = parameter_rows(vehicle, piece.changes)
    modeled = stretch.modeled(vehicle, rows)
    spins = [lagged_command(vehicle, piece, name, rows)[own] for name in vehicle.rotors]
    columns = np.column_stack([stretch.measured[:, 3:], modeled[:, 3:], np.sum(np.square(spins), axis=0)])
    slow = low_passed(columns, piece.dt)
    return piece.time[own], slow[:, :3], slow[:, 3:6], slow[:, 6]


def low_passed(columns: FloatArray, dt: float) -> FloatArray:
    """Return columns (n, k) below `CUTOFF`, without phase."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(ORDER, min(CUTOFF, 0.45 / dt), fs=1.0 / dt, output="sos")
    pad = min(len(columns) - 1, round(3.0 / (CUTOFF * dt)))
    return np.asarray(sosfiltfilt(sos, columns, axis=0, padlen=pad))


@dataclass(frozen=True, eq=False)
class ReferenceModels:
    """The two models that need no aerodynamics, estimated from the fitted windows.

    Attributes
    ----------
    mean : (3,)
    static : (2, 3)
        A constant and the factor of the sum of squared commands; that factor is for az only.
    """

    mean: FloatArray
    static: FloatArray

    @classmethod
    def of(cls, fitted: Sequence[ForceCurves]) -> ReferenceModels:
        """Return the models of fitted windows."""
        measured = np.concatenate([c.measured for c in fitted])
        squares = np.concatenate([c.squares for c in fitted])
        mean = measured.mean(axis=0)
        vertical = np.linalg.lstsq(
            np.column_stack([np.ones(len(squares)), squares]), measured[:, 2], rcond=None
        )[0]
        static = np.array([[mean[0], mean[1], vertical[0]], [0.0, 0.0, vertical[1]]])
        return cls(mean, static)

    def residuals(self, curves: ForceCurves) -> dict[str, ForceResiduals]:
        """Return residuals by axis."""
        static = np.column_stack([np.ones(len(curves.squares)), curves.squares]) @ self.static
        residuals = [curves.measured - y for y in (curves.model, self.mean, static)]
        found = [np.sqrt(np.mean(r**2, axis=0)) for r in residuals]
        return {c: ForceResiduals(*(float(f[i]) for f in found)) for i, c in enumerate(SPECIFIC_FORCE)}
