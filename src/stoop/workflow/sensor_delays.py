"""Delays of sensors that a vehicle file leaves out: freed, with a prior, where the score tests ask for them.

A reading that comes late is no fault of the aircraft: parameters that take it over are biased by many standard errors, while
residuals may look nearly white. So after each fit the score tests of what the model lacks are asked; as long as the strongest
is the delay of a sensor, no other extension explains as much, and the log-likelihood rises by more than Schwarz's penalty, it
becomes a free parameter. A file that gives a delay (0 for none) decides for itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from stoop.assessment.error_bars import ErrorBars, error_bars
from stoop.assessment.extensions import LIMITS, extension_tests
from stoop.base.notices import Notice, attempt, notice
from stoop.estimate.estimate import Estimate
from stoop.results.extensions import ExtensionTests
from stoop.vehicle import Vehicle
from stoop.vehicle.assumptions import USUAL
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import Extension, catalogue
from stoop.workflow.checkpoint import deferred_interrupt
from stoop.workflow.extension import gain

NOT_FREED: Final = "stopped by the user while delays of sensors were looked for"


@dataclass(frozen=True, eq=False)
class CheckedFit:
    """A fit with its error bars, and what its data ask for beside its model."""

    fit: Estimate
    bars: ErrorBars
    tests: ExtensionTests
    failed: tuple[Notice, ...] = ()  #: why nothing was tested

    @classmethod
    def of(cls, fit: Estimate) -> CheckedFit:
        """Return a fit, tested."""
        failed, bars = list[Notice](), error_bars(fit)
        tests = attempt(failed, ExtensionTests(), extension_tests, fit, bars)
        return cls(fit, bars, tests, tuple(failed))


def with_sensor_delays(
    vehicle: Vehicle, first: Estimate, refit: Callable[[Vehicle], Estimate], watch: Callable[[str], None]
) -> CheckedFit:
    """Return a fit with the delays of sensors that it asks for among its unknowns.

    Parameters
    ----------
    vehicle : Vehicle
        As it was given to the fit.
    first : Estimate
        Without them.
    refit : callable
        Fits another vehicle to the same data.
    watch : callable
        Is told what is fitted.
    """
    best, interrupted = _checked(first)
    freed = dict[str, str]()  # name: that of its parameter
    while not interrupted and (extension := _late_sensor(vehicle, best.tests)):
        entries = extension.entries({"value": 0.0, "prior": USUAL.sensor_delay_std})
        vehicle = with_entries(vehicle, entries)
        watch(f"delay: {extension.name}")
        try:
            found = refit(vehicle)
        except KeyboardInterrupt:  # what was found without it stands
            interrupted = True
            break
        if gain(best.fit, found) <= 0.0:
            break
        freed[extension.name] = ".".join(next(iter(entries)))
        best, interrupted = _checked(found)
    outcome = replace(best.fit.outcome, state=first.outcome.state)  # saved, and resumed, is the first search
    if interrupted:
        outcome = replace(outcome, status="interrupted", advice=NOT_FREED)
    index = {p.name: i for i, p in enumerate(best.fit.problem.layout.parameters)}
    notices = tuple(
        notice(
            "sensor-delay-freed", name, estimate=best.fit.estimates[one], std=float(best.bars.std[index[one]]),
            prior=USUAL.sensor_delay_std,
        )
        for name, one in freed.items()
    )  # fmt: skip
    return replace(best, fit=replace(best.fit, outcome=outcome, notices=(*notices, *best.fit.notices)))


def _checked(fit: Estimate) -> tuple[CheckedFit, bool]:
    """Return a fit, tested, and whether Ctrl-C came meanwhile: without its error bars a search that has ended were lost."""
    with deferred_interrupt() as ctrl_c:
        checked = CheckedFit.of(fit)
    return checked, ctrl_c.came


def _late_sensor(vehicle: Vehicle, tests: ExtensionTests) -> Extension | None:
    """Return the delay of a sensor that the data ask for before all else, if they do."""
    if not tests.found:
        return None
    late = {one.name: one for one in catalogue(vehicle) if one.readings}
    best, *others = tests.found
    tied = any(one.name not in late and best.gain - one.gain < LIMITS.tie for one in others)
    return None if tied else late.get(best.name)
