"""Rotors that give less thrust than commanded: flights near hover compared with flights of the healthy vehicle."""

from stoop.estimate.effectiveness.comparison import (
    Assessment,
    Explanation,
    Reference,
    Verdict,
    advice,
    assess,
    indistinct,
    judge,
    leave_one_out,
)
from stoop.estimate.effectiveness.hover import Balance, Hover, hover, pooled

__all__ = [
    "Assessment",
    "Balance",
    "Explanation",
    "Hover",
    "Reference",
    "Verdict",
    "advice",
    "assess",
    "hover",
    "indistinct",
    "judge",
    "leave_one_out",
    "pooled",
]
