"""Optimizers: numbers only, a problem in and an outcome out; no aircraft is known here.

A problem (`Problem`) is a sum of squares over D variables in the unit box and E nuisances, which can be
asked for on the whole record or on shorter rungs of it, each at its price. `minimize` runs an optimizer on
it until an optimum is confirmed, a target is reached, or generations or budget run out::

    outcome = optimize.minimize(
        optimize.create("ps-gde-lm"), problem, seed=1, starts=own_values, stop=optimize.Stop(budget=5000),
        callback=lambda progress: optimize.save_state(path, progress.state),
    )

"ps-gde-lm" is the default (`methods.ps_gde_lm.PsGdeLm`): the user's own values first, then scouts on the shortest record,
the best of them followed up the ladder by Levenberg-Marquardt dives, then ordered SHADE. The others are composed of
`pieces`, one a file in `methods`, or hand the problem to another library (`adapters`).

A run is decided by its seed to the last bit, whatever the number of BLAS threads, and may be saved after any
step and resumed as if nothing had been. `dive` is the local search alone; `descend` goes on from one start to the last digit.

>>> from stoop import optimize
>>> optimize.names()[:4]
('ps-gde-lm', 'scipy-de', 'scipy-least-squares', 'cma')
"""

from stoop.optimize.geodesic import descend
from stoop.optimize.ledger import Books, Ledger
from stoop.optimize.levenberg import Dive, Settings, dive
from stoop.optimize.minimize import Outcome, Progress, Stop, minimize
from stoop.optimize.problem import Problem, forward_jacobian
from stoop.optimize.registry import create, names, needs_residuals
from stoop.optimize.state import Event, Optimizer, State
from stoop.optimize.store import load_state, load_tagged, save_state

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
    "descend",
    "dive",
    "forward_jacobian",
    "load_state",
    "load_tagged",
    "minimize",
    "names",
    "needs_residuals",
    "save_state",
]
