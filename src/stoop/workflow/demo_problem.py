"""The longitudinal problem of the PS-GDE paper, which `stoop demo` solves; imports nothing."""

from __future__ import annotations

from typing import Final

TABLE_1: Final = (
    "CD0", "CDalpha", "CL0", "CLalpha", "CLq", "CLelevator", "Cm0", "Cmalpha", "Cmq", "Cmelevator",
)  # fmt: skip
"""The coefficients that the paper identifies, in its order; their truths stand in the vehicle file."""

MANEUVER: Final = """
duration = 30.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.3
amplitude = 0.2
[[input]]
control = "elevator"
shape = "pulse"
start = 7.0
duration = 3.0
amplitude = -0.1
"""
"""The paper's Fig. 3: 3-2-1-1 of 0.3 s and 11.46 deg, a pulse of 3 s, then about half a phugoid."""
