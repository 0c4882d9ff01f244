r"""Natural modes of a fitted model, with intervals from the covariance of its parameters.

For a simple eigenvalue :math:`\lambda` of A with right and left eigenvectors x and y,

.. math:: \frac{\partial\lambda}{\partial\theta} = \frac{y^H (\partial A/\partial\theta)\, x}{y^H x},

so standard errors of its real and imaginary part, frequency, damping and time constant follow by the delta method. That
fails where two real modes are about to become an oscillation, or the other way around: there the eigenvalue has
no derivative. Parameters are therefore also drawn from their normal distribution; each draw's eigenvalues are those of
:math:`A + \sum \delta\theta_i\, \partial A/\partial\theta_i`, exactly. Where more than a few draws have another
character, or the spread of the draws is not what the derivatives say, the intervals are percentiles of the draws.

References
----------
P. Lancaster, "On eigenvalues of matrices dependent on a parameter", *Numerische Mathematik* 6, 1964, pp. 377-387
(the derivative).
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 3 (the modes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from stoop.base.arrays import FloatArray
from stoop.results.modes import Estimate, ModeEstimate
from stoop.simulation.linearize import Mode, modes_of

ComplexArray = npt.NDArray[np.complex128]
NORMAL_95: Final = 1.959963984540054
DRAWS: Final = 1000
CHANGED: Final = 0.025  #: of the draws with another character: an end of the 95 % interval may lie among them
UNLIKE: Final = 1.25  #: by which the draws may spread more or less than the derivatives say
STEP: Final = 1e-4  #: of a parameter's scale, for central differences of A: error of the order 1e-8
INTEGRATORS: Final = ("psi", "h")  #: states that nothing depends on, or next to nothing
SENSORS: Final = "sensors."  #: begins the names of numbers that no motion depends on
MATTERS: Final = (
    1e-3  #: of an eigenvalue: by less an unknown parameter may move it, and it is known all the same
)
REAL: Final = 1e-9  #: 1/s; a smaller imaginary part is rounding


@dataclass(frozen=True, eq=False)
class Linearized:
    """A and how it depends on the parameters.

    Attributes
    ----------
    names : tuple of str
        The n states; heading and altitude are left out.
    A : (n, n)
    derivative : (k, n, n), per SI unit of each parameter
    room : (k,), SI, or a number
        How far each parameter may sensibly move.
    """

    names: tuple[str, ...]
    A: FloatArray
    derivative: FloatArray
    room: FloatArray | float = 1.0

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """The modes of A, each pair once."""
        return modes_of(self.A, self.names)

    @cached_property
    def _vectors(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Eigenvalues (n,), right eigenvectors in columns, left ones in rows, scaled so that y^H x = 1."""
        values, right = np.linalg.eig(self.A)
        return np.asarray(values, dtype=complex), np.asarray(right, dtype=complex), np.linalg.inv(right)

    def gradient(self, eigenvalue: complex) -> ComplexArray:
        """Return the derivative (k,) of one eigenvalue by every parameter."""
        values, right, left = self._vectors
        i = int(np.argmin(np.abs(values - eigenvalue)))
        return np.asarray(np.einsum("i,kij,j->k", left[i], self.derivative, right[:, i]))

    def places(self, eigenvalue: complex) -> list[int]:
        """Return where an eigenvalue stands, and its conjugate if it has one."""
        values = self._vectors[0]
        first = int(np.argmin(np.abs(values - eigenvalue)))
        if abs(eigenvalue.imag) <= REAL:
            return [first]
        return [first, int(np.argmin(np.abs(values - eigenvalue.conjugate())))]

    def drawn(self, covariance: FloatArray, draws: int, seed: int) -> ComplexArray:
        """Return the eigenvalues (draws, n) of draws of the parameters, each in the place of its nearest of A."""
        power, basis = np.linalg.eigh(0.5 * (covariance + covariance.T))
        spread = basis * np.sqrt(np.maximum(power, 0.0))
        moves = np.random.default_rng(seed).standard_normal((draws, len(power))) @ spread.T
        values = np.linalg.eigvals(self.A + np.tensordot(moves, self.derivative, 1)).astype(complex)
        base = self._vectors[0]
        return np.array([row[linear_sum_assignment(np.abs(base[:, None] - row))[1]] for row in values])


def differentiated(
    matrix: Callable[[Mapping[str, float]], tuple[tuple[str, ...], FloatArray]],
    values: Mapping[str, float],
    scales: Mapping[str, float],
) -> Linearized:
    """Return A and its derivatives by central differences.

    Parameters
    ----------
    matrix : callable
        Returns state names and A for changed parameters.
    values, scales : mapping of str to float
        The parameters' estimates, and how far each may sensibly move.
    """
    names, A = matrix({})
    keep = [i for i, n in enumerate(names) if n not in INTEGRATORS]
    block = np.ix_(keep, keep)
    slopes = np.zeros((len(values), len(keep), len(keep)))
    for slope, (name, value) in zip(slopes, values.items(), strict=True):
        if name.startswith(SENSORS):
            continue
        step = STEP * scales[name]
        upper, lower = (matrix({name: value + sign * step})[1][block] for sign in (1.0, -1.0))
        slope[:] = (upper - lower) / (2.0 * step)
    room = np.array([scales[name] for name in values])
    return Linearized(tuple(names[i] for i in keep), A[block], slopes, room)


