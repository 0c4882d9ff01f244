"""Optimizers: a problem in, an outcome out; they know numbers only, no aircraft.

A problem (`Problem`) is a sum of squares over D variables in the unit box and E nuisances, which can be evaluated on
the whole record or on shorter rungs of it, each at its price. `minimize` runs an optimizer on it until an optimum is
confirmed, a target is reached, or generations or budget run out::

    outcome = optimize.minimize(
        optimize.create("ps-gde-lm"), problem, seed=1, starts=own_values, stop=optimize.Stop(budget=5000),
        callback=lambda progress: optimize.save_state(path, progress.state),
    )

"ps-gde-lm" is the default (`ps_gde_lm.PsGdeLm`): the user's own values first, then scouts on the shortest record, the
best of them followed up the ladder by Levenberg-Marquardt refinement, then ordered SHADE (`population`). The others
hand the problem to another library (`libraries`); installed packages add theirs (`registry`).

A run is decided by its seed to the last bit, whatever the number of BLAS threads, and may be saved after any step and
resumed as if uninterrupted. Only another kind of processor may round otherwise, as BLAS has kernels for each. `refine` is
the local search alone; `descend` continues from one start to the last digit.

>>> from stoop import optimize
>>> optimize.names()[:4]
('ps-gde-lm', 'scipy-de', 'scipy-least-squares', 'cma')
"""

from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.local_refinement import Refinement, Settings, descend, refine
from stoop.optimize.minimize import Outcome, Progress, Stop, minimize
from stoop.optimize.problem import Problem, ScalarProblem, forward_jacobian
from stoop.optimize.registry import create, names, needs_residuals
from stoop.optimize.state import Event, Optimizer, State, load_tagged, save_state

__all__ = [
    "Evaluations", "Event", "Ledger", "Optimizer", "Outcome", "Problem", "Progress", "Refinement",
    "ScalarProblem", "Settings", "State", "Stop", "create", "descend", "forward_jacobian",
    "load_tagged", "minimize", "names", "needs_residuals", "refine", "save_state",
]  # fmt: skip
