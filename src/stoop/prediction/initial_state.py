"""The initial state of a prediction, estimated with the fitted model from a short stretch of the record before it.

The error of a state that was read from one noisy sample, or not recorded, would dominate the comparison. The model determines
the initial state from the readings of the stretch, by least squares over the initial state of the stretch, with the numbers of
the model fixed, the noise covariance of the fit, and the wide priors that a fit gives initial states,

    x0 = argmin |W (z - y(x0, theta))|^2 + |(x0 - m) / s|^2,   P = (J_x' J_x + S^-2)^-1,

where J_x and J_theta are whitened sensitivities over the stretch. One simulation then runs from the stretch through the
prediction. As x0 depends on theta, dx0/dtheta = -P J_x' J_theta, its readings y have the covariance

    y_x P y_x' + T C T',   T = y_theta + y_x dx0/dtheta,

to which the measurement noise R adds where they are compared with the record, and what gusts do since the beginning of the
stretch where a filter found them (:mod:`stoop.estimate.fitted_filter`). References: Klein and Morelli, *Aircraft System
Identification*, 2nd ed., 2016, section 6.1 (maximum likelihood with initial states); G. A. F. Seber and C. J. Wild, *Nonlinear
Regression*, 1989, section 5.1 (prediction bands by the linearized model).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.estimate.fitted_filter import FittedFilter
from stoop.flight import Flight
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.observation import guess_start, state_channels
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance
from stoop.vehicle import Parameter, Vehicle

#: s before a prediction, from which its initial state is estimated
STRETCH: Final = 1.0
#: s of it that there must be; else the beginning of the prediction is used
MIN_STRETCH: Final = 0.2
#: standard errors on either side, of which a difference takes 1e-7
PARAMETER_WIDTH: Final = 100.0


@dataclass(frozen=True)
class BiasPrior:
    """Prior of a sensor's bias in a window, from fitted maneuvers, SI."""

    mean: float
    #: standard deviation; 0 where one maneuver alone does not determine it
    deviation: float = 0.0


def bias_priors(
    fitted: Sequence[tuple[str, Mapping[str, float]]], flight: str | None, widths: Mapping[str, float]
) -> dict[str, BiasPrior]:
    """Return the prior of each bias in a window of a flight, from the flight and the biases of each fitted maneuver.

    The prior is from maneuvers of the same flight, if it was fitted, else from the averages of flights, or from the maneuvers
    of a single other flight. The variance between m of them is pooled over all sensors, in units of the `widths` (the standard
    deviations that the vehicle file gives), and counts as one more observation of each sensor's own, because two or three
    maneuvers hardly determine a variance (moderated variance, G. K. Smyth, *Statistical Applications in Genetics and Molecular
    Biology* 3(1), 2004). The variance of a further maneuver about their mean is 1 + 1/m times as large, and its 95 % range that
    of Student's t with the degrees of freedom by F. E. Satterthwaite, *Biometrics Bulletin* 2(6), 1946.
    """
    by_flight: dict[str, list[Mapping[str, float]]] = {}
    for name, own in fitted:
        by_flight.setdefault(name, []).append(own)
    groups = by_flight.get(flight or "") or [_averages(some) for some in by_flight.values()]
    if len(groups) < 2 and flight not in by_flight:
        groups = [own for _, own in fitted]
    values = {n: np.array([one[n] for one in groups if n in one]) for n in _averages(groups)}
    squares = {n: float(np.sum((x - x.mean()) ** 2)) for n, x in values.items()}
    degrees = sum(len(x) - 1 for x in values.values())
    pooled = sum(square / widths.get(n, 1.0) ** 2 for n, square in squares.items()) / max(degrees, 1)
    found = {}
    for n, x in values.items():
        m = len(x)
        if m < 2:
            found[n] = BiasPrior(float(x[0]))
            continue
        variance = (pooled * widths.get(n, 1.0) ** 2 + squares[n]) / m
        reach = student.ppf(0.975, m**2 / (1.0 / degrees + m - 1.0)) / norm.ppf(0.975)
        found[n] = BiasPrior(float(x.mean()), float(reach * np.sqrt(variance * (1.0 + 1.0 / m))))
    return found


