"""Degrees where radians belong: found in any channel, never seen where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.rotations import wrap
from stoop.checks.entries import Line, Lines
from stoop.checks.mapping import check_mapping

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


def check(values: dict[str, FloatArray], lines: Lines | None = None) -> list[Notice]:
    time = 0.01 * np.arange(next(iter(values.values())).size)
    signals = {name: (time, x) for name, x in values.items()}
    return list(check_mapping(signals, {}, 100.0, lines or {}).refused)


def accused(found: list[Notice]) -> list[tuple[str, ...]]:
    return [one.values["lines"] for one in found]


@given(st.floats(1e-3, 1.0), st.floats(0.0, 0.3))
@settings(deadline=None)
def test_radians_pass(size: float, noise: float) -> None:
    assert check(maneuver(size, noise)) == []


@pytest.mark.parametrize("name", ["phi", "theta", "p", "q"])
@pytest.mark.parametrize("size", [0.02, 0.3])
def test_one_channel_in_degrees_is_accused(name: str, size: float) -> None:
    values = maneuver(size, noise=0.01)
    values[name] = values[name] * DEG
    (found,) = check(values, {name: Line("m.toml", f"variables.{name}", "rad")})
    assert found.values["lines"] == (name,)
    unit = "deg/s" if name in "pq" else "deg"
    assert found.values["suggestion"] == f'write unit = "{unit}" for variables.{name} in m.toml'


@pytest.mark.parametrize("name", ["elevator", "alpha", "psi"])
def test_sizes_beyond_any_angle(name: str) -> None:
    values = maneuver(1.0)
    values[name] = values[name] * DEG
    assert accused(check(values)) == [(name,)]


def test_all_in_degrees() -> None:
    found = accused(check({name: x * DEG for name, x in maneuver(0.3).items()}))
    assert {name for names in found for name in names} == {*maneuver()}


def test_all_angles_of_one_sensor_in_degrees_are_one_finding() -> None:
    values = maneuver(0.02)
    values.update({name: values[name] * DEG for name in ("phi", "theta", "psi")})
    assert accused(check(values)) == [("phi", "theta", "psi")]


def test_a_log_without_mapping_gets_other_advice() -> None:
    (found,) = check({"theta": np.full(100, 12.0)})
    assert found.values["suggestion"] == 'write unit = "deg" for theta in a mapping (see stoop map)'


def test_siblings_in_the_mapping_show_which_of_two_units_is_wrong() -> None:
    """The attitude is 57 times too fast for rates that are said to be in deg/s, as only p is of its sensor."""
    values = maneuver(0.02)
    values["p"] = values["p"] / DEG
    units = {"phi": "rad", "theta": "rad", "psi": "rad", "p": "deg/s", "q": "rad/s", "r": "rad/s"}
    (found,) = check(values, {name: Line("m.toml", name, unit) for name, unit in units.items()})
    assert found.values["suggestion"] == 'write unit = "rad/s" for p in m.toml'


def test_some_wild_samples_prove_nothing() -> None:
    values = maneuver(0.3)
    values["theta"][::500] = 1e9
    assert check(values) == []


def test_a_heading_counted_through_turns_is_no_heading_in_degrees() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    rate = 0.5 + 0.2 * np.sin(time)
    heading = np.cumsum(rate) * 0.01
    assert check({"psi": heading, "r": rate}) == []
    assert check({"psi": wrap(heading), "r": rate}) == []
    assert accused(check({"psi": wrap(heading) * DEG, "r": rate})) == [("psi",)]


def test_nothing_to_judge() -> None:
    for x in (np.full(50, np.nan), np.zeros(50), np.zeros(1)):
        assert check({"phi": x, "p": x}) == []
