"""Delays of sensors that nobody modelled are freed; nothing else is, and a file that gives a delay decides."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.identification import Search, search
from stoop_studies.verify import scenes

SEED = 3


def flown(names: tuple[str, ...], late: tuple[str, ...]) -> list[Flight]:
    """Return flights of maneuvers of the twin-boom aircraft with sensor noise, some channels recorded late."""
    truth, out = scenes.aircraft(), []
    for seed, name in enumerate(names):
        flight = scenes.simulate_flight(
            truth, scenes.maneuvers()[name], noise=True, seed=SEED + seed, name=name
        )
        readings = {c: (flight.data[c].dims, scenes.recorded_late(flight.data[c].to_numpy())) for c in late}
        out.append(replace(flight, data=flight.data.assign(readings)))
    return out


def searched(flights: list[Flight], vehicle: Vehicle | None = None) -> Search:
    windows = [f"{one.name}@0:{scenes.DURATION}" for one in flights]
    return search(
        vehicle or scenes.aircraft(), flights, windows, options=Options(seed=1, method="output-error")
    )


def freed(done: Search) -> list[str]:
    return [one.subject for one in done.fit.notices if one.code == "sensor-delay-freed"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "name", "number"),
    [
        (("beta",), "sensors.beta.delay", "sensors.beta.delay"),
        (("phi", "theta", "psi"), "sensors.attitude.delay", "sensors.phi.delay"),
    ],
)
def test_a_late_sensor_is_found(late: tuple[str, ...], name: str, number: str) -> None:
    flights = flown(("roll",), late)
    done = searched(flights)
    assert freed(done) == [name]
    index = [p.name for p in done.fit.problem.layout.parameters].index(number)
    assert abs(done.fit.estimates[number] - scenes.LATE) < 3.0 * done.decided.tested.bars.std[index]
    assert done.decided.tested.bars.std[index] < 0.005
    # a file that gives the delay decides for itself
    given = with_entries(scenes.aircraft(), {("sensors", one, "delay"): 0.0 for one in late})
    assert freed(searched(flights, given)) == []


def test_what_is_in_time_stays_as_it_is() -> None:
    flights = flown(("roll",), ())
    done = searched(flights)
    assert freed(done) == []
    assert not any(name.endswith(".delay") for name in done.fit.estimates)
