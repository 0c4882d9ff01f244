"""The quadrotor's experiment in plain numbers; imports nothing, as `stoop_studies.problems.experiment`."""

from __future__ import annotations

from typing import Final

SOUGHT: Final = (
    "rotors.T1", "rotors.T2", "rotors.torque_ratio", "rotors.inflow", "rotors.drag", "rotors.lag",
    "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "body_drag.quadratic.x",
)  # fmt: skip
"""What is sought; the truths stand in the file of quad-x. The mass is known, without it only ratios show."""

LENGTH: Final = 0.5  #: s, of a window

NOISE: Final = {
    "vn": 0.3, "ve": 0.3, "vd": 0.3, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.10,
}  # fmt: skip
"""Standard deviation of each channel, m/s, rad/s, rad, m/s2: that of the paper's problem, its airspeed's for velocity."""

MANEUVER: Final = """
duration = 12.0
rate = 50.0
altitude = 100.0
[[input]]
control = "roll"
shape = "3-2-1-1"
start = 0.2
step = 0.15
amplitude = 10.0
[[input]]
control = "pitch"
shape = "3-2-1-1"
start = 1.6
step = 0.15
amplitude = 10.0
[[input]]
control = "yaw"
shape = "3-2-1-1"
start = 1.0
step = 0.3
amplitude = 1.0
[[input]]
control = "heave"
shape = "3-2-1-1"
start = 3.6
step = 0.4
amplitude = 3.0
[[input]]
control = "north"
shape = "doublet"
start = 6.6
step = 2.2
amplitude = 5.0
[[input]]
control = "east"
shape = "doublet"
start = 7.2
step = 2.2
amplitude = 5.0
"""
"""From hover: 3-2-1-1 of angular acceleration about each axis (rad/s2), of climb (m/s2), then velocities (m/s)."""
