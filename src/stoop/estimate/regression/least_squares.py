"""Linear regression of measured motion: rows of equations, in the time or frequency domain, solved by least squares.

A kind of vehicle chooses its equations (:func:`stoop.estimate.regression.kind_of`); domain, estimates and color correction
are the same for all. A domain is a linear transform applied to the response and the regressors alike: it weights samples and
cannot bias an equation that holds at every sample. A parameter may stand in several equations. Noise in the regressors
biases the estimates.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016, chapters 5 and 7.
E. A. Morelli, "High accuracy evaluation of the finite Fourier transform using sampled data", NASA TM-110340, 1997.
W. K. Newey and K. D. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", *Econometrica* 55(3), 1987, pp. 703-708.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

import numpy as np

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.base.notices import Notice
from stoop.problem import Layout
from stoop.problem.evidence import NULL_EIGENVALUE, PieceEvidence, invert_rows
from stoop.vehicle import Vehicle

MAX_LAG: Final = 2.0  #: s; residuals further apart count as independent
ROWS_PER_WINDOW: Final = 4
TAPER: Final = 0.1  #: share of the record that is tapered at either end
MIN_FREQUENCIES: Final = 4  #: in the band of a record that is used
WEIGHT_ROUNDS: Final = 3  #: alternations of estimates and residual variances
MAX_ITERATIONS: Final = 8  #: of Gauss-Newton
STEP_TOLERANCE: Final = 1e-3  #: in `Equations.scales`
AR_ORDER: Final = 4  #: of the errors of an equation under feedback: those of one span of smoothing
#: of the width of the bounds, within which forces determine a number that moments then take over
DETERMINED: Final = 0.05
ZERO_COLUMN: Final = 1e-9  #: norm, of the largest column's, below which a column counts as zero


@dataclass(frozen=True)
class TimeDomain:
    """Samples smoothed by a Hann window of `span` s, four rows a window; residuals are colored, by that and the model."""

    span: float = 0.2
    name: ClassVar[str] = "time"
    keeps_constants: ClassVar[bool] = True  #: whether a constant survives the transform
    colored: ClassVar[bool] = True  #: whether error bars are corrected for the color of the residuals

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return smoothed samples (m, k) of signals (n, k) every `dt` s; none where the record is too short."""
        from scipy.signal import oaconvolve
        from scipy.signal.windows import hann

        size = 2 * round(0.5 * self.span / dt) + 1
        if len(signals) < 2 * size:
            return np.empty((0, signals.shape[1]))
        window = hann(size + 2)[1:-1]
        smooth = oaconvolve(signals, (window / window.sum())[:, None], mode="valid", axes=0)
        return np.asarray(smooth[:: round(self.period(dt) / dt)])

    def period(self, dt: float) -> float:
        """Return the time from one row to the next, s."""
        return dt * max(1, round(self.span / dt / ROWS_PER_WINDOW))

    def scatter(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (k, k) of X' v, rows X (m, k) of one stretch, for noise with the color of v (m,).

        The autocovariance is estimated up to a lag of 2 s and tapered to zero there, which keeps the result positive
        semidefinite (Newey and West).
        """
        lags = min(round(MAX_LAG / self.period(dt)), len(v) // 5)
        size = 2 * len(v)
        sampled = np.fft.irfft(np.abs(np.fft.rfft(v, size)) ** 2)[: lags + 1] / len(v)
        tapered = sampled * (1.0 - np.arange(lags + 1) / (lags + 1.0))
        kernel = np.concatenate([tapered, np.zeros(size - 2 * lags - 1), tapered[:0:-1]])
        spectrum = np.fft.rfft(kernel).real
        colored = np.fft.irfft(spectrum[:, None] * np.fft.rfft(X, size, axis=0), size, axis=0)[: len(X)]
        product = X.T @ colored
        return np.asarray(0.5 * (product + product.T))


@dataclass(frozen=True)
class FrequencyDomain:
    """Fourier coefficients of a band from `low` to `high` Hz, real parts above imaginary parts.

    The record is detrended and tapered first. Frequencies are spaced by one over the record's length, which also limits the
    band, as does the Nyquist frequency: closer ones would repeat the same information. Residuals count as white within the band.
    """

    low: float = 0.1
    high: float = 2.0
    name: ClassVar[str] = "frequency"
    keeps_constants: ClassVar[bool] = False
    colored: ClassVar[bool] = False

    def frequencies(self, count: int, dt: float) -> FloatArray:
        """Return the frequencies, Hz, of a record of `count` samples."""
        step = 1.0 / (count * dt)
        first = max(self.low, step)
        last = min(self.high, 0.5 / dt - step)  # below the Nyquist frequency
        return np.asarray(first + step * np.arange(max(0, int((last - first) / step + 1e-9) + 1)))

    def period(self, dt: float) -> float:
        """Return infinity: rows are no samples of time."""
        return float(np.inf)

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return real and imaginary parts (m, k), scaled such that white noise keeps its variance."""
        from scipy.signal import detrend
        from scipy.signal.windows import tukey

        f = self.frequencies(len(signals), dt)
        if len(f) < MIN_FREQUENCIES or not np.isfinite(signals).all():  # products of huge numbers
            return np.empty((0, signals.shape[1]))
        window = tukey(len(signals), 2.0 * TAPER)
        tapered = detrend(signals, axis=0) * window[:, None]
        found = fourier_transform(tapered, f, dt) * np.sqrt(2.0 / np.sum(window**2))
        return np.concatenate([found.real, found.imag])

    def scatter(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance for residuals that are white within the band."""
        return np.asarray(X.T @ X * float(np.mean(v**2)))


Domain = TimeDomain | FrequencyDomain


def fourier_transform(signals: FloatArray, frequencies: FloatArray, dt: float) -> ComplexArray:
    """Return the finite Fourier transform (f, k) of signals (n, k), a sum over samples, at equally spaced Hz (f,).

    By the chirp z-transform (L. Rabiner et al., IEEE Trans. Audio Electroacoust. 17(2), 1969).
    """
    from scipy.signal import czt

    step = float(frequencies[1] - frequencies[0]) if len(frequencies) > 1 else 0.0
    w, a = np.exp(-2j * np.pi * step * dt), np.exp(2j * np.pi * float(frequencies[0]) * dt)
    return np.asarray(czt(signals, len(frequencies), w, a, axis=0))


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of one equation (``"Cm"``, ``"roll"``, ...) from one stretch of record without a hole."""

    equation: str
    y: FloatArray  #: response (m,)
    X: FloatArray  #: regressors of all k parameters (m, k); zero columns for those that the equation lacks
    dt: float  #: s, sample period of the record
    maneuver: int = 0  #: of which the stretch is; -1 for a row of all of them

    @property
    def used(self) -> BoolArray:
        """Which parameters stand in the equation (k,)."""
        return np.asarray(np.any(self.X != 0.0, axis=0))

    def transformed(self, domain: Domain) -> Rows:
        """Return the rows in a domain; columns that the transform removes are exactly zero."""
        both = domain.rows(np.column_stack([self.y, self.X]), self.dt)
        X = both[:, 1:]
        if not domain.keeps_constants:
            X[:, np.linalg.norm(X, axis=0) <= ZERO_COLUMN * np.linalg.norm(self.X, axis=0)] = 0.0
        return replace(self, y=both[:, 0], X=X)

    def filtered(self, coefficients: FloatArray) -> Rows:
        """Return the rows less what the rows before predict with the coefficients (order,) of an autoregression.

        The first rows, which have too few before them, are left out.
        """
        from scipy.signal import lfilter

        order, taps = len(coefficients), np.concatenate([[1.0], -coefficients])
        both = lfilter(taps, [1.0], np.column_stack([self.y, self.X]), axis=0)[order:]
        return Rows(self.equation, both[:, 0], both[:, 1:], self.dt)


@dataclass(frozen=True, eq=False)
class Priors:
    """Prior mean, standard deviation and bounds of each parameter (k,), SI; infinite where there is none."""

    mean: FloatArray
    sigma: FloatArray
    lower: FloatArray | float = -np.inf
    upper: FloatArray | float = np.inf


@dataclass(frozen=True, eq=False)
class Estimates:
    """Least-squares estimates of k parameters, SI."""

    values: FloatArray  #: (k,)
    covariance: FloatArray  #: (k, k), as if the residuals were white; NaN for what is not identifiable
    sigma: dict[str, float]  #: standard deviation of the residuals by equation
    r2: dict[str, float]  #: coefficient of determination by equation
    rows: tuple[Rows, ...]  #: that were solved, in their domain: stretch by stretch, equation by equation

    @property
    def evidence(self) -> tuple[PieceEvidence, ...]:
        """Equation errors and regressors of each stretch, weighted by the residuals' deviations; columns are equations."""
        out, count = [], len(self.sigma)
        for first in range(0, len(self.rows), count):
            stretch = self.rows[first : first + count]
            residual = [(r.y - r.X @ self.values) / self.sigma[r.equation] for r in stretch]
            jacobian = [r.X / self.sigma[r.equation] for r in stretch]
            piece = PieceEvidence(np.stack(residual, axis=1), np.stack(jacobian, axis=1))
            out.append(replace(piece, maneuver=stretch[0].maneuver))
        return tuple(out)


@dataclass(frozen=True, eq=False)
class Equations(ABC):
    """The equations of a kind of vehicle at measured motion, as regression rows for k unknowns."""

    layout: Layout
    linear: ClassVar[bool]  #: whether the rows do not depend on where they are linearized
    explanations: ClassVar[Mapping[str, str]]  #: domain -> code of the notice that explains the method
    needed: ClassVar[str]  #: what to do where no regression is possible

    @property
    @abstractmethod
    def places(self) -> tuple[int, ...]:
        """Where the unknowns stand among free parameters, then nuisances."""

    @abstractmethod
    def rows(self, values: FloatArray) -> list[Rows]:
        """Return the rows of all samples, linearized about values (k,), SI."""

    def solved(self, rows: Sequence[Rows], priors: Priors, _: FloatArray) -> Estimates:
        """Return the estimates from rows in their domain, linearized about values (k,)."""
        return solve(rows, priors)

    @property
    def constants(self) -> dict[str, int]:
        """Equation -> its constant term, as a place among the unknowns."""
        return {}

    def priors(self, values: FloatArray | None = None) -> Priors:
        """Return those of the vehicle file about values (k,), by default the means, with its bounds (none of the biases)."""
        layout, about = self.layout, {} if values is None else dict(zip(self.places, values, strict=True))
        means = [(p, about.get(i, p.prior_mean)) for i, p in enumerate(layout.parameters)]
        known = [(*p.prior_about(mean), p.lower, p.upper) for p, mean in means]
        known += [(n.center, n.scale, -np.inf, np.inf) for n in layout.nuisances]
        return Priors(*np.array([known[i] for i in self.places]).reshape(-1, 4).T)

    @property
    def scales(self) -> FloatArray:
        """Widths of the bounds, and scales of the biases (k,), SI."""
        return self.layout.scales[list(self.places)]

    def vector(self, values: FloatArray) -> FloatArray:
        """Return the search vector (D + E,) of values (k,), SI; file values and guesses for what is not estimated."""
        layout, places = self.layout, list(self.places)
        zero = np.array([*layout.lower, *(n.center for n in layout.nuisances)])
        z = np.zeros(len(zero))
        z[: layout.dimension] = layout.start
        z[places] = (values - zero[places]) / layout.scales[places]
        return z

    @classmethod
    def not_estimable(cls, _: Vehicle) -> tuple[str, ...]:
        """Return the free numbers that no equation has."""
        return ()

    def reviewed(self, found: Estimates, _: Domain) -> tuple[Estimates, Self]:
        """Return the estimates with R2 of each equation, and the equations without those that the data do not explain."""
        return found, self

    def notices(self, _: Estimates) -> list[Notice]:
        """Return which equations or data the estimates do not rest on."""
        return []

    def estimate(self, domain: Domain, bounded: bool = False) -> Estimates | None:
        """Estimate the unknowns, within bounds or not.

        None where the motion was nowhere measured completely, or the equations diverge. A constant that the domain does not keep
        is found afterwards, from the means.
        """
        first = _gauss_newton(self, domain, bounded)
        if first is None:
            return None
        found, kept = self.reviewed(first, domain)
        again = None if kept is self else _gauss_newton(kept, domain, bounded)
        return found if again is None else kept.reviewed(again, domain)[0]


def _gauss_newton(equations: Equations, domain: Domain, bounded: bool) -> Estimates | None:
    def about(values: FloatArray | None = None) -> Priors:
        priors = equations.priors(values)
        return priors if bounded else replace(priors, lower=-np.inf, upper=np.inf)

    priors = about()
    values = priors.mean
    for _ in range(MAX_ITERATIONS):
        samples = equations.rows(values)
        rows = [t for r in samples if (t := r.transformed(domain)).y.size]
        if not rows or not all(np.isfinite(r.y).all() and np.isfinite(r.X).all() for r in rows):
            return None
        found = equations.solved(rows, priors, values)
        before, values = values, found.values
        if not np.isfinite(values).all():
            return None
        solved, priors = priors, about(values)
        linear = equations.linear and np.array_equal(priors.sigma, solved.sigma)
        if linear or np.max(np.abs(values - before) / equations.scales) < STEP_TOLERANCE:
            break
    lost = not domain.keeps_constants and equations.constants
    return _with_constants(found, samples, equations, priors) if lost else found


def _with_constants(
    found: Estimates, samples: Sequence[Rows], equations: Equations, priors: Priors
) -> Estimates:
    """Find constants from the means that the other terms leave; each mean is one more row of its equation."""
    values, means, spread = found.values.copy(), [], priors.sigma.copy()
    for equation, sigma in found.sigma.items():
        place, own = equations.constants.get(equation), [r for r in samples if r.equation == equation]
        y, X = np.concatenate([r.y for r in own]), np.concatenate([r.X for r in own])
        weight = 0.0  # without a constant that a mean could tell
        if place is not None:
            others, spread[place] = X.copy(), np.inf
            others[:, place] = 0.0
            left = y - others @ values
            values[place] = np.mean(left)
            values = np.clip(values, priors.lower, priors.upper)
            # noise of the mean itself is white noise's: the slow part of it is in the residual of the band
            weight = sigma / float(np.std(left) / np.sqrt(len(y)))
        mean = weight * np.mean(y)[None], weight * X.mean(axis=0)[None]
        maneuver = own[0].maneuver if len({r.maneuver for r in own}) == 1 else -1
        means.append(Rows(equation, *mean, own[0].dt, maneuver))
    rows = (*found.rows, *means)
    return replace(found, values=values, rows=rows, covariance=_covariance(rows, spread, found.sigma))


def solve(rows: Sequence[Rows], priors: Priors) -> Estimates:
    """Estimate parameters from rows in one domain; the equations are weighted by the variances of their residuals."""
    reduced = []
    for r in rows:  # few rows with the same normal equations: the triangle of a QR decomposition
        own = np.flatnonzero(r.used)
        triangle = np.asarray(np.linalg.qr(np.column_stack([r.X[:, own], r.y]), mode="r"))
        X = np.zeros((len(triangle), r.X.shape[1]))
        X[:, own] = triangle[:, :-1]
        reduced.append(replace(r, y=triangle[:, -1], X=X))
    of = {name: [r for r in rows if r.equation == name] for name in dict.fromkeys(r.equation for r in rows)}
    floor = {c: max(1e-9 * max(float(np.max(np.abs(r.y))) for r in own), 1e-12) for c, own in of.items()}
    sigma = {c: float(np.std(np.concatenate([r.y for r in own]))) for c, own in of.items()}
    used = {c: int(np.any([r.used for r in own], axis=0).sum()) for c, own in of.items()}
    values = priors.mean
    for _ in range(WEIGHT_ROUNDS):
        values = _weighted(reduced, priors, {c: max(s, floor[c]) for c, s in sigma.items()})
        left = {c: np.concatenate([r.y - r.X @ values for r in own]) for c, own in of.items()}
        sigma = {c: float(np.sqrt(np.sum(v**2) / max(len(v) - used[c], 1))) for c, v in left.items()}
    sigma = {c: max(s, floor[c]) for c, s in sigma.items()}
    r2 = {c: r_squared(np.concatenate([r.y for r in own]), left[c]) for c, own in of.items()}
    return Estimates(values, _covariance(reduced, priors.sigma, sigma), sigma, r2, tuple(rows))


def r_squared(y: FloatArray, residual: FloatArray) -> float:
    """Return the coefficient of determination of a response (m,) about its mean; NaN where it is constant."""
    total = float(np.sum((y - y.mean()) ** 2))
    return 1.0 - float(np.sum(residual**2)) / total if total > 0.0 else np.nan


def _weighted(rows: Sequence[Rows], priors: Priors, sigma: dict[str, float]) -> FloatArray:
    """Return the bounded weighted estimates; in the null space parameters keep their prior mean."""
    from scipy.optimize import lsq_linear

    stated = np.isfinite(priors.sigma)
    A = np.concatenate([*(r.X / sigma[r.equation] for r in rows), np.diag(1.0 / priors.sigma)[stated]])
    y = np.concatenate([*(r.y / sigma[r.equation] for r in rows), (priors.mean / priors.sigma)[stated]])
    size = np.linalg.norm(A, axis=0)
    free = size > ZERO_COLUMN * size.max(initial=0.0)
    bounds = np.stack([np.full_like(size, side) for side in (priors.lower, priors.upper)])
    free[free] = np.less(*(bounds[:, free] * size[free]))  # rounding can make one of both
    scale = size[free]
    lower, upper = bounds[:, free] * scale
    scaled = A[:, free] / scale
    null = np.empty((0, len(scale)))
    if scaled.size:
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        null = vectors[:, values <= NULL_EIGENVALUE * values[-1]].T
    target = np.concatenate([y, null @ (priors.mean[free] * scale)])
    out = priors.mean.copy()
    out[free] = lsq_linear(np.concatenate([scaled, null]), target, bounds=(lower, upper)).x / scale
    return out


def _covariance(rows: Sequence[Rows], priors: FloatArray, sigma: dict[str, float]) -> FloatArray:
    """Return the inverse of the information (k, k) of rows and priors of standard deviations (k,).

    NaN for parameters with a component in the null space, where a pseudo-inverse would give zero variance.
    """
    whitened = [np.where(r.used, r.X, 0.0) / sigma[r.equation] for r in rows]
    inverse = invert_rows(np.concatenate([*whitened, np.diag(1.0 / priors)]))
    return np.where(np.outer(inverse.determined, inverse.determined), inverse.matrix, np.nan)
