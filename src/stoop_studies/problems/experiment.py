"""The paper's experiment in plain numbers; imports nothing, so that a command line may read it for free."""

from __future__ import annotations

from typing import Final

from stoop.workflow.demo_problem import MANEUVER, TABLE_1

__all__ = ["MANEUVER", "TABLE_1"]

SAMPLES: Final = 1500
"""Of the record that is fitted: 30 s at 50 Hz."""

NOISE: Final = {
    "V": 0.3, "alpha": 0.005, "beta": 0.005, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.10,
}  # fmt: skip
"""Standard deviation of each channel, m/s, rad, rad/s, m/s2; Q is its inverse square (not printed)."""

LEFT_OUT: Final = {"CLV": 0.05, "CDV": 0.02, "CDalpha2": 1.2, "CmV": 0.03}
"""Longitudinal terms of eq. (1) that Table 1 leaves out, with truths of our own, none of them zero."""

LONGITUDINAL: Final = (*TABLE_1, *LEFT_OUT)

LATERAL: Final = (
    "CQ0", "CQbeta", "CQp", "CQr", "CQrudder", "CQV", "Cl0", "Clbeta", "Clp", "Clr", "Claileron", "Clrudder",
    "Cn0", "Cnbeta", "Cnp", "Cnr", "Cnaileron", "Cnrudder",
)  # fmt: skip
"""The lateral and directional terms of eq. (1); their truths, ours, stand in the vehicle file."""

LATERAL_MANEUVER: Final = """
duration = 30.0
rate = 50.0
[[input]]
control = "rudder"
shape = "3-2-1-1"
start = 1.0
step = 0.5
amplitude = 0.12
[[input]]
control = "aileron"
shape = "2-1-1"
start = 8.0
step = 0.5
amplitude = 0.10
[[input]]
control = "rudder"
shape = "doublet"
start = 15.0
step = 0.7
amplitude = -0.15
[[input]]
control = "aileron"
shape = "doublet"
start = 21.0
step = 0.6
amplitude = -0.10
"""
"""Rudder and aileron in turn, ours: the paper flies the elevator only."""
