"""Each decision of a fit applies where a defect was put into a simulated flight or the file, and is not needed elsewhere."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.base.notices import notice
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.flight.faults import Fault
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.strategy import DECISIONS, Strategy, fit
from stoop.strategy.run import setup_of
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.load import parse_vehicle

WINDOWS = Window("a", 0.0, 5.0), Window("b", 0.0, 5.0)
FREE = ("Cmalpha", "Cmq", "Cmelevator")
Flights = Mapping[str, Flight]
Case = tuple[Vehicle, Flights]


@cache
def whole() -> Vehicle:
    return freed(with_entries(builtin_vehicle("twin-boom"), {("controls", "elevator", "lag"): 0.0}))


@cache
def known() -> Vehicle:
    return whole().reduced("longitudinal")


def freed(vehicle: Vehicle) -> Vehicle:
    return vehicle.with_numbers({p.name: {"free": p.name in FREE} for p in vehicle.parameters if p.free})


def flown(vehicle: Vehicle, duration: float = 5.0, amplitude: float = 0.05) -> Mapping[str, Flight]:
    given = {"control": "elevator", "shape": "doublet", "start": 0.5, "step": 0.5, "amplitude": amplitude}
    whole = {"duration": duration, "rate": 50.0, "altitude": 200.0, "input": [given]}
    maneuver = Maneuver.model_validate(whole)
    return {name: simulate_flight(vehicle, maneuver, seed=i, name=name) for i, name in enumerate("ab")}


@cache
def flights(reduced: bool = True) -> Mapping[str, Flight]:
    return flown(known() if reduced else whole())


def changed(channel: str, change: Callable[[np.ndarray, int], np.ndarray], names: str = "ab") -> Flights:
    out = dict(flights())
    for k, name in enumerate(names):
        data, column = out[name].data, change(out[name].column(channel).copy(), k)
        out[name] = replace(out[name], data=data.assign({channel: ("time", column, data[channel].attrs)}))
    return out


def random(y: np.ndarray, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(len(y))


def spiked(y: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y[rng.choice(len(y), len(y) // 12, replace=False)] += 0.1 * rng.choice([-1.0, 1.0], len(y) // 12)
    return y


def faulty() -> Flights:
    fault = Fault("stuck", "q", 0.0, 1.0, 2.0, notice("samples-not-measured", variables=("q",)))
    return {**flights(), "a": replace(flights()["a"], faults=(fault,))}


def of_pitch(share: float) -> Vehicle:
    inertia = {"value": share * known().value("mass.inertia.yy"), "free": True}
    return known().with_numbers({**{n: {"free": False} for n in FREE}, "mass.inertia.yy": inertia})


def of_no_body(scale: float) -> Vehicle:
    """Return a vehicle whose elevator turns it more than the true one, its inertia free."""
    turn = {"value": scale * known().value("Cmelevator"), "free": False}
    return known().with_numbers({"Cmelevator": turn, "mass.inertia.yy": {"free": True}})


def with_prior(share: float) -> Vehicle:
    """Return a vehicle whose static stability has a prior of 10 % about a share of the truth."""
    truth = known().value("Cmalpha")
    prior = {"value": share * truth, "prior": 0.1 * abs(truth), "free": True}
    return known().with_numbers({"Cmalpha": prior})


def of_plain_thrust() -> Vehicle:
    text = known().text.replace("thrust = { value = 220.87, free = false }", "thrust = 220.87")
    assert text != known().text
    return freed(parse_vehicle(text, "plain")).reduced("longitudinal")


@cache
def unstable() -> Case:
    """Return a vehicle and flights in which errors grow by four powers of ten."""
    vehicle = known().with_numbers({"Cmalpha": {"value": 4.0}})
    return vehicle, flown(vehicle, 3.0, 1e-3)


OF_SEVERAL = ("maneuver-noise",)  #: decisions that compare flights; one is enough for the others
CASES: dict[str, Callable[[], Case]] = {
    "faults": lambda: (known(), faulty()),
    "bounds": lambda: (of_pitch(0.35), flights()),
    "assumptions": lambda: (of_plain_thrust(), flights()),
    "recorded-motion": lambda: (known(), flights(reduced=False)),
    "held-numbers": lambda: (of_no_body(8.0), flights()),
    "stuck-channels": lambda: (known(), changed("theta", lambda y, k: np.full_like(y, 0.05))),
    "noise-shape": lambda: (known(), changed("q", spiked)),
    "maneuver-noise": lambda: (known(), changed("q", lambda y, k: y + 0.02 * random(y, 1), "b")),
    "noise-color": lambda: (
        known(), changed("theta", lambda y, k: y + 0.003 * lfilter([1.0], [1.0, -0.95], random(y, k)))),
    "sensor-delays": lambda: (known(), changed("alpha", lambda y, k: np.r_[[y[0]] * 3, y[:-3]])),
    "extensions": lambda: (known().with_numbers({"CLelevator": {"value": 0.0, "free": False}}), flights()),
    "method": lambda: (builtin_vehicle("quad-x"), {}),
    "instability": unstable,
    "gusts": lambda: (  # of 1 m/s, which turn and lift nothing
        known(), changed("alpha", lambda y, k: y + 0.03 * lfilter([0.2], [1.0, -0.98], random(y, k)))),
}  #: decision -> a case in which it applies  # fmt: skip
NEVER: dict[str, Callable[[], Case]] = {
    "bounds": lambda: (of_pitch(0.8), flights()),
    "held-numbers": lambda: (of_no_body(1.0), flights()),
    "recorded-motion": lambda: (whole(), flights(reduced=False)),
}  #: cases near those in which they must not
CHOICES = ("method", "instability", "gusts", "extensions")  #: decisions before a fit, which is not made here


def state(name: str, case: Case) -> str:
    windows = WINDOWS if name in OF_SEVERAL else WINDOWS[:1]
    done = fit(Strategy.only(name), *case, windows, options=Options(seed=1, budget=4000.0))
    return {one.name: one.state for one in done.decisions}[name]


def test_every_decision_has_a_case() -> None:
    assert {*CASES} == {one.name for one in DECISIONS}


@pytest.mark.parametrize("name", [name for name in CASES if name not in CHOICES])
def test_a_decision_applies_where_the_data_call_for_it(name: str) -> None:
    assert state(name, CASES[name]()) == "applied"
    if name in NEVER:
        assert state(name, NEVER[name]()) == "not needed"


@pytest.mark.parametrize("name", CHOICES)
def test_method_or_model_change_before_a_fit_where_the_data_call_for_it(name: str, monkeypatch: Any) -> None:
    monkeypatch.setattr("stoop.strategy.extensions.MAX_ROUNDS", 1)
    monkeypatch.setattr("stoop.strategy.extensions.MAX_RIVALS", 0)
    (decision,) = (one for one in DECISIONS if one.name == name)
    assert decision.problem is not None
    for vehicle, logs in (CASES[name](), (known(), flights())):
        windows = [Window(n, 0.0, float(one.time[-1])) for n, one in logs.items()]
        setup = setup_of(Strategy.only(name), vehicle, logs, windows[: 1 + (name in CHOICES[:3])])
        change = decision.problem(setup)
        assert (change is None) == (logs is flights() and vehicle is known())
        if change is not None and name == "extensions":
            assert change.done == "CLalphaelevator added"
        elif change is not None:
            assert change.setup.options.method != setup.options.method


def test_no_decision_applies_to_a_right_vehicle_and_clean_flights() -> None:
    every = Strategy(frozenset(CASES))
    done = fit(every, with_prior(1.0), flights(), WINDOWS, options=Options(seed=1, budget=4000.0))
    assert {one.name: one.state for one in done.decisions} == dict.fromkeys(CASES, "not needed")
