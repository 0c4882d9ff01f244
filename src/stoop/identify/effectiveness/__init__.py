"""Which rotor gives less thrust than its command says: flights near hover held against flights of the healthy vehicle."""

from stoop.identify.effectiveness.balance import Balance
from stoop.identify.effectiveness.compare import Assessment, Reference, Suspect, assess, leave_one_out
from stoop.identify.effectiveness.hover import Hover, hover, together
from stoop.identify.effectiveness.sharper import advice
from stoop.identify.effectiveness.verdict import Verdict, alike, judge

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
