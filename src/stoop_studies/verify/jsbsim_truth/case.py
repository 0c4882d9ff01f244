"""One aircraft, flown once: what stoop is told, what the instruments read, what is true; and one noisy fit."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.flight import Flight, from_columns
from stoop.vehicle import Vehicle
from stoop.workflow import identify
from stoop_studies.verify.jsbsim_truth.aircraft import FLEET, Stock
from stoop_studies.verify.jsbsim_truth.derivatives import derivatives
from stoop_studies.verify.jsbsim_truth.flight import DURATION, Recording, fly, machine, trimmed, written
from stoop_studies.verify.jsbsim_truth.vehicle import NOISE, vehicle_of

WORK: Final = "stoop_studies.verify.jsbsim_truth.case:work"
WINDOW: Final = f"0:{DURATION:g}"


@dataclass(frozen=True, eq=False)
class Case:
    """An aircraft of JSBSim, flown.

    Attributes
    ----------
    stock : Stock
    vehicle : Vehicle
        Known mass properties and geometry; aerodynamic parameters at zero.
    flown : Recording
        Without noise.
    truth : mapping
        Aerodynamic parameter -> value that JSBSim's own tables have.
    """

    stock: Stock
    vehicle: Vehicle
    flown: Recording
    truth: Mapping[str, float]

    def flight(self, seed: int, noise: float = 1.0) -> Flight:
        """Return the flight as noisy instruments record it; ``noise`` scales `NOISE`."""
        generator = np.random.default_rng([FLEET.index(self.stock), seed])  # no two aircraft share their luck
        columns = {
            channel: values + noise * NOISE.get(channel, 0.0) * generator.standard_normal(len(values))
            for channel, values in self.flown.columns.items()
        }
        return from_columns(self.stock.model, self.flown.time, columns, source="JSBSim")


@functools.cache
def case(model: str) -> Case:
    """Fly an aircraft of the fleet, and read its derivatives off.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its data have changed.
    """
    stock = next(s for s in FLEET if s.model == model)
    jsbsim = machine(stock)
    trim = trimmed(stock, jsbsim)
    jsbsim.put(trim.state, written(stock, trim.deflections))
    vehicle = vehicle_of(stock, jsbsim, trim)
    flown = fly(stock, jsbsim, trim)
    return Case(stock, vehicle, flown, derivatives(stock, jsbsim, trim, vehicle, flown))


def work(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Identify one aircraft from one noisy flight, as a user would.

    Parameters
    ----------
    arguments : mapping
        ``aircraft``: folder of JSBSim's data; ``seed``: of the noise.
    stops : sequence
        One None per result.
    """
    known, seed = case(str(arguments["aircraft"])), int(arguments["seed"])
    told = estimates(known, known.flight(seed))
    return [told for _ in stops]


def estimates(known: Case, flight: Flight) -> dict[str, dict[str, float]]:
    """Return truth, estimate and standard error of every aerodynamic parameter."""
    found = identify(known.vehicle, flight, [WINDOW]).identification.result.parameters
    return {
        "truth": dict(known.truth),
        "estimate": {name: found[name].estimate for name in known.truth},
        "sigma": {name: found[name].std_error for name in known.truth},
    }