def _averages(several: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for one in several for name in one)
    return {name: float(np.mean([one[name] for one in several if name in one])) for name in names}


@dataclass(frozen=True, eq=False)
class Predictor:
    """A vehicle with its free numbers at their estimates, their covariance, and the noise of the fit."""

    vehicle: Vehicle
    covariance: Covariance
    noise: NoiseCovariance
    #: of a fit by a filter
    filter: FittedFilter | None = None
    #: whether a reduced vehicle takes the states that it leaves out from the record
    recorded_motion: bool = True

    @property
    def weights(self) -> Weights:
        """Weights of readings, less where neighboring residuals are correlated; 1 for what was never measured."""
        R = self.noise.of(self.vehicle.outputs) * self.noise.inflation
        unknown = ~np.isfinite(np.diag(R))
        R = np.where(unknown[:, None] | unknown, 0.0, R)
        return Weights.of(R + np.diag(unknown.astype(np.float64)))

    @property
    def variance(self) -> FloatArray:
        """Variance (n_y,) of the measurement noise; NaN for what was never measured."""
        return np.asarray(np.diag(self.noise.of(self.vehicle.outputs)))

    def uncertain(self) -> tuple[tuple[Parameter, ...], FloatArray]:
        """Return the d parameters that have a finite error, within `PARAMETER_WIDTH` of their estimate; covariance (d, d)."""
        known = {p.name: p for p in self.vehicle.parameters}
        errors = np.sqrt(np.diag(self.covariance.matrix))
        kept = [i for i, n in enumerate(self.covariance.names) if 0.0 < errors[i] < np.inf and n in known]
        found = []
        for i in kept:
            p, reach = known[self.covariance.names[i]], PARAMETER_WIDTH * errors[i]
            found.append(replace(p, lower=p.value - reach, upper=p.value + reach, prior=None))
        return tuple(found), self.covariance.matrix[np.ix_(kept, kept)]


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece that is predicted from sample `first` on, and whose initial state comes from its first `samples`."""

    piece: Piece
    first: int
    samples: int

    def part(self, vehicle: Vehicle, start: int, stop: int) -> Stretch:
        """Return the prediction of some of the samples of the prediction, with as long a stretch before them."""
        n = round(STRETCH / self.piece.dt)
        first = max(0, self.first + start - n)
        behind = self.first + stop
        rows = {c: self.piece.whole[first:behind, i] for i, c in enumerate(vehicle.outputs)}
        readings = {c: rows[c] for c in state_channels(vehicle) if c in rows}
        guessed = {**self.piece.start}
        if first and len(readings) == len(state_channels(vehicle)):
            guessed |= guess_start(vehicle, self.piece.time[first:behind], readings, "")[0]
        piece, before = self.piece.part(first, behind, guessed), self.first + start - first
        return Stretch(piece, before, min(before or n, len(piece.time)))


def stretch_before(vehicle: Vehicle, flights: Mapping[str, Flight], window: Window, piece: Piece) -> Stretch:
    """Return a piece of a window with the record before it, up to `STRETCH` and without a hole."""
    n = len(piece.time)
    begin = max(float(piece.time[0]) - STRETCH, float(flights[window.flight].time[0]))
    if piece.time[0] - begin >= MIN_STRETCH:
        try:
            longer = Prepared.of(vehicle, flights, [replace(window, start=begin, stop=float(piece.time[-1]))])
        except FlightError:
            longer = Prepared((), ())
        for one in longer.pieces:
            first = int(np.searchsorted(one.time, piece.time[0] - 0.5 * piece.dt))
            if first * piece.dt >= MIN_STRETCH and len(one.time) - first == n:
                return Stretch(replace(one, maneuver=piece.maneuver), first, first)
    return Stretch(piece, 0, min(round(STRETCH / piece.dt), n))


@dataclass(frozen=True, eq=False)
class Predicted:
    """Readings (n, n_y) of a prediction, and their standard deviations without the measurement noise."""

    readings: FloatArray
    deviation: FloatArray


def predict_stretch(
    model: Predictor, stretch: Stretch, biases: Mapping[str, BiasPrior] | None = None
) -> Predicted:
    """Estimate the initial state and the sensor biases of a stretch, and simulate on through the prediction.

    Readings that the simulation does not reach, because it diverges, are not finite.
    """
    piece = replace(stretch.piece, maneuver=0)
    window = Window("", float(piece.time[0]), float(piece.time[-1]))
    known, starts = biases or {}, []
    for n in Prepared((window,), (piece,)).nuisances(model.vehicle):
        prior = known.get(n.name, BiasPrior(n.center))
        if not n.is_bias:
            starts.append(n)
        elif prior.deviation > 0.0:
            starts.append(replace(n, center=prior.mean, scale=prior.deviation))
    ladder = ((stretch.samples,), (len(piece.time),))
    problem = Misfit(Layout(model.vehicle, (), tuple(starts)), (piece,), model.weights, ladder)
    z = optimize.refine(problem, np.zeros(problem.extra), 0).z
    parameters, covariance = model.uncertain()
    full = replace(problem, layout=Layout(model.vehicle, parameters, tuple(starts)))
    middle = np.full(len(parameters), 0.5)
    found = with_deviation(full, np.concatenate([middle, z]), covariance, stretch.first)
    if np.isinf(np.diag(model.covariance.matrix)).any():  # nor does anything bound the prediction
        found = replace(found, deviation=np.full_like(found.deviation, np.nan))
    if model.filter is None:
        return found
    blown = model.filter.disturbance(model.vehicle, piece)[stretch.first :]
    return replace(found, deviation=np.sqrt(found.deviation**2 + blown))


def innovations(
    model: Predictor, prepared: Prepared, biases: Mapping[str, BiasPrior]
) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return the innovations (n, n_y) of the pieces of one window over their standard deviations, and these.

    There are none without a filter. The prior of a bias is that of the fitted maneuvers; where one maneuver alone does not
    determine its scatter, the scatter is that of the vehicle file.
    """
    if model.filter is None:
        return ()
    pieces = tuple(replace(piece, maneuver=0) for piece in prepared.pieces)
    own = []
    for n in replace(prepared, pieces=pieces).nuisances(model.vehicle):
        prior = biases.get(n.name) if n.is_bias else None
        own.append(n if prior is None else replace(n, center=prior.mean, scale=prior.deviation or n.scale))
    ladder = (tuple(len(piece.time) for piece in pieces),)
    layout = Layout(model.vehicle, (), tuple(own))
    return model.filter.innovations(Misfit(layout, pieces, model.weights, ladder))


def with_deviation(problem: Misfit, z: FloatArray, covariance: FloatArray, first: int) -> Predicted:
    """Return the readings from sample `first` on, with their standard deviations by linear propagation."""
    d = problem.dimension
    with np.errstate(invalid="ignore", over="ignore"):
        residuals = problem.residuals(z[None, :], 0)[0]
        J = problem.jacobian(z, 0, residuals)[0].dense()
        readings, slopes = problem.slopes(z, 0)
        if not np.isfinite(J).all():
            return Predicted(readings[first:], np.full_like(readings[first:], np.nan))
        P = np.linalg.inv(J[:, d:].T @ J[:, d:])
        by_start = slopes[first:, :, d:]
        by_parameter = slopes[first:, :, :d] - by_start @ (P @ (J[:, d:].T @ J[:, :d]))
        unit = problem.layout.scales[:d]
        variance = np.einsum("kie,ef,kif->ki", by_start, P, by_start)
        variance += np.einsum("kid,de,kie->ki", by_parameter / unit, covariance, by_parameter / unit)
        return Predicted(readings[first:], np.sqrt(np.maximum(variance, 0.0)))
