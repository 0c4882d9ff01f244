"""Figures of a flight: errors that hold, priors taken off, and reasons where a flight cannot tell."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.fleet import log_figures
from stoop.fleet.log_figures import GROUPS, FlightFigure, figures_of
from stoop.flight import Flight, from_columns
from stoop.vehicle.builtin import builtin_vehicle

RATE, SECONDS, RESISTANCE = 20.0, 240.0, 0.05


def drawn(rng: np.random.Generator) -> Flight:
    """Return a flight of a battery that is emptied, its readings correlated over seconds."""
    time = np.arange(0.0, SECONDS, 1.0 / RATE)

    def colored(pole: float) -> FloatArray:
        return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(time.size)) * np.sqrt(1 - pole**2))

    current = 15.0 + 3.0 * colored(np.exp(-1.0 / (RATE * 2.0)))
    voltage = (
        16.8
        - 0.006 * time
        - 2e-6 * time**2
        - RESISTANCE * current
        + 0.05 * colored(np.exp(-1.0 / (RATE * 3.0)))
    )
    return from_columns("f", time, {"voltage": voltage, "current": current})


def resistance(flight: Flight) -> FlightFigure:
    (one,) = GROUPS["battery"].evaluate(flight, None)
    return one


def test_the_resistance_of_a_battery_with_an_error_that_holds() -> None:
    rng = np.random.default_rng(0)
    found = [resistance(drawn(rng)) for _ in range(100)]
    ratios = np.array([(one.value - RESISTANCE) / one.std_error for one in found])
    assert found[0].part == "battery"
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(1.0, abs=0.35)
    assert np.mean(np.abs(ratios) < 1.96) > 0.85


def test_what_a_flight_cannot_tell_is_absent_with_the_reason() -> None:
    flight = drawn(np.random.default_rng(1))
    found, absent = figures_of(flight, builtin_vehicle("quad-x"))
    assert [one.name for one in found] == ["battery.resistance"]
    assert set(absent) == {"instruments", "rotors"}
    still = from_columns(
        "f", flight.time, {"voltage": flight.column("voltage"), "current": np.ones(flight.time.size)}
    )
    assert figures_of(still)[1]["battery"] == "the current hardly changed"
    short = from_columns(
        "f", flight.time[:100], {name: flight.column(name)[:100] for name in ("voltage", "current")}
    )
    assert "of more than 30 s are needed" in figures_of(short)[1]["battery"]
    assert figures_of(flight)[1]["rotors"] == "no vehicle with rotors was given"


def test_the_prior_of_an_instrument_error_is_taken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the reading, 0.02 with an error of 0.03, had stood alone; what no reading told has no figure."""
    precisions = 0.03**-2.0, 0.04**-2.0
    mean = 1.0 * precisions[1] + 1.02 * precisions[0]
    found = {
        "V.scale": SimpleNamespace(
            estimate=mean / sum(precisions), std_error=sum(precisions) ** -0.5, prior_mean=1.0, prior_std=0.04,
            identifiable=True, unit="1",
        ),
        "p.bias": SimpleNamespace(
            estimate=0.0, std_error=0.03, prior_mean=0.0, prior_std=0.03, identifiable=True, unit="rad/s"
        ),
    }  # fmt: skip
    monkeypatch.setattr(log_figures, "check", lambda flight: (SimpleNamespace(findings=found), None))
    (one,) = GROUPS["instruments"].evaluate(drawn(np.random.default_rng(0)), None)
    assert (one.name, one.part) == ("V.scale", "pitot")
    assert one.value == pytest.approx(1.02)
    assert one.std_error == pytest.approx(0.03)
