"""A wrong mapping is told in words, with the line to change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.errors import FlightError
from stoop.flight import Flight, load
from stoop.flight.advice import unit_faults
from stoop.flight.channels import Channels

T = 0.01 * np.arange(3000)
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
    ("name", "factor", "words"),
    [
        ("p", -1.0, ["sign", "write scale = -1 for variables.p in", "f.csv.toml"]),
        ("az", -1.0, ["level flight reads about -9.8", "variables.az in", "f.csv.toml"]),
        ("voltage", 1e3, ['looks like mV: write unit = "mV" for variables.voltage in', "f.csv.toml"]),
    ],
)
def test_a_sign_and_a_unit(tmp_path: Path, name: str, factor: float, words: list[str]) -> None:
    found = [fault.message for fault in flight(tmp_path, **{name: factor * motion()[name]}).faults]
    (message,) = (m for m in found if name in m)
    assert all(word in message for word in words), message


def test_gravity_tells_the_unit_of_the_specific_force(tmp_path: Path) -> None:
    force = {name: motion()[name] / 9.8 for name in ("ax", "ay", "az")}
    (fault,) = flight(tmp_path, **force).faults
    assert fault.kind == "wrong unit"
    assert (
        "the specific force is 1.02 m/s2 in the median, which no flight has; its column looks like g"
        in fault.message
    )
    assert fault.message.endswith(
        f'write unit = "g" for variables.az in {tmp_path / "f.csv.toml"}, and for ax and ay'
    )


def test_swapped_axes(tmp_path: Path) -> None:
    m = motion()
    found = [fault.message for fault in flight(tmp_path, p=m["q"], q=m["p"]).faults]
    assert any(
        "it follows q instead: axes are swapped; exchange the columns for variables.p in" in x for x in found
    )


@pytest.mark.parametrize(("name", "unit"), [("p", "deg/s"), ("phi", "deg")])
def test_degrees_name_the_key(tmp_path: Path, name: str, unit: str) -> None:
    with pytest.raises(FlightError, match=rf'write unit = "{unit}" for variables\.{name} in .*f\.csv\.toml'):
        flight(tmp_path, **{name: np.degrees(motion()[name])})


def test_units_that_explain_a_size() -> None:
    columns = {
        "pressure": 1013.0,
        "temperature": 15.0,
        "rotor_1": 9000.0,
        "pwm_1": 1.5e-3,
        "motor_1": 55.0,
        "density": 3.0,
    }
    group = Channels("f", T, {name: np.full(T.size, x) for name, x in columns.items()})
    found = {
        fault.variable: fault.message
        for fault in unit_faults([group], {"motor_1": "m.toml: variables.motor_1"})
    }
    meant = {"pressure": "hPa", "temperature": "degC", "rotor_1": "rpm", "pwm_1": "s", "motor_1": "percent"}
    assert all(f'write unit = "{unit}"' in found[name] for name, unit in meant.items()), found
    assert "write another column" in found["density"]
    assert found["motor_1"].endswith("for variables.motor_1 in m.toml")


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
        ("g g g", {}, 'write unit = "m/s2" for variables.az in M, and for ax and ay'),
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


def test_a_plain_number_has_no_unit() -> None:
    (found,) = unit_faults([Channels("f", T, {"motor_1": 67.0 + 0.0 * T})], {})
    assert found.message.startswith("motor_1 is 67 in the median")


def test_motors_in_microseconds_are_pulses() -> None:
    (found,) = unit_faults([Channels("f", T, {"motor_2": 1670.0 + 0.0 * T})], {})
    assert "looks like pulses in us: write scale = 0.001 and offset = -1" in found.message
    assert "or call it pwm_2" in found.message
