"""Moments of inertia that a fit moves to a default bound, or to where no body has them, are held at the file's values.

And that about the axis of rotors whose torque is free, where the flight contradicts its prior.

A flight shows moments over inertia: of the moments of inertia themselves it shows ratios, by the coupling of the axes, and it
shows them weakly. Errors of the model are larger than that and move them far, while no force or moment tells their size. The
moment that lies farthest from the file's value is held, and all is fitted again, until the rest are those of a body: their second
moments of mass are positive (Wensing, Kim and Slotine). The prior of a held moment widens the error bars of the others.

References
----------
P. M. Wensing, S. Kim and J.-J. E. Slotine, "Linear matrix inequalities for physically consistent inertial parameter
identification", *IEEE Robotics and Automation Letters* 3(1), 2018, pp. 60-67.
"""

from __future__ import annotations

import math
import time
from typing import Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.results.decisions import DecisionRecord
from stoop.strategy.decision import Fitted, Fitter, Setup
from stoop.strategy.likelihood import log_likelihood_rise
from stoop.vehicle import Vehicle
from stoop.vehicle.checks import is_body

NAME: Final = "held-numbers"
PLACE: Final = "mass.inertia."
TORQUE: Final = ("rotors.torque_ratio", "rotors.Q")
DOING: Final = "moments of inertia were held"


def hold_inertia(setup: Setup, fit: Fitter) -> Fitted:
    """Return the fit with moments of inertia held that it moves to a default bound, or to where no body has them."""
    first = found = fit(setup)
    began, held, vehicle = time.perf_counter(), dict[str, float](), setup.vehicle
    while found.estimate.outcome.status != "interrupted":
        if not (name := _farthest(found.estimate, setup.vehicle)):
            break
        (known,) = (p for p in vehicle.parameters if p.name == name)
        # all that is known of a number without a prior is that its bounds hold it: evenly
        prior = known.prior or (known.upper - known.lower) / math.sqrt(12.0)
        vehicle = vehicle.with_numbers({name: {"value": known.prior_mean, "free": False, "prior": prior}})
        moved = found.estimate.estimates[name]
        try:
            found = found.again(vehicle, fit)
        except KeyboardInterrupt:
            found = found.interrupted(DOING)
            break
        except IdentificationError:  # nothing else is free, or the search fails: what was found stands
            break
        held[name] = moved
    if not held:
        return found
    record = DecisionRecord(
        NAME, "applied", f"{', '.join(held)} at a bound, or of no body", "held at the file's value, fitted again",
        log_likelihood_rise(first.estimate, found.estimate)[0], seconds=time.perf_counter() - began,
    )  # fmt: skip
    found = found.resuming(first)
    notices = [
        notice("inertia-held", name, estimate=value, value=vehicle.value(name))
        for name, value in held.items()
    ]
    return found.noting(*notices).recorded(record)


def _farthest(fit: Estimate, file: Vehicle) -> str:
    """Return the free moment farthest from the file's value if one is at a default bound, or all are of no body.

    Of that about the rotors' axis and their torque a flight shows the ratio: it is returned where its prior is contradicted.
    """
    vehicle = fit.problem.layout.vehicle
    free = {n: x for n, x in fit.estimates.items() if n.startswith(PLACE)}
    unbounded = {name for name, q in file.quantities.items() if q.bounds is None}

    def distance(name: str) -> float:
        a, b = (vehicle.value(f"{PLACE}{2 * axis}") for axis in name.removeprefix(PLACE))
        if name.endswith(("xx", "yy", "zz")):
            return abs(math.log(max(free[name], np.finfo(float).tiny) / a))
        return abs(free[name] - vehicle.value(name)) / math.sqrt(a * b)

    turned = PLACE + "zz"
    if turned in free and any(name.startswith(TORQUE) for name in fit.estimates):
        (known,) = (p for p in vehicle.parameters if p.name == turned)
        if known.prior and distance(turned) > NORMAL_95 * known.prior / known.prior_mean:
            return turned
    at_bound = any(u.fixed == "bound" for u in fit.unknowns if u.name in free.keys() & unbounded)
    alone = len(fit.estimates) < 2  # nothing would be left to fit
    if alone or (is_body(fit.identified_vehicle) and not at_bound):
        return ""
    return max(free, key=distance, default="")
