"""Optimizers: numbers only, a problem in and an outcome out; no aircraft is known here.

>>> from stoop import optimize
>>> optimize.names()[0]
'ps-gde-lm'
"""

from stoop.optimize.ledger import Books, Ledger
from stoop.optimize.levenberg import Dive, Settings, dive
from stoop.optimize.minimize import Outcome, Progress, Stop, minimize
from stoop.optimize.problem import Problem, forward_jacobian
from stoop.optimize.registry import create, names
from stoop.optimize.state import Event, Optimizer, State
from stoop.optimize.store import load_state, save_state

__all__ = [
    "Books",
    "Dive",
    "Event",
    "Ledger",
    "Optimizer",
    "Outcome",
    "Problem",
    "Progress",
    "Settings",
    "State",
    "Stop",
    "create",
    "dive",
    "forward_jacobian",
    "load_state",
    "minimize",
    "names",
    "save_state",
]
