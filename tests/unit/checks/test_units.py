"""A wrong unit or sign of a mapping is reported, with the line to change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.base.notices import Notice
from stoop.checks.entries import Line, Lines
from stoop.checks.mapping import check_mapping
from stoop.checks.units import Sizes, without_jumps
from stoop.errors import FlightError
from stoop.flight import Flight, load

T = 0.01 * np.arange(3000)
DEG = 180.0 / np.pi
VARIABLES = {
    "phi": "rad", "theta": "rad", "psi": "rad", "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2", "ay": "m/s2",
    "az": "m/s2", "voltage": "V",
}  # fmt: skip


def motion() -> dict[str, np.ndarray]:
    """A vehicle that turns about all axes, in level flight."""
    phi, theta, psi = 0.4 * np.sin(1.7 * T), 0.3 * np.sin(2.3 * T), 0.5 * np.sin(1.1 * T)
    dphi, dtheta, dpsi = (np.gradient(x, T) for x in (phi, theta, psi))
    return {
        "phi": phi, "theta": theta, "psi": psi,
        "p": dphi - dpsi * np.sin(theta),
        "q": dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta),
        "r": -dtheta * np.sin(phi) + dpsi * np.cos(phi) * np.cos(theta),
        "ax": 9.8 * np.sin(theta), "ay": -9.8 * np.sin(phi), "az": -9.8 * np.cos(phi), "voltage": 12.0 + 0 * T,
    }  # fmt: skip


def flight(folder: Path, **changed: np.ndarray) -> Flight:
    columns = {**motion(), **changed}
    rows, head = np.column_stack([T, *columns.values()]), ",".join(("t", *columns))
    np.savetxt(folder / "f.csv", rows, delimiter=",", header=head, comments="")
    lines = [f'{name} = {{column = "{name}", unit = "{unit}"}}' for name, unit in VARIABLES.items()]
    (folder / "f.csv.toml").write_text('[time]\ncolumn = "t"\nunit = "s"\n[variables]\n' + "\n".join(lines))
    return load(folder / "f.csv")


def test_a_right_mapping_is_not_accused(tmp_path: Path) -> None:
    assert flight(tmp_path).faults == ()


@pytest.mark.parametrize(
    ("name", "factor", "fix"),
    [
        ("p", -1.0, "write scale = -1 for variables.p in"),
        ("az", -1.0, "write scale = -1 for variables.az in"),
        ("voltage", 1e3, 'write unit = "mV" for variables.voltage in'),
    ],
)
def test_a_sign_and_a_unit(tmp_path: Path, name: str, factor: float, fix: str) -> None:
    (fault,) = flight(tmp_path, **{name: factor * motion()[name]}).faults
    assert fault.variable == name
    assert fix in fault.message
    assert fault.message.endswith("f.csv.toml")


def test_gravity_tells_the_unit_of_the_specific_force(tmp_path: Path) -> None:
    force = {name: motion()[name] / 9.8 for name in ("ax", "ay", "az")}
    (fault,) = flight(tmp_path, **force).faults
    assert fault.kind == "wrong unit"
    assert fault.message.endswith(
        f'write unit = "g" for variables.ax, variables.ay and variables.az in {tmp_path / "f.csv.toml"}'
    )


def test_swapped_axes(tmp_path: Path) -> None:
    m = motion()
    (fault,) = flight(tmp_path, p=m["q"], q=m["p"]).faults
    assert "p and q are exchanged" in fault.message
    whole = 'p = {column = "q", unit = "rad/s"} and q = {column = "p", unit = "rad/s"} under [variables] in'
    assert f"write {whole}" in fault.message


@pytest.mark.parametrize(("name", "unit"), [("p", "deg/s"), ("phi", "deg")])
def test_degrees_name_the_key(tmp_path: Path, name: str, unit: str) -> None:
    with pytest.raises(FlightError, match=rf'write unit = "{unit}" for variables\.{name} in .*f\.csv\.toml'):
        flight(tmp_path, **{name: np.degrees(motion()[name])})


def noticed(lines: Lines | None = None, **columns: np.ndarray | float) -> list[Notice]:
    signals = {name: (T, np.broadcast_to(np.asarray(x, float), T.shape)) for name, x in columns.items()}
    return list(check_mapping(signals, {}, 100.0, lines or {}).notices)


def test_units_that_explain_a_size() -> None:
    columns = {
        "pressure": 1013.0,
        "temperature": 15.0,
        "rotor_1": 9000.0,
        "pwm_1": 1.5e-3,
        "motor_1": 55.0,
        "density": 3.0,
    }
    line = Line("m.toml", "variables.motor_1")
    found = {one.subject: one for one in noticed({"motor_1": line}, **columns)}
    meant = {"pressure": "hPa", "temperature": "degC", "rotor_1": "rpm", "pwm_1": "s", "motor_1": "percent"}
    assert {name: one.values["fix"] for name, one in found.items() if name != "density"} == {
        name: f'write unit = "{unit}"' for name, unit in meant.items()
    }
    assert found["density"].code == "size-unexplained"
    assert found["motor_1"].values["suggestion"].endswith("for variables.motor_1 in m.toml")


def noisy(folder: Path, units: str, **factors: float) -> list[str]:
    """Return what is told of a flight whose accelerometers are noisy and whose mapping says these units of them."""
    rng = np.random.default_rng(0)
    columns = motion()
    for name in ("ax", "ay", "az"):
        columns[name] = factors.get(name, 1.0) * (columns[name] + rng.normal(0.0, 0.1, T.size))
    flight(folder, **columns)
    file = folder / "f.csv.toml"
    text = file.read_text()
    for name, unit in zip(("ax", "ay", "az"), units.split(), strict=True):
        text = text.replace(f'"{name}", unit = "m/s2"', f'"{name}", unit = "{unit}"')
    file.write_text(text)
    return [
        f.message.replace(str(file), "M") for f in load(folder / "f.csv").faults if f.kind == "wrong unit"
    ]


@pytest.mark.parametrize(
    ("units", "factors", "fix"),
    [
        ("m/s2 m/s2 g", {}, 'write unit = "m/s2" for variables.az in M'),
        ("g g g", {}, 'write unit = "m/s2" for variables.ax, variables.ay and variables.az in M'),
        ("m/s2 m/s2 m/s2", {"az": 1 / 9.80665}, 'write unit = "g" for variables.az in M'),
        ("g m/s2 m/s2", {}, 'write unit = "m/s2" for variables.ax in M'),
        (
            "g m/s2 g",
            {"ax": 1 / 9.80665, "ay": 1 / 9.80665, "az": 1 / 9.80665},
            'unit = "g" for variables.ay in M',
        ),
    ],
)
def test_g_and_metres_per_second_squared_are_told_apart(
    tmp_path: Path, units: str, factors: dict[str, float], fix: str
) -> None:
    (told,) = noisy(tmp_path, units, **factors)
    assert told.endswith(fix)


def test_axes_in_units_of_their_own_are_right(tmp_path: Path) -> None:
    assert noisy(tmp_path, "g m/s2 g", ax=1 / 9.80665, az=1 / 9.80665) == []


def test_motors_in_percent_or_microseconds() -> None:
    (found,) = noticed(motor_1=67.0)
    assert (found.code, found.values["size"], found.values["unit"]) == ("unit-size", 67.0, "")
    (found,) = noticed(motor_2=1670.0)
    assert found.code == "command-in-pulses"
    assert "scale = 0.001 and offset = -1" in found.values["fix"]
    assert "or call it pwm_2" in found.values["fix"]


def test_a_vertical_force_that_points_up_is_a_wrong_sign() -> None:
    assert noticed(az=-9.8) == []
    (found,) = noticed(az=10.3)
    assert (found.code, found.values["fix"]) == ("force-points-up", "write scale = -1")


def test_a_heading_near_north_is_no_degree() -> None:
    """It jumps by a whole turn wherever it passes north, whichever way it turns."""
    rng = np.random.default_rng(0)
    values = motion()
    r = 0.02 * np.sin(9.0 * T)
    heading = np.cumsum(r) * 0.01 + 2e-4 * rng.standard_normal(T.size)
    values |= {"r": r, "psi": np.mod(heading, 2.0 * np.pi)}
    sizes = Sizes({name: (T, x) for name, x in values.items()})
    assert sizes.growth({}, "psi", "r") == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", DEG), ("deg/s", 1.0 / DEG)])
def test_a_rate_that_was_converted_twice_is_multiplied_back(unit: str, factor: float) -> None:
    values = {name: x for name, x in motion().items() if name != "voltage"}
    values["q"] = values["q"] / factor
    lines = {name: Line("m.toml", f"variables.{name}", VARIABLES[name]) for name in values}
    lines["q"] = Line("m.toml", "variables.q", unit, {"column": "q", "unit": unit})
    found = check_mapping({name: (T, x) for name, x in values.items()}, values, 100.0, lines)
    (one,) = (*found.refused, *found.notices)
    assert one.values["changes"] == (f"variables.q.scale = {factor:.12g}",)


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi, np.pi / 180.0], ids=["rad", "deg as rad", "rad as deg"])
def test_turns_of_any_size_are_counted_on(unit: float) -> None:
    """As mapped, in degrees where radians belong, and converted from degrees that they were not in."""
    heading = np.linspace(0.0, 20.0, 500)
    recorded = unit * np.mod(heading, 2.0 * np.pi)
    np.testing.assert_allclose(without_jumps("psi", recorded), unit * heading, rtol=0.0, atol=1e-9)
