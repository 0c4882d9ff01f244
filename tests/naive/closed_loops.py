"""Loops in the time domain, sample by sample: a linear plant between the samples of a rate law, and whether it settles."""

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


def flown(
    A: np.ndarray, B: np.ndarray, rates: list[int], gains: list[dict[str, float]], loop_rate: float, late: int,
    asked: np.ndarray, held: np.ndarray | float = 0.0, gust: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return setpoints, rates and commands (n, k) of k PX4 loops that follow rates (n, k), step by step.

    Commands are held for a sample and act after `late` of them. Attitude loops take `held` (k, n) times the states off the
    setpoints; gusts, rad/s2, push the rates, with a correlation time of 0.5 s.
    """
    n, k, dt, rng = len(A), len(rates), 1.0 / loop_rate, np.random.default_rng([1, 2])
    step = expm(np.block([[A, B], [np.zeros((k, n + k))]]) * dt)
    F, G = step[:n, :n], step[:n, n:]
    laws = [Px4Loop(g["P"], g["I"], 0.0, g["FF"], np.inf) for g in gains]
    x, push, waiting, found = np.zeros(n), np.zeros(k), [np.zeros(k)] * late, []
    for wanted in asked:
        setpoint = wanted - np.broadcast_to(held, (k, n)) @ x
        turning = x[rates].copy()
        command = np.array(
            [
                sum(law.step(s, y, 0.0, dt, 1.0).values())
                for law, s, y in zip(laws, setpoint, turning, strict=True)
            ]
        )
        found.append((setpoint, turning, command))
        waiting.append(command)
        push = push * (1.0 - 2.0 * dt) + gust * np.sqrt(4.0 * dt) * rng.standard_normal(k)
        x = F @ x + G @ waiting.pop(0)
        x[rates] += dt * push
    setpoints, turned, commanded = (np.array(column) for column in zip(*found, strict=True))
    return setpoints, turned, commanded


def asked_at_random(count: int, axes: int, loop_rate: float, seed: int, size: float = 0.5) -> np.ndarray:
    """Return random rates (count, axes), rad/s, with a correlation time of 0.15 s."""
    rng, kept = np.random.default_rng(seed), np.exp(-1.0 / (0.15 * loop_rate))
    white = size * np.sqrt(1.0 - kept**2) * rng.standard_normal((count, axes))
    for i in range(1, count):
        white[i] += kept * white[i - 1]
    return white
