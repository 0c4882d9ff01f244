"""Priors that contradict the flight are widened, and all is fitted again.

Correlated residuals count as few samples, and a prior counts fully: a prior that is too narrow pulls its number, and those that
take up what it then lacks, away from what the flight says, by many of their error bars. The estimates without each prior tell
(:mod:`stoop.assessment.prior_conflicts`). Such a prior gets the standard deviation that the flight gives it, so that both count.
Priors of mass and inertia are measurements, or of what the flight shows in ratios only: they are named and stay.
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from typing import Final

from stoop.assessment.prior_conflicts import PriorConflict, prior_tests
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.results.decisions import DecisionRecord
from stoop.strategy.decision import Decision, Fitted, Fitter, Setup, test
from stoop.strategy.likelihood import log_likelihood_rise

NAME: Final = "priors"
MASS: Final = "mass."
MAX_ROUNDS: Final = 3  #: fits again; weights change with the residuals, and so may what contradicts
DOING: Final = "priors were compared with the flight"


def widen(setup: Setup, fit: Fitter) -> Fitted:
    """Return the fit with wider priors where the flight contradicts them."""
    first, cut = _with_tests(fit(setup))
    began, found, widened = time.perf_counter(), first, dict[str, PriorConflict]()
    for _ in range(MAX_ROUNDS):
        wider = {} if cut else _contradicted(found, setup)
        if not wider:
            break
        kept = {n: replace(c, consistent=wider[n].consistent) for n, c in widened.items() if n in wider}
        more = wider | widened | kept
        vehicle = setup.vehicle.with_numbers({n: {"prior": c.consistent} for n, c in more.items()})
        setup.watch(f"wider prior: {', '.join(wider)}")
        try:  # with all decisions before this one, which it may change
            found, cut = _with_tests(fit(setup.again(vehicle, found.estimate.start)))
        except KeyboardInterrupt:
            cut = True
            break
        except IdentificationError:  # a search that fails with less to hold it
            break
        widened = more
    if widened:
        found = found.resuming(first)
        record = DecisionRecord(
            NAME, "applied", f"the flight contradicts {', '.join(widened)}", "priors widened, fitted again",
            log_likelihood_rise(first.estimate, found.estimate)[0], seconds=time.perf_counter() - began,
        )  # fmt: skip
        found = found.noting(*(notice("prior-widened", n, **_values(c)) for n, c in widened.items()))
        found = found.recorded(record)
    return found.interrupted(DOING) if cut else found


def _with_tests(found: Fitted) -> tuple[Fitted, bool]:
    """Return a fit with its error bars, and whether Ctrl-C came meanwhile."""
    tested, cut = (found.tests, False) if found.tests else test(found.estimate, found.setup.left_out)
    return replace(found, tests=tested), cut


def _contradicted(found: Fitted, setup: Setup) -> dict[str, PriorConflict]:
    """Return the conflicts of priors that may be widened, of the fit before any decision; none of a search that was stopped."""
    if found.estimate.outcome.status == "interrupted":
        return {}
    conflicts = prior_tests(found.estimate, found.tested.bars).conflicts
    known = {p.name for p in setup.vehicle.parameters if p.prior is not None and not p.name.startswith(MASS)}
    return {one.name: one for one in conflicts if one.name in known}


def _values(one: PriorConflict) -> dict[str, float]:
    """Return the values of a notice of a conflict."""
    return {name: value for name, value in asdict(one).items() if name != "name"}


PRIORS: Final = Decision(NAME, "Does the flight contradict priors?", default=False, around=widen)
