"""Degrees where radians belong: found in any channel, never seen where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.base.rotations import wrap
from stoop.errors import FlightError
from stoop.flight.channels import Channels
from stoop.flight.plausible import check_radians

DEG = 180.0 / np.pi


def maneuver(size: float = 0.3, noise: float = 0.0) -> dict[str, FloatArray]:
    """Make angles and the rates that belong to them, not at the same time scale."""
    time = np.arange(0.0, 10.0, 0.01)
    rng = np.random.default_rng(1)
    values = {}
    for angle, rate, pace in (("phi", "p", 2.0), ("theta", "q", 3.0), ("psi", "r", 1.0)):
        values[angle] = size * np.sin(pace * time)
        values[rate] = pace * size * np.cos(pace * time)
    values["alpha"] = 0.5 * values["theta"]
    values = {name: x + noise * size * rng.normal(size=x.size) for name, x in values.items()}
    return {**values, "elevator": size * np.sign(np.sin(time))}


def check(values: dict[str, FloatArray], mapping: str = "m.toml") -> None:
    time = 0.01 * np.arange(next(iter(values.values())).size)
    check_radians([Channels("f.csv", time, values)], "f.csv", mapping)


@given(st.floats(1e-3, 1.0), st.floats(0.0, 0.3))
@settings(deadline=None)
def test_radians_pass(size: float, noise: float) -> None:
    check(maneuver(size, noise))


@pytest.mark.parametrize("accused", ["phi", "theta", "p", "q"])
@pytest.mark.parametrize("size", [0.02, 0.3])
def test_one_channel_in_degrees_is_accused(accused: str, size: float) -> None:
    values = maneuver(size, noise=0.01)
    values[accused] = values[accused] * DEG
    with pytest.raises(
        FlightError, match=rf"f\.csv: .*'{accused}' (is in degrees|reaches).* in m\.toml"
    ) as caught:
        check(values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("accused", "words"), [("elevator", "degrees"), ("alpha", "degrees"), ("psi", "degrees")]
)
def test_sizes_beyond_any_angle(accused: str, words: str) -> None:
    values = maneuver(1.0)
    values[accused] = values[accused] * DEG
    with pytest.raises(FlightError, match=f"'{accused}' (reaches .*: {words}|is in degrees)"):
        check(values)


def test_all_in_degrees() -> None:
    with pytest.raises(FlightError, match="degrees where radians belong"):
        check({name: x * DEG for name, x in maneuver(0.3).items()})


def test_a_log_without_mapping_gets_other_advice() -> None:
    with pytest.raises(FlightError, match="convert it"):
        check({"theta": np.full(100, 12.0)}, mapping="")


def test_some_wild_samples_prove_nothing() -> None:
    values = maneuver(0.3)
    values["theta"][::500] = 1e9
    check(values)


def test_a_heading_counted_through_turns_is_no_heading_in_degrees() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    rate = 0.5 + 0.2 * np.sin(time)
    heading = np.cumsum(rate) * 0.01
    check({"psi": heading, "r": rate})
    check({"psi": wrap(heading), "r": rate})
    with pytest.raises(FlightError, match="'psi' reaches"):
        check({"psi": wrap(heading) * DEG, "r": rate})


def test_nothing_to_judge() -> None:
    check({"phi": np.full(50, np.nan), "p": np.full(50, np.nan)})
    check({"phi": np.zeros(50), "p": np.zeros(50)})
    check({"phi": np.zeros(1), "p": np.zeros(1)})
