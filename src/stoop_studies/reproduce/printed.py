"""What the paper prints in its Table 1."""

from __future__ import annotations

from typing import Final

PRINTED: Final = {
    "GA": (
        0.0569999, 0.4199999, 0.3749999, 4.7699994, 10.451354, 0.2109999, 0.1839999, -2.3200006, -47.51452, -0.8100001,
    ),
    "PSO": (
        0.059909, 0.430754, 0.385599, 4.773452, 10.35328, 0.198585, 0.194544, -2.321577, -47.63800, -0.810625,
    ),
    "proposed": (
        0.06003, 0.42974, 0.38474, 4.78275, 10.4928, 0.20180, 0.19394, -2.11936, -47.5840, -0.79974,
    ),
}  # fmt: skip
"""Identified mean values of each method, in the order of `TABLE_1`."""

PRINTED_FITNESS: Final = {"GA": 121.57, "PSO": 289.38, "proposed": 84.26}
MISPRINT: Final = ("Cmalpha", -2.12)
"""Where the columns of GA and PSO say -2.32, it seems."""
