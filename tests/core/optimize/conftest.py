"""A small problem with many wrong optima: a decaying oscillation of unknown frequency, with a sensor bias."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.optimize import least_squares

from stoop import optimize

LOW = np.array([0.2, 0.0, 0.5, -1.0])  # amplitude, decay 1/s, angular frequency rad/s, phase rad
HIGH = np.array([3.0, 1.0, 9.0, 1.0])
TRUTH = np.array([1.3, 0.25, 5.1, 0.4])
TIME = np.linspace(0.0, 8.0, 240)


def response(Z: np.ndarray, time: np.ndarray) -> np.ndarray:
    a, b, w, p = (LOW + Z[:, :4] * (HIGH - LOW)).T[:, :, None]
    readings = a * np.exp(-b * time) * np.cos(w * time + p)
    return readings + 0.1 * Z[:, 4:5] if Z.shape[1] > 4 else readings


class Residuals:
    """A problem by its residuals alone, of one rung and without nuisances unless it says else."""

    dimension, extra, prices = 1, 0, (1.0,)
    jacobian = optimize.forward_jacobian

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        with np.errstate(all="ignore"):
            return (self.residuals(Z, rung) ** 2).sum(axis=1)

    def reference(self, rung: int) -> float:
        return 100.0


@dataclass
class Oscillation(Residuals):
    """Readings in sigmas of 0.01; rungs of 15 %, 40 % and the whole record.

    `spent` counts what was really asked, candidate by candidate, for comparison with the ledger.
    """

    measured: np.ndarray
    extra: int = 1
    shares: tuple[float, ...] = (0.15, 0.4, 1.0)
    broken: Callable[[np.ndarray], np.ndarray] | None = None  # which candidates diverge
    dimension: int = 4
    spent: float = field(default=0.0)
    largest: float = field(default=0.0)  # furthest outside the box that anything was asked

    @property
    def prices(self) -> tuple[float, ...]:
        return tuple(self._samples(k) / len(TIME) for k in range(len(self.shares)))

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        n = self._samples(rung)
        self.spent += len(Z) * n / len(TIME)
        self.largest = max(self.largest, float(np.abs(Z[:, :4] - 0.5).max(initial=0.0) - 0.5))
        R = (response(Z, TIME[:n]) - self.measured[:n]) / 0.01
        if self.broken is not None:
            R[self.broken(Z)] = np.nan
        return np.concatenate([R, Z[:, 4:]], axis=1)

    def reference(self, rung: int) -> float:
        n = self._samples(rung)
        return float((((self.measured[:n] - self.measured[0]) / 0.01) ** 2).sum())

    def _samples(self, rung: int) -> int:
        return round(self.shares[rung] * len(TIME))


def measure(seed: int = 0, noise: float = 0.01, bias: float = 0.05, disturbance: float = 0.0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    z = np.append((TRUTH - LOW) / (HIGH - LOW), bias / 0.1)
    slow = np.convolve(generator.standard_normal(len(TIME) + 40), np.ones(40) / 40**0.5, "valid")[: len(TIME)]
    return response(z[None, :], TIME)[0] + noise * generator.standard_normal(len(TIME)) + disturbance * slow


@pytest.fixture
def oscillation() -> Callable[..., Oscillation]:
    """Return a maker of problems: options of `measure`, then fields of `Oscillation`."""

    def make(**options: object) -> Oscillation:
        of = {name: options.pop(name) for name in ("seed", "noise", "bias", "disturbance") if name in options}
        return Oscillation(measure(**of), **options)

    return make


@pytest.fixture
def least(oscillation: Callable[..., Oscillation]) -> Callable[[Oscillation], float]:
    def find(problem: Oscillation) -> float:
        z = np.append((TRUTH - LOW) / (HIGH - LOW), np.zeros(problem.extra))
        full = len(problem.shares) - 1
        fit = least_squares(lambda v: problem.residuals(v[None, :], full)[0], z, xtol=1e-14, ftol=1e-14)
        return float(2.0 * fit.cost)

    return find


@pytest.fixture
def near() -> Callable[[float], np.ndarray]:
    """Return a maker of points beside the truth: every parameter multiplied by a factor."""
    return lambda factor: np.append((TRUTH * factor - LOW) / (HIGH - LOW), 0.0)
