r"""Bandwidth and phase delay of attitude responses, and low-order equivalent systems, with 95 % intervals.

With :math:`\omega_{180}` the frequency at which the attitude lags the command by 180 deg, the phase bandwidth is where it lags by
135 deg, the gain bandwidth where the magnitude is 6 dB above that at :math:`\omega_{180}`, and the phase delay is

.. math:: \tau_p = -\frac{\Phi(2\omega_{180}) + \pi}{2\omega_{180}}.

A low-order equivalent system minimizes, over frequencies of known response,

.. math:: J = \frac{20}{n}\sum_i W_\gamma\,[(\Delta dB)^2 + 0.01745\,(\Delta deg)^2], \qquad
          W_\gamma = [1.58\,(1 - e^{-\gamma^2})]^2 .

Its interval follows from the random errors of the responses, which are correlated between neighboring frequencies as far as
the windows resolve them, and is widened where the residuals exceed those errors.

References
----------
*Handling Qualities Requirements for Military Rotorcraft*, ADS-33E-PRF, 2000, section 3.3.2.1. *Flying Qualities of Piloted
Aircraft*, MIL-STD-1797A, 1990, section 4.2.1.2 (bandwidth, equivalent systems). J. Hodgkinson, *Aircraft Handling
Qualities*, AIAA, 1999. M. B. Tischler and R. K. Remple, *Aircraft and Rotorcraft System Identification*, 2nd ed., 2012, eq. 11.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from stoop.extend.arrays import ComplexArray, FloatArray
from stoop.extend.fits import NORMAL_95, DerivedValue
from stoop.extend.motion import EXCITATIONS

NAN: Final = math.nan
PHASE_WEIGHT: Final = 0.01745  #: (1 deg)^2 as much as so many (1 dB)^2
GAIN_MARGIN, PHASE_MARGIN = 6.0, math.pi / 4.0  #: dB, rad
DRAWS: Final = 300
MIN_SHARE: Final = 0.9  #: of the draws that must reach a figure, else it has no interval
DB: Final = 20.0 / math.log(10.0)  #: dB of a relative change
DEG: Final = 180.0 / math.pi


@dataclass(frozen=True, eq=False)
class Known:
    """A response as it is known: of a flight with random errors, or of a model with draws."""

    frequency: FloatArray  #: (m,) rad/s, rising
    response: ComplexArray  #: (m,)
    coherence: FloatArray  #: (m,), 0 to 1
    draws: ComplexArray  #: (d, m), of what it may be
    error: FloatArray | None = None  #: (m,), relative standard error of a flight's
    window: FloatArray | None = None  #: (m,) s, length of the windows of a flight's


@dataclass(frozen=True)
class Bandwidth:
    """Figures of an attitude response: bandwidths and crossover in rad/s, phase delay in s; NaN where not reached."""

    crossover: DerivedValue  #: frequency of 180 deg lag
    phase_bandwidth: DerivedValue
    gain_bandwidth: DerivedValue
    phase_delay: DerivedValue

    @property
    def reached(self) -> bool:
        """Whether any figure lies within the known frequencies."""
        return any(math.isfinite(one.estimate) for one in vars(self).values())


@dataclass(frozen=True)
class EquivalentSystem:
    """A low-order equivalent system of one response."""

    name: str  #: short period, roll or Dutch roll
    input: str
    output: str
    #: gain, zero (1/s), frequency (rad/s), damping, time_constant (s), delay (s)
    parameters: Mapping[str, DerivedValue]
    cost: float  #: J; below 50 to 100 is usually taken as a good fit
    lowest: float  #: rad/s, of the frequencies that it was fitted to
    highest: float


def error_correlation(frequency: FloatArray, window: FloatArray) -> FloatArray:
    """Return the correlation (m, m) of random errors at frequencies, rad/s, for Hann windows of these lengths (m,), s."""
    t = (np.arange(256) + 0.5) / 256.0 - 0.5
    taper = np.cos(np.pi * t) ** 4
    cycles = np.abs(frequency[:, None] - frequency) / (2.0 * np.pi) * np.minimum(window[:, None], window)
    grid = np.linspace(0.0, 8.0, 801)
    kernel = np.cos(2.0 * np.pi * np.outer(grid, t)) @ taper / taper.sum()
    return np.asarray(np.interp(cycles, grid, kernel, right=0.0))


def flight_draws(
    frequency: FloatArray, response: ComplexArray, error: FloatArray, window: FloatArray, seed: int = 0
) -> ComplexArray:
    """Return draws (d, m) of a response with these relative random errors."""
    power, basis = np.linalg.eigh(error_correlation(frequency, window))
    root, rng = basis * np.sqrt(np.maximum(power, 0.0)), np.random.default_rng(seed)
    noise = (
        rng.standard_normal((DRAWS, len(power))) + 1j * rng.standard_normal((DRAWS, len(power)))
    ) @ root.T
    return np.asarray(response * np.exp(error * noise))


def bandwidth(known: Known) -> Bandwidth:
    """Return the figures of the attitude of which `known` is the rate."""
    s = 1j * known.frequency
    attitude = np.atleast_2d(known.response / s)
    start = float(upright_phase(attitude[0])[0])
    (found,) = attitude_figures(known.frequency, attitude, start)
    drawn = attitude_figures(known.frequency, known.draws / s, start)
    return Bandwidth(*(_interval(value, draws) for value, draws in zip(found, drawn.T, strict=True)))


def upright_phase(attitude: ComplexArray) -> FloatArray:
    """Return the phase (m,), rad, unwrapped, of an attitude whose control may be of either sign: it begins in (-pi, 0]."""
    phase = np.unwrap(np.angle(attitude))
    return np.asarray(phase - np.pi * np.ceil(phase[0] / np.pi - 1e-9))


def attitude_figures(frequency: FloatArray, attitude: ComplexArray, start: float) -> FloatArray:
    """Return crossover, phase and gain bandwidth, rad/s, and phase delay, s, (d, 4); NaN for what is not reached.

    Parameters
    ----------
    frequency : (m,) rad/s, rising
    attitude : (d, m), over its command
    start : rad, phase at the first frequency, to multiples of pi
    """
    phase = np.unwrap(np.angle(attitude), axis=1)
    phase += np.pi * np.round((start - phase[:, :1]) / np.pi)
    gain, log = DB * np.log(np.abs(attitude)), np.log(frequency)
    crossing, rows = _crossing(log, phase, -np.pi), np.arange(len(phase))
    level = _at(log, gain, crossing) + GAIN_MARGIN
    # the highest frequency below the crossover at which the magnitude is that much larger
    over = (log <= crossing[:, None]) & (gain >= level[:, None])
    i = np.minimum(len(log) - 1 - np.argmax(over[:, ::-1], axis=1), len(log) - 2)
    twice = crossing + math.log(2.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (gain[rows, i] - level) / (gain[rows, i] - gain[rows, i + 1])
        wide = np.where(over[:, :-1].any(axis=1), np.exp(log[i] + share * (log[i + 1] - log[i])), NAN)
        late = -(_at(log, phase, twice) + np.pi) / np.exp(twice)
    narrow = np.where(np.isfinite(crossing), np.exp(_crossing(log, phase, -np.pi + PHASE_MARGIN)), NAN)
    late = np.where(np.exp(twice) <= frequency[-1], late, NAN)
    return np.column_stack([np.exp(crossing), narrow, wide, late])


def _at(log: FloatArray, curves: FloatArray, x: FloatArray) -> FloatArray:
    """Return curves (d, m) at x (d,), on straight lines."""
    i = np.clip(np.searchsorted(log, x) - 1, 0, len(log) - 2)
    rows = np.arange(len(curves))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((x - log[i]) / (log[i + 1] - log[i]), 0.0, 1.0)
        return np.asarray(curves[rows, i] + share * (curves[rows, i + 1] - curves[rows, i]))


def _crossing(log: FloatArray, phase: FloatArray, level: float) -> FloatArray:
    """Return the log frequency (d,) at which phases (d, m) first fall below a level; NaN where they do not."""
    below = (phase[:, 1:] <= level) & (phase[:, :-1] > level)
    rows, i = np.arange(len(phase)), np.argmax(below, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (phase[rows, i] - level) / (phase[rows, i] - phase[rows, i + 1])
    return np.where(below[rows, i], log[i] + share * (log[i + 1] - log[i]), NAN)


def _interval(value: float, draws: FloatArray) -> DerivedValue:
    """Return a figure with the standard deviation and the 95 % interval of its draws (d,)."""
    finite = draws[np.isfinite(draws)]
    if not np.isfinite(value) or finite.size < max(2.0, MIN_SHARE * draws.size):
        return DerivedValue(float(value))
    low, high = np.quantile(finite, (0.025, 0.975))
    return DerivedValue(float(value), float(np.std(finite)), float(low), float(high))


Transfer = Callable[[ComplexArray, FloatArray], ComplexArray]


@dataclass(frozen=True)
class Form:
    """A low-order form: its transfer function of s with a gain and delay of one, and its positive parameters."""

    name: str
    parameters: tuple[str, ...]
    shape: Transfer


def _second_order(s: ComplexArray, x: FloatArray) -> ComplexArray:
    zero, frequency, damping = x
    return np.asarray((s + zero) / (s**2 + 2.0 * damping * frequency * s + frequency**2))


FORMS: Final[Mapping[str, Form]] = {
    "q": Form("short period", ("zero", "frequency", "damping"), _second_order),
    "p": Form("roll", ("time_constant",), lambda s, x: np.asarray(1.0 / (x[0] * s + 1.0))),
    "r": Form("Dutch roll", ("zero", "frequency", "damping"), _second_order),
}  #: by the rate
#: to an axis that rotors command
ON_ROTORS: Final = Form("rotors", ("time_constant",), lambda s, x: np.asarray(1.0 / (s * (x[0] * s + 1.0))))
MIN_POINTS: Final = 8  #: of a response, for five parameters
BOUNDS: Final = (1e-3, 1e3)  #: of zero, frequency, damping and time constant
MAX_DELAY: Final = 1.0  #: s
MIN_DELAY: Final = 1e-6  #: s; what the bound of the search leaves is none
#: standard error of the logarithm of a parameter, beyond which it is not determined
MAX_LOG_ERROR: Final = 1.0


def equivalent_system(known: Known, input_name: str, output: str) -> EquivalentSystem | None:
    """Fit the low-order form of a rate; None where it is known at too few frequencies."""
    if len(known.frequency) < MIN_POINTS:
        return None
    form = ON_ROTORS if input_name in EXCITATIONS else FORMS[output]
    s = np.asarray(1j * known.frequency, dtype=np.complex128)
    weights = np.sqrt(20.0 / len(s)) * 1.58 * (1.0 - np.exp(-known.coherence))

    def residual(x: FloatArray, sign: float, response: ComplexArray = known.response) -> FloatArray:
        ratio = response / (sign * np.exp(x[0] - s * x[1]) * form.shape(s, np.exp(x[2:])))
        decibels, degrees = DB * np.log(np.abs(ratio)), DEG * np.angle(ratio)
        return np.concatenate([weights * decibels, weights * math.sqrt(PHASE_WEIGHT) * degrees])

    low, high = (math.log(b) for b in BOUNDS)
    lower = np.array([-30.0, 0.0, *[low] * len(form.parameters)])
    upper = np.array([30.0, MAX_DELAY, *[high] * len(form.parameters)])
    fits = [
        (
            sign,
            least_squares(residual, start, bounds=(lower, upper), x_scale="jac", args=(sign,), max_nfev=60),
        )
        for sign in (1.0, -1.0)
        for start in _starts(known, form)
    ]
    sign, best = min(fits, key=lambda found: float(found[1].cost))
    errors = _standard_errors(known, partial(residual, sign=sign), best.x, np.asarray(best.jac), weights)
    errors[(best.x[2:] <= lower[2:] + 1e-3).nonzero()[0] + 2] = NAN
    errors[(best.x[2:] >= upper[2:] - 1e-3).nonzero()[0] + 2] = NAN
    names = ("gain", "delay", *form.parameters)
    triples = zip(names, best.x.tolist(), errors.tolist(), strict=True)
    parameters = {name: _parameter(name, value, error, sign) for name, value, error in triples}
    span = float(known.frequency[0]), float(known.frequency[-1])
    return EquivalentSystem(form.name, input_name, output, parameters, float(2.0 * best.cost), *span)


def _parameter(name: str, value: float, error: float, sign: float) -> DerivedValue:
    """Return a parameter from its logarithm (the delay is itself) and the standard error of that, if it is determined."""
    if name == "delay":
        value = 0.0 if value < MIN_DELAY else value
        return DerivedValue(value, error, value - NORMAL_95 * error, value + NORMAL_95 * error)
    scale = sign if name == "gain" else 1.0
    size = scale * math.exp(value)
    if not error < MAX_LOG_ERROR:
        return DerivedValue(size)
    low, high = sorted(size * math.exp(end * NORMAL_95 * error) for end in (-1.0, 1.0))
    return DerivedValue(size, abs(size) * error, low, high)


def _starts(known: Known, form: Form) -> list[FloatArray]:
    """Return starts of the fit: gains of the middle of the band, natural frequencies across it."""
    s = np.asarray(1j * known.frequency, dtype=np.complex128)
    places = np.geomspace(known.frequency[0], known.frequency[-1], 5)[:-1]
    out = []
    for place in places:
        shape = [1.0 / place] if len(form.parameters) == 1 else [0.5 * place, place, 0.5]
        ratio = np.log(np.abs(known.response / form.shape(s, np.array(shape))))
        out.append(np.array([float(np.mean(ratio)), 0.03, *np.log(shape)]))
    return out


def _standard_errors(
    known: Known,
    residual: Callable[..., FloatArray],
    x: FloatArray,
    jacobian: FloatArray,
    weights: FloatArray,
) -> FloatArray:
    """Return the standard errors (k,) of the parameters: of a flight by its random errors, of a model by its draws."""
    inverse = np.linalg.pinv(jacobian)
    if known.error is None or known.window is None:
        if not len(known.draws):
            return np.full(len(x), np.nan)
        base = residual(x)
        moved = np.array([residual(x, response=one) - base for one in known.draws]) @ inverse.T
        return np.asarray(np.std(moved, axis=0))
    m, shared = len(weights), error_correlation(known.frequency, known.window)
    sizes = np.concatenate([DB * known.error, DEG * math.sqrt(PHASE_WEIGHT) * known.error])
    sizes *= np.concatenate([weights, weights])
    covariance = np.zeros((2 * m, 2 * m))
    covariance[:m, :m] = covariance[m:, m:] = shared
    covariance *= np.outer(sizes, sizes)
    misfit = max(1.0, float(np.mean((residual(x) / np.maximum(sizes, 1e-12)) ** 2)))
    spread = inverse @ covariance @ inverse.T * misfit
    return np.asarray(np.sqrt(np.maximum(np.diag(spread), 0.0)))
