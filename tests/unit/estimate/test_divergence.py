"""A simulation that diverges while an estimator searches is a value: the fit ends with a status, or with advice."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from unit.estimate.fits import fit_by
from unit.flown import maneuver, with_few_free

from stoop.errors import StoopError
from stoop.estimate import methods, shooting_windows
from stoop.estimate.estimate import Estimate
from stoop.flight import Flight
from stoop.kernels import filtering
from stoop.kernels.kernel import Kernel
from stoop.problem.windows import Window
from stoop.simulation import trajectories
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

FREE = ("Cmalpha", "Cmq", "Cmelevator")
MANEUVER = maneuver(4.0, ("elevator", "3-2-1-1", 0.5, 0.3, 0.05))
STATUSES = {"converged", "stalled", "budget", "generations", "interrupted", "target"}
#: entry points of the compiled model, through which every trajectory of an estimator comes
ENTRIES = (
    (Kernel, "cost"), (Kernel, "trajectories"), (Kernel, "evaluate"), (filtering, "innovations"), (filtering, "step"),
    (shooting_windows, "windows"), (trajectories, "innovations"), (trajectories, "step"),
)  # fmt: skip


@pytest.fixture(scope="module")
def problem() -> tuple[Vehicle, Flight]:
    vehicle = with_few_free(resolve_vehicle("twin-boom").reduced("longitudinal"), FREE)
    return vehicle, simulate_flight(vehicle, MANEUVER, seed=1, name="a")


def lost(found: Any) -> Any:
    """Return arrays of the same shapes without a finite number."""
    return tuple(map(lost, found)) if isinstance(found, tuple) else np.full_like(found, np.nan)


class Diverging:
    """Counts the calls of the compiled model, and makes some of them diverge."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, chosen: Callable[[int], bool]) -> None:
        self.calls = 0
        for owner, name in ENTRIES:
            monkeypatch.setattr(owner, name, self.wrapped(getattr(owner, name), chosen))

    def wrapped(self, entry: Callable[..., Any], chosen: Callable[[int], bool]) -> Callable[..., Any]:
        def run(*arguments: Any, **keywords: Any) -> Any:
            found = entry(*arguments, **keywords)
            self.calls += 1
            return lost(found) if chosen(self.calls - 1) else found

        return run


def fitted(method: str, vehicle: Vehicle, flight: Flight) -> Estimate:
    return fit_by(method, vehicle, {"a": flight}, [Window("a", 0.0, 4.0)], generations=6, budget=400.0)


def ends_as_a_value(method: str, vehicle: Vehicle, flight: Flight) -> None:
    """Check that a fit ends with an estimate that has a status, or with one line of advice."""
    try:
        found = fitted(method, vehicle, flight)
    except StoopError as error:
        assert "; " in str(error)  # noqa: PT017 - what is wrong, and what to do
    else:
        assert found.outcome.status in STATUSES
        assert np.isfinite(found.z).all()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("method", methods.names())
def test_a_divergence_ends_no_fit_by_another_exception(method: str, problem: tuple[Vehicle, Flight]) -> None:
    """Of one trajectory, or of all from then on; at last of the starting values."""
    with pytest.MonkeyPatch.context() as clean:
        count = Diverging(clean, lambda call: False)
        fitted(method, *problem)
    places = {0, 1, count.calls // 3, count.calls // 2, count.calls - 2, count.calls - 1}
    for place, lasting in itertools.product(sorted(places), (False, True)):
        with pytest.MonkeyPatch.context() as patch:
            Diverging(patch, lambda call, at=place, on=lasting: call >= at if on else call == at)  # type: ignore[misc]
            ends_as_a_value(method, *problem)
    vehicle, flight = problem
    far = {"value": 60.0, "bounds": (-10.0, 80.0)}
    ends_as_a_value(method, vehicle.with_numbers({"Cmalpha": far}), flight)
