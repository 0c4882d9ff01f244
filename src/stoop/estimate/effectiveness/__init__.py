"""Which rotor gives less thrust than its command says: flights near hover held against flights of the healthy vehicle."""

from stoop.estimate.effectiveness.balance import Balance
from stoop.estimate.effectiveness.compare import Assessment, Reference, Suspect, assess, leave_one_out
from stoop.estimate.effectiveness.hover import Hover, hover, together
from stoop.estimate.effectiveness.sharper import advice
from stoop.estimate.effectiveness.verdict import Verdict, alike, judge

__all__ = [
    "Assessment",
    "Balance",
    "Hover",
    "Reference",
    "Suspect",
    "Verdict",
    "advice",
    "alike",
    "assess",
    "hover",
    "judge",
    "leave_one_out",
    "together",
]
