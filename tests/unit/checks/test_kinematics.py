"""Channels that contradict each other: the wrong line is told, a right mapping is not accused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import FACTORS
from stoop.base.variables import QUATERNION
from stoop.checks.engine import search
from stoop.checks.entries import Line
from stoop.checks.mapping import Model, check_mapping
from stoop.flight import VARIABLES, load

RATE, GRAVITY = 100.0, 9.80665
TIME = np.arange(3000) / RATE
NOISE = {"p": 0.01, "phi": 0.01, "ax": 0.1, "vn": 0.1, "pn": 0.05, "altitude": 0.2}  #: and those like them
GROUPS = (
    "pqr",
    ("phi", "theta", "psi"),
    ("ax", "ay", "az"),
    ("vn", "ve", "vd"),
    ("pn", "pe", "pd"),
    ("altitude",),
)


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
    phi, theta, _ = angles.T
    dphi, dtheta, dpsi = np.gradient(angles, TIME, axis=0).T
    rates = np.column_stack([
        dphi - dpsi * np.sin(theta),
        dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta),
        dpsi * np.cos(phi) * np.cos(theta) - dtheta * np.sin(phi),
    ])  # fmt: skip
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


OWN = {name: Line("M.toml", f"variables.{name}", VARIABLES[name].unit) for name in VARIABLES}


def told(data: dict[str, FloatArray]) -> list[list[tuple[str, ...]]]:
    """Return the lines of each finding; several where no channel decides."""
    model = Model({name: (TIME[: x.size], x) for name, x in data.items()}, data, RATE)
    found, _ = search({}, lambda state: model.edits(state, OWN), model)
    return [list(one.lines) for one in found]


@pytest.mark.parametrize("much", [0.0, 0.05, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_right_mapping_is_not_accused(seed: int, much: float) -> None:
    assert told(flown(seed, much)) == []


@pytest.mark.parametrize(
    "name", ["p", "q", "r", "phi", "theta", "psi", "ax", "ay", "vn", "ve", "vd", "pn", "pe", "pd", "altitude"]
)
def test_a_lost_sign_is_told_of_its_own_line(name: str) -> None:
    data = flown(0)
    assert told(with_quaternion({**data, name: -data[name]})) == [[(name,)]]


def test_a_unit_that_only_shrinks_noise_is_no_rival() -> None:
    data = flown(100, 0.2)
    assert told({**data, "pn": -data["pn"]}) in ([], [[("pn",)]])


@pytest.mark.parametrize(("one", "two"), [("vn", "ve"), ("pn", "pe")])
def test_exchanged_columns(one: str, two: str) -> None:
    data = flown(1)
    assert told({**data, one: data[two], two: data[one]}) == [[(one, two)]]


@pytest.mark.parametrize("unit", ["km/h", "kt", "ft/s", "cm/s"])
def test_a_unit_of_the_velocity(unit: str) -> None:
    data = flown(2)
    names = ("vn", "ve", "vd")
    changed = {**data, **{name: data[name] / FACTORS[unit] for name in names}}
    judged = check_mapping({name: (TIME, x) for name, x in changed.items()}, changed, RATE, OWN)
    assert [(one.code, one.values["fix"]) for one in judged.notices] == [
        ("mapping-unit", f'write unit = "{unit}"')
    ]
    np.testing.assert_allclose(judged.corrected(changed)["vn"], data["vn"], atol=1e-12)


def test_what_no_third_channel_decides_is_told_of_both() -> None:
    data = {name: x for name, x in flown(3).items() if name in ("pd", "vd")}
    assert sorted(told({**data, "vd": -data["vd"]})[0]) == [("pd",), ("vd",)]


def test_two_wrong_lines_are_two_faults() -> None:
    data = flown(4)
    found = told(with_quaternion({**data, "phi": -data["phi"], "vd": -data["vd"]}))
    assert sorted(found) == [[("phi",)], [("vd",)]]


def test_gaps_and_short_logs_do_no_harm() -> None:
    data = flown(5)
    data["vn"] = np.where((TIME > 15.0) & (TIME < 16.0), np.nan, data["vn"])
    assert told(data) == []
    assert told({name: x[:5] for name, x in data.items()}) == []
    assert told({name: np.full_like(x, np.nan) for name, x in data.items()}) == []


def test_the_line_is_named(tmp_path: Path) -> None:
    data = {name: x for name, x in flown(6).items() if name not in QUATERNION}
    data["vd"] = -data["vd"]
    np.savetxt(
        tmp_path / "f.csv",
        np.column_stack([TIME, *data.values()]),
        delimiter=",",
        header=",".join(("t", *data)),
        comments="",
    )
    lines = "".join(f'{name} = {{column = "{name}", unit = "{VARIABLES[name].unit}"}}\n' for name in data)
    (tmp_path / "f.csv.toml").write_text(f'[time]\ncolumn = "t"\nunit = "s"\n[variables]\n{lines}')
    (fault,) = load(tmp_path / "f.csv").faults
    assert (fault.kind, fault.variable) == ("inconsistent", "vd")
    assert "write scale = -1 for variables.vd in" in fault.message
    assert fault.message.endswith("f.csv.toml")
