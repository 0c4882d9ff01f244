"""Channels that contradict each other: the wrong line is told, a right mapping is not accused."""

import numpy as np
import pytest
from draft.checks.test_clean_flights import OWN
from helpers.made_logs import body_rates

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop_draft.checks.engine import search
from stoop_draft.checks.kinematics import check_rates
from stoop_draft.checks.mapping import Model, check_mapping

RATE, GRAVITY = 100.0, 9.80665
TIME = np.arange(3000) / RATE
NOISE = {"p": 0.01, "phi": 0.01, "ax": 0.1, "vn": 0.1, "pn": 0.05, "altitude": 0.2}  #: and those like them
GROUPS = (RATES, EULER, SPECIFIC_FORCE, VELOCITY, POSITION, ("altitude",))


def doublet(start: float, size: float) -> FloatArray:
    """Return one smooth swing to either side within 3 s; nothing else moves."""
    x = np.clip((TIME - start) / 3.0, 0.0, 1.0)
    return np.asarray(size * np.sin(2.0 * np.pi * x) * np.sin(np.pi * x))


def flown(seed: int, much: float = 1.0) -> dict[str, FloatArray]:
    """Return short doublets about and along every axis by calculus, with noise: velocity and attitude are chosen."""
    rng = np.random.default_rng(seed)
    angles = np.column_stack([doublet(2.0, 0.4), doublet(6.0, 0.4), doublet(14.0, 0.8)]) * much
    speed = np.column_stack([doublet(14.0, 4.0), doublet(18.0, 4.0), doublet(22.0, 3.0)]) * much
    place = np.cumsum(speed, axis=0) / RATE
    rates = np.column_stack(body_rates(*angles.T[:2], *np.gradient(angles, TIME, axis=0).T))
    force = to_body(quaternions_of(angles), np.gradient(speed, TIME, axis=0) - [0.0, 0.0, GRAVITY])
    columns = (rates, angles, force, speed, place, 100.0 - place[:, 2:])
    noisy = {
        name: x + NOISE[group[0]] * rng.standard_normal(TIME.size)
        for group, values in zip(GROUPS, columns, strict=True)
        for name, x in zip(group, values.T, strict=True)
    }
    return with_quaternion(noisy)


def with_quaternion(data: dict[str, FloatArray]) -> dict[str, FloatArray]:
    angles = np.column_stack([data[name] for name in GROUPS[1]])
    return {**data, **dict(zip(QUATERNION, quaternions_of(angles).T, strict=True))}


def told(data: dict[str, FloatArray]) -> list[list[tuple[str, ...]]]:
    model = Model({name: (TIME[: x.size], x) for name, x in data.items()}, data, RATE)
    found, _ = search({}, lambda state: model.edits(state, OWN), model)
    return [list(one.lines) for one in found]


@pytest.mark.parametrize("much", [0.0, 0.05, 0.3, 1.0])
def test_a_right_mapping_is_not_accused(much: float) -> None:
    for seed in range(2):
        assert told(flown(seed, much)) == []
    data = flown(5, much)
    data["vn"] = np.where((TIME > 15.0) & (TIME < 16.0), np.nan, data["vn"])
    assert told(data) == []
    assert told({name: x[:5] for name, x in data.items()}) == []
    assert told({name: np.full_like(x, np.nan) for name, x in data.items()}) == []


@pytest.mark.parametrize("name", [*RATES, *EULER, "ax", "ay", "vn", "vd", "pe", "pd", "altitude"])
def test_a_lost_sign_is_told_of_its_own_line(name: str) -> None:
    data = flown(0)
    assert told(with_quaternion({**data, name: -data[name]})) == [[(name,)]]


@pytest.mark.parametrize("case", ["vn ve", "pn pe", "two", "undecided", "noise"])
def test_wrong_lines_are_told(case: str) -> None:
    data = flown(1)
    if case == "two":
        found = told(with_quaternion({**data, "phi": -data["phi"], "vd": -data["vd"]}))
        assert sorted(found) == [[("phi",)], [("vd",)]]
    elif case == "undecided":  # no third channel
        assert sorted(told({"pd": data["pd"], "vd": -data["vd"]})[0]) == [("pd",), ("vd",)]
    elif case == "noise":  # a unit that only shrinks noise is no rival
        data = flown(100, 0.2)
        assert told({**data, "pn": -data["pn"]}) in ([], [[("pn",)]])
    else:
        one, two = case.split()
        assert told({**data, one: data[two], two: data[one]}) == [[(one, two)]]


@pytest.mark.parametrize("unit", ["km/h", "kt", "ft/s", "cm/s"])
def test_a_unit_of_the_velocity(unit: str) -> None:
    data = flown(2)
    changed = {**data, **{name: data[name] / FACTORS[unit] for name in VELOCITY}}
    judged = check_mapping({name: (TIME, x) for name, x in changed.items()}, changed, RATE, OWN)
    (one,) = judged.notices
    assert (one.code, one.values["fix"]) == ("mapping-unit", f'write unit = "{unit}"')
    np.testing.assert_allclose(judged.corrected(changed)["vn"], data["vn"], atol=1e-12)


def record(size: float, seed: int, swap: bool = False) -> dict[str, FloatArray]:
    """Return a vehicle that rolls back and forth, its attitude noisy; nothing else turns."""
    rng = np.random.default_rng(seed)
    angles = np.zeros((TIME.size, 3))
    angles[:, 0] = size * np.sin(2.0 * TIME)
    rates = np.zeros((TIME.size, 3))
    rates[:, 1 if swap else 0] = 2.0 * size * np.cos(2.0 * TIME)
    e = quaternions_of(angles + 0.01 * rng.standard_normal(angles.shape))  # what the built-in vehicles have
    rates += 0.01 * rng.standard_normal(rates.shape)
    return dict(zip(QUATERNION, e.T, strict=True)) | dict(zip("pqr", rates.T, strict=True))


def found(data: dict[str, FloatArray]) -> list[Notice]:
    judged = check_mapping({}, data, RATE, {})
    return [*judged.notices, *check_rates(judged.corrected(data), RATE, {})]


@pytest.mark.parametrize("size", [0.0, 0.005, 0.02, 0.05, 0.3])
def test_noise_accuses_nobody(size: float) -> None:
    """Also where the grid's filter smoothed it: neighbors scatter less then; correlations of 0.8 were false alarms."""
    for seed in range(2):
        data = record(size, seed)
        assert found(data) == []
        smooth = {name: np.convolve(x, [0.25, 0.5, 0.25], mode="same")[2:-2] for name, x in data.items()}
        assert found(smooth) == []


def test_exchanged_axes_and_a_wrong_scale_are_seen_through_noise() -> None:
    (notice,) = found(record(0.3, 0, swap=True))
    assert (notice.code, notice.values["lines"]) == ("mapping-exchange", ("p", "q"))
    data = record(0.3, 0)
    (notice,) = found(data | {"p": 0.5 * data["p"]})
    assert (notice.code, notice.subject) == ("rate-scale", "p")
    assert notice.values["gain"] == pytest.approx(2.0, rel=0.05)
