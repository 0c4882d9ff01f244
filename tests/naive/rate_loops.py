"""Rate loops step by step, as the descriptions of PX4's and ArduPilot's sources have them; nothing shared with the package."""

import math
from dataclasses import dataclass


@dataclass
class Px4Loop:
    """PX4's rate control about one axis."""

    p: float
    i: float
    d: float
    ff: float
    limit: float
    integral: float = 0.0

    def step(
        self, setpoint: float, rate: float, acceleration: float, dt: float, scale: float
    ) -> dict[str, float]:
        """Return the terms of a sample, scaled as for a fixed wing."""
        error = setpoint - rate
        terms = {
            "P": self.p * error * scale**2,
            "I": self.integral * scale**2,
            "D": -self.d * acceleration * scale**2,
            "FF": self.ff * setpoint * scale,
        }
        slower = max(0.0, 1.0 - (error / math.radians(400.0)) ** 2)
        self.integral += slower * self.i * error * dt
        self.integral = max(-self.limit, min(self.limit, self.integral))
        return terms


class LowPass:
    """First order, y += alpha (x - y), from its first sample."""

    def __init__(self, cutoff: float) -> None:
        self.cutoff, self.value, self.begun = cutoff, 0.0, False

    def step(self, x: float, dt: float) -> float:
        """Return the output of a sample."""
        alpha = dt / (dt + 1.0 / (2.0 * math.pi * self.cutoff)) if self.cutoff > 0.0 else 1.0
        self.value = self.value + alpha * (x - self.value) if self.begun else x
        self.begun = True
        return self.value


class ArduPilotLoop:
    """AC_PID, with the scales and units of a plane: share of 45 degrees."""

    def __init__(self, gains: dict[str, float], plane: bool) -> None:
        self.k, self.plane = gains, plane
        self.target, self.error = LowPass(gains["FLTT"]), LowPass(gains["FLTE"])
        self.derivative, self.integral, self.before = 0.0, 0.0, math.nan

    def step(self, setpoint: float, rate: float, dt: float, scale: float) -> dict[str, float]:
        """Return the terms of a sample."""
        squared = scale**2 if self.plane else 1.0
        target = self.target.step(setpoint * squared, dt)
        error = self.error.step(target - rate * squared, dt)
        if math.isfinite(self.before):
            cutoff = self.k["FLTD"]
            alpha = dt / (dt + 1.0 / (2.0 * math.pi * cutoff)) if cutoff > 0.0 else 1.0
            self.derivative += alpha * ((error - self.before) / dt - self.derivative)
        self.before = error
        self.integral = max(-self.k["IMAX"], min(self.k["IMAX"], self.integral + self.k["I"] * error * dt))
        unit = math.degrees(1.0) / 45.0 if self.plane else 1.0
        forward = self.k["FF"] * target / (scale if self.plane else 1.0)
        terms = {
            "P": self.k["P"] * error,
            "I": self.integral,
            "D": self.k["D"] * self.derivative,
            "FF": forward,
        }
        return {name: unit * x for name, x in terms.items()}
