"""Regressions and transforms once more, from their definitions: one sum at a time, one row left out at a time."""

import cmath
import itertools

import numpy as np


def transform(signal: np.ndarray, frequency: float, dt: float) -> complex:
    """Return the finite Fourier transform at one frequency, Hz, by its sum."""
    return sum(complex(v) * cmath.exp(-2j * cmath.pi * frequency * dt * i) for i, v in enumerate(signal))


def press(y: np.ndarray, X: np.ndarray) -> float:
    """Return the prediction sum of squares by as many fits as there are rows."""
    total = 0.0
    for i in range(len(y)):
        rest = np.arange(len(y)) != i
        fit = np.linalg.lstsq(X[rest], y[rest], rcond=None)[0]
        total += float(y[i] - X[i] @ fit) ** 2
    return total


def rss(y: np.ndarray, X: np.ndarray) -> float:
    """Return the residual sum of squares of an ordinary fit."""
    return float(np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2))


def best_subset(y: np.ndarray, X: np.ndarray, size: int) -> tuple[int, ...]:
    """Return the columns of the best fit with so many, trying all."""
    return min(itertools.combinations(range(X.shape[1]), size), key=lambda c: rss(y, X[:, c]))


def double_sum(X: np.ndarray, v: np.ndarray, lags: int) -> np.ndarray:
    """Return sum_i sum_j x_i R(i - j) x_j' with the tapered sample autocovariance of v."""
    n = len(v)

    def covariance(lag: int) -> float:
        sampled = sum(v[i] * v[i + lag] for i in range(n - lag)) / n
        return float(sampled * (1.0 - lag / (lags + 1.0)))

    known = [covariance(lag) for lag in range(lags + 1)]
    out = np.zeros((X.shape[1], X.shape[1]))
    for i in range(n):
        for j in range(max(0, i - lags), min(n, i + lags + 1)):
            out += known[abs(i - j)] * np.outer(X[i], X[j])
    return out
