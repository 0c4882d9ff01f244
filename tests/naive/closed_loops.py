"""Loops in the time domain, sample by sample: a linear plant between the samples of a rate law, and whether it settles."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from naive.rate_loops import Px4Loop


def grows(
    A: np.ndarray, b: np.ndarray, rate: int, gains: dict[str, float], factor: float, loop_rate: float
) -> bool:
    """Return whether a disturbed loop of P and I on the rate, a state of the plant, grows; commands are held for a sample.

    The `factor` multiplies the command: a gain at the actuator.
    """
    n, dt = len(A), 1.0 / loop_rate
    step = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * dt)
    F, g = step[:n, :n], step[:n, n]
    law, x, size = Px4Loop(gains["P"], gains["I"], 0.0, 0.0, np.inf), np.full(n, 1e-3), []
    for _ in range(round(60.0 * loop_rate)):
        terms = law.step(0.0, float(x[rate]), 0.0, dt, 1.0)
        x = F @ x + g * factor * (terms["P"] + terms["I"])
        size.append(float(np.abs(x).max()))
        if size[-1] > 1e3:
            return True
    quarter = len(size) // 4
    return max(size[-quarter:]) > max(size[quarter : 2 * quarter])


def moved_by_noise(
    A: np.ndarray, b: np.ndarray, gains: dict[str, float], loop_rate: float, late: float, sigma: float
) -> float:
    """Return the rms of the command of P and I on a rate, the first state, whose readings have white noise; 400 s.

    Commands are held for a sample and act after a delay of whole samples.
    """
    n, dt, rng = len(A), 1.0 / loop_rate, np.random.default_rng(0)
    step = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * dt)
    F, g = step[:n, :n], step[:n, n]
    law, x = Px4Loop(gains["P"], gains["I"], 0.0, 0.0, np.inf), np.zeros(n)
    waiting, commands = [0.0] * round(late * loop_rate), []
    for noise in sigma * rng.standard_normal(round(400.0 * loop_rate)):
        terms = law.step(0.0, float(x[0] + noise), 0.0, dt, 1.0)
        commands.append(terms["P"] + terms["I"])
        waiting.append(commands[-1])
        x = F @ x + g * waiting.pop(0)
    return float(np.std(commands))