def mode_estimates(
    linearized: Linearized, parameters: tuple[str, ...], covariance: FloatArray, seed: int = 0
) -> tuple[ModeEstimate, ...]:
    """Return the flight modes, lags of surfaces left out, with their intervals.

    Parameters
    ----------
    linearized : Linearized
    parameters : tuple of str
        Names of the k parameters.
    covariance : (k, k)
        Of the parameters, SI; one of infinite variance makes a mode unknown that it could move by :data:`MATTERS`.
    seed : int
        Of the draws.
    """
    lost = ~np.isfinite(np.diag(covariance))
    known = np.where(lost[:, None] | lost[None, :], 0.0, covariance)
    drawn = linearized.drawn(known, DRAWS, seed)
    out = []
    for mode in linearized.modes:
        if mode.name.endswith(".lag"):
            continue
        gradient = linearized.gradient(mode.eigenvalue)
        # A lateral number has its part in the phugoid, by rounding and by a trim with a little sideslip: none to speak of.
        felt = np.abs(gradient) * linearized.room > MATTERS * abs(mode.eigenvalue)
        blind = [n for n, matters, gone in zip(parameters, felt, lost, strict=True) if gone and matters]
        if blind:
            out.append(_unknown(mode, blind))
        else:
            out.append(_estimated(mode, gradient, known, drawn[:, linearized.places(mode.eigenvalue)]))
    return tuple(out)


def _unknown(mode: Mode, blind: list[str]) -> ModeEstimate:
    found = {name: Estimate(value) for name, value in _quantities(mode.eigenvalue).items()}
    return replace(_of(mode, found), remark=f"depends on {', '.join(blind)}, which the data cannot tell")


def _of(mode: Mode, found: Mapping[str, Estimate]) -> ModeEstimate:
    real, imag, frequency = found["real"], found["imag"], found["frequency"]
    return ModeEstimate(mode.name, real, imag, frequency, found["damping"], found["time_constant"])


def _estimated(
    mode: Mode, gradient: ComplexArray, covariance: FloatArray, drawn: ComplexArray
) -> ModeEstimate:
    """Return one mode from its gradient (k,) and the draws (d, 1 or 2) of its eigenvalue or pair."""
    values, slopes = _quantities(mode.eigenvalue), _slopes(mode.eigenvalue, gradient)
    errors = {n: math.sqrt(max(0.0, float(g @ covariance @ g))) for n, g in slopes.items()}
    samples = _sampled(drawn)
    pair = abs(mode.eigenvalue.imag) > REAL
    other = float(np.mean((np.abs(drawn[:, 0].imag) > REAL) != pair))
    sampled = other > CHANGED or _unlike(errors["real"], samples["real"])
    spans = {n: _percentiles(samples[n]) if sampled else _normal(values[n], errors[n]) for n in values}
    if not pair:
        errors |= {"imag": math.nan, "damping": math.nan}  # of a real mode these are what they are
    spans["time_constant"], remark = _time_constants(spans["real"])
    found = {n: Estimate(values[n], errors[n], *spans[n]) for n in values}
    became = "two real modes" if pair else "an oscillation"
    remarks = [f"{became} in {100.0 * other:.0f} % of the draws"] if other > CHANGED else []
    return replace(
        _of(mode, found),
        method="sampled" if sampled else "delta",
        other_character=other,
        remark="; ".join([*remarks, *([remark] if remark else [])]),
    )


def _quantities(s: complex) -> dict[str, float]:
    """Return what is said of an eigenvalue."""
    size = abs(s)
    return {
        "real": s.real,
        "imag": s.imag,
        "frequency": size,
        "damping": -s.real / size if size else math.nan,
        "time_constant": -1.0 / s.real if s.real else math.inf,
    }


def _slopes(s: complex, gradient: ComplexArray) -> dict[str, FloatArray]:
    """Return the derivatives (k,) of all quantities from that of the eigenvalue."""
    size = abs(s) or math.nan
    of_size = (s.real * gradient.real + s.imag * gradient.imag) / size
    return {
        "real": gradient.real,
        "imag": gradient.imag,
        "frequency": of_size,
        "damping": -gradient.real / size + s.real * of_size / size**2,
        "time_constant": gradient.real / (s.real**2 or math.nan),
    }


def _sampled(drawn: ComplexArray) -> dict[str, FloatArray]:
    """Return the quantities of every draw; of a pair that became two real modes those of their product."""
    middle = drawn.mean(axis=1).real
    product = np.prod(drawn, axis=1).real if drawn.shape[1] == 2 else np.abs(drawn[:, 0]) ** 2
    frequency = np.sqrt(np.maximum(product, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = -middle / frequency
    return {
        "real": middle,
        "imag": np.abs(drawn[:, 0].imag),
        "frequency": frequency,
        "damping": damping,
        "time_constant": middle,
    }


def _unlike(error: float, draws: FloatArray) -> bool:
    """Tell whether the draws spread otherwise than the derivative says."""
    spread = float(np.std(draws))
    return error > 0.0 and not 1.0 / UNLIKE < spread / error < UNLIKE


def _normal(value: float, error: float) -> tuple[float, float]:
    return value - NORMAL_95 * error, value + NORMAL_95 * error


def _percentiles(draws: FloatArray) -> tuple[float, float]:
    low, high = (
        np.quantile(draws[np.isfinite(draws)], [0.025, 0.975])
        if np.isfinite(draws).any()
        else (math.nan,) * 2
    )
    return float(low), float(high)


def _time_constants(real: tuple[float, float]) -> tuple[tuple[float, float], str]:
    """Return the interval of -1 / real; none where it may be stable or not."""
    if real[0] < 0.0 < real[1]:
        return (math.nan, math.nan), "stable or unstable: the data cannot tell"
    low, high = sorted(-1.0 / end if end else math.inf for end in real)
    return (low, high), ""
