"""Delays of sensors that a vehicle file leaves out are freed, with a prior, where the inertial sensors or score tests show them.

Sensor delays are instrument parameters, not vehicle parameters: coefficients that compensate for one are biased by many
standard errors, while residuals may look nearly white. After each fit, as long as the strongest extension is the delay of a
sensor, no other extension explains as much, and the log-likelihood rises by more than Schwarz's penalty, it becomes a free
parameter. The delay of velocities is known before the fit where force and attitude were recorded, whatever the model lacks. A
file that gives a delay (0 for none) decides for itself.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, Final

from stoop.assessment.extensions import Limits
from stoop.base.notices import Notice, notice
from stoop.base.variables import VELOCITY
from stoop.errors import IdentificationError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.regression.velocity_delay import velocity_delay
from stoop.results.decisions import DecisionRecord
from stoop.results.extensions import ExtensionTests
from stoop.strategy.decision import Change, Decision, Fitted, Fitter, Setup, Tested, test
from stoop.strategy.gusts import IN_GUSTS
from stoop.strategy.likelihood import log_likelihood_rise, penalized_rise
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import Extension, catalogue
from stoop.vehicle.usual import USUAL

NAME: Final = "sensor-delays"
DOING: Final = "delays of sensors were looked for"
WIDTH: Final = 3.0  #: standard errors within which a delay is none


def find_delay(setup: Setup) -> Change | None:
    """Return the fit with the delay of velocities behind the inertial sensors; a filter takes it as known."""
    late = [one for one in catalogue(setup.vehicle) if one.kind == "delay" and {*VELOCITY} & {*one.readings}]
    if not late or not methods.find(setup.options.method).simulates:
        return None
    found = velocity_delay(setup.flights.values(), USUAL.sensor_delay_bounds)
    if found is None or WIDTH * found[1] > USUAL.sensor_delay_std:
        return None
    delay, std = found
    entry: Any = {"value": delay, "prior": std, "bounds": list(USUAL.sensor_delay_bounds)}
    done, said = "prior", [notice("sensor-delay-found", late[0].name, delay=delay, std=std)]
    if abs(delay) <= WIDTH * std:
        entry, done, said = 0.0, "taken for in time", []
    elif setup.options.method == IN_GUSTS:
        entry, done = delay, "taken as known"
    changed = replace(setup, vehicle=with_entries(setup.vehicle, late[0].entries(entry)))
    told = f"velocities {delay:.3f} ± {std:.3f} s behind the inertial sensors"
    return Change(changed.noting(*said), told, done)


def free_delays(setup: Setup, fit: Fitter) -> Fitted:
    """Return the fit with the delays of sensors that it asks for among its unknowns."""
    saved = first = best = fit(setup)
    tested, cut = test(first.estimate, setup.left_out)
    began, vehicle = time.perf_counter(), setup.vehicle
    freed = dict[str, str]()  # name: that of its parameter
    ended = first.estimate.outcome.status != "interrupted"
    while ended and not cut and (extension := _late_sensor(vehicle, tested.tests)):
        box = list(USUAL.sensor_delay_bounds)
        entries = extension.entries({"value": 0.0, "prior": USUAL.sensor_delay_std, "bounds": box})
        longer = with_entries(vehicle, entries)
        setup.watch(f"delay: {extension.name}")
        try:
            base, found = best, fit(setup.again(longer, best.estimate.start))
            cut = found.estimate.outcome.status == "interrupted"
            if not cut and found.setup.options.method != best.setup.options.method:
                # likelihoods of two methods do not compare
                base = fit(found.setup.again(vehicle, best.estimate.start))
                cut = base.estimate.outcome.status == "interrupted"
        except KeyboardInterrupt:
            cut = True
        except IdentificationError:  # a filter that was named needs delays that are known
            break
        if cut or penalized_rise(base.estimate, found.estimate) <= 0.0:  # what was found without it stands
            break
        freed[extension.name] = ".".join(next(iter(entries)))
        first = first if base is best else base
        best, vehicle = found, longer
        tested, cut = test(best.estimate, setup.left_out)
    outcome = replace(best.estimate.outcome, state=saved.estimate.outcome.state)  # saved, and resumed
    best = replace(best, estimate=replace(best.estimate, outcome=outcome), tests=tested)
    if freed:
        rise = log_likelihood_rise(first.estimate, best.estimate)[0]
        record = DecisionRecord(
            NAME, "applied", "score tests ask for a delay before all else", f"{', '.join(freed)} estimated",
            rise, seconds=time.perf_counter() - began,
        )  # fmt: skip
        best = best.noting(*_notices(best.estimate, tested, freed)).recorded(record)
    return best.interrupted(DOING) if cut else best


def _notices(fit: Estimate, tested: Tested, freed: dict[str, str]) -> list[Notice]:
    """Return the estimates of freed delays."""
    index = {p.name: i for i, p in enumerate(fit.problem.layout.parameters)}
    found = {name: (fit.estimates[one], float(tested.bars.std[index[one]])) for name, one in freed.items()}
    prior = USUAL.sensor_delay_std
    return [
        notice("sensor-delay-freed", n, estimate=x, std=std, prior=prior) for n, (x, std) in found.items()
    ]


def _late_sensor(vehicle: Vehicle, tests: ExtensionTests) -> Extension | None:
    """Return the delay of a sensor that the data ask for before all else, if they do."""
    if not tests.found:
        return None
    late = {one.name: one for one in catalogue(vehicle) if one.readings}
    best, *others = tests.found
    tied = any(one.name not in late and best.gain - one.gain < Limits.tie for one in others)
    return None if tied else late.get(best.name)


SENSOR_DELAYS = Decision(NAME, "Are readings of a sensor late?", problem=find_delay, around=free_delays)
