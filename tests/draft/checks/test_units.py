"""A wrong unit or sign of a mapping, degrees where radians belong among them, is reported, with the line to change."""

from pathlib import Path

import numpy as np
import pytest
from draft.checks.test_clean_flights import OWN
from draft.test_mapping_draft import T, flown
from helpers.made_logs import mapped_log

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.rotations import wrap
from stoop.errors import FlightError
from stoop.flight import Flight, load_flight
from stoop_draft.checks.engine import empty_columns
from stoop_draft.checks.entries import Line, Lines
from stoop_draft.checks.mapping import check_mapping
from stoop_draft.checks.units import Sizes, without_jumps

DEG = 180.0 / np.pi
FORCE = ("ax", "ay", "az")


def flight(folder: Path, **changed: np.ndarray) -> Flight:
    return load_flight(mapped_log(folder / "f.csv", {"t": T, **flown(), **changed}))


def test_a_sign_a_unit_and_exchanged_axes(tmp_path: Path) -> None:
    assert flight(tmp_path).faults == ()
    m, in_g = flown(), {name: flown()[name] / 9.8 for name in FORCE}
    whole = 'p = {column = "q", unit = "rad/s"} and q = {column = "p", unit = "rad/s"} under [variables] in'
    for changed, variable, fix in (
        ({"p": -m["p"]}, "p", "write scale = -1 for variables.p in"),
        ({"az": -m["az"]}, "az", "write scale = -1 for variables.az in"),
        ({"voltage": 1e3 * m["voltage"]}, "voltage", 'write unit = "mV" for variables.voltage in'),
        (in_g, "az", 'write unit = "g" for variables.ax, variables.ay and variables.az in'),
        ({"p": m["q"], "q": m["p"]}, "p", f"write {whole}"),
    ):
        (fault,) = flight(tmp_path, **changed).faults
        assert fault.variable in (variable, "ax", "p, q")
        assert fix in fault.message
        assert fault.message.endswith("f.csv.toml")
    for name, unit in (("p", "deg/s"), ("phi", "deg")):
        words = rf'write unit = "{unit}" for variables\.{name} in .*f\.csv\.toml'
        with pytest.raises(FlightError, match=words):
            flight(tmp_path, **{name: np.degrees(m[name])})


def noticed(lines: Lines | None = None, **columns: np.ndarray | float) -> list[Notice]:
    signals = {name: (T, np.broadcast_to(np.asarray(x, float), T.shape)) for name, x in columns.items()}
    return list(check_mapping(signals, {}, 100.0, lines or {}).notices)


def test_units_that_explain_a_size() -> None:
    sizes = dict(pressure=1013, temperature=15, rotor_1=9000, pwm_1=1.5e-3, motor_1=55, density=3)  # noqa: C408
    meant = {"pressure": "hPa", "temperature": "degC", "rotor_1": "rpm", "pwm_1": "s", "motor_1": "percent"}
    found = {one.subject: one for one in noticed({"motor_1": Line("m.toml", "variables.motor_1")}, **sizes)}
    fixes = {name: one.values["fix"] for name, one in found.items() if name != "density"}
    assert fixes == {name: f'write unit = "{unit}"' for name, unit in meant.items()}
    assert found["density"].code == "size-unexplained"
    assert found["motor_1"].values["suggestion"].endswith("for variables.motor_1 in m.toml")
    (percent,), (pulses,), (up,) = noticed(motor_1=67.0), noticed(motor_2=1670.0), noticed(az=10.3)
    assert (percent.code, percent.values["size"], percent.values["unit"]) == ("unit-size", 67.0, "")
    assert pulses.code == "command-in-pulses"
    assert "scale = 0.001 and offset = -1" in pulses.values["fix"]
    assert "or call it pwm_2" in pulses.values["fix"]
    assert (up.code, up.values["fix"]) == ("force-points-up", "write scale = -1")
    assert noticed(az=-9.8) == []


def noisy(folder: Path, units: str, **factors: float) -> list[str]:
    """Return what is told of a flight whose accelerometers are noisy and whose mapping says these units of them."""
    rng, m = np.random.default_rng(0), flown()
    flight(folder, **{n: factors.get(n, 1.0) * (m[n] + rng.normal(0.0, 0.1, T.size)) for n in FORCE})
    file = folder / "f.csv.toml"
    text = file.read_text()
    for name, unit in zip(FORCE, units.split(), strict=True):
        text = text.replace(f'"{name}", unit = "m/s2"', f'"{name}", unit = "{unit}"')
    file.write_text(text)
    found = load_flight(folder / "f.csv").faults
    return [f.message.replace(str(file), "M") for f in found if f.kind == "wrong unit"]


def test_g_and_metres_per_second_squared_are_told_apart(tmp_path: Path) -> None:
    G = 1.0 / 9.80665
    for units, factors, fix in (
        ("g m/s2 g", {"ax": G, "az": G}, ""),  # axes in units of their own are right
        ("m/s2 m/s2 g", {}, 'write unit = "m/s2" for variables.az in M'),
        ("g g g", {}, 'write unit = "m/s2" for variables.ax, variables.ay and variables.az in M'),
        ("m/s2 m/s2 m/s2", {"az": G}, 'write unit = "g" for variables.az in M'),
        ("g m/s2 m/s2", {}, 'write unit = "m/s2" for variables.ax in M'),
        ("g m/s2 g", {"ax": G, "ay": G, "az": G}, 'unit = "g" for variables.ay in M'),
    ):
        told = noisy(tmp_path, units, **factors)
        assert [one.endswith(fix) for one in told] == [True] * bool(fix), (units, factors)


def test_a_heading_near_north_is_no_degree() -> None:
    """It jumps by a whole turn wherever it passes north, whichever way it turns."""
    r = 0.02 * np.sin(9.0 * T)
    heading = np.cumsum(r) * 0.01 + 2e-4 * np.random.default_rng(0).standard_normal(T.size)
    values = flown() | {"r": r, "psi": np.mod(heading, 2.0 * np.pi)}
    sizes = Sizes({name: (T, x) for name, x in values.items()})
    assert sizes.growth({}, "psi", "r") == pytest.approx(1.0, rel=0.2)
    heading = np.linspace(0.0, 20.0, 500)
    for unit in (1.0, DEG, 1.0 / DEG):
        recorded = unit * np.mod(heading, 2.0 * np.pi)
        np.testing.assert_allclose(without_jumps("psi", recorded), unit * heading, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", DEG), ("deg/s", 1.0 / DEG)])
def test_a_rate_that_was_converted_twice_is_multiplied_back(unit: str, factor: float) -> None:
    values = {name: x for name, x in flown().items() if name != "voltage"}
    values["q"] = values["q"] / factor
    lines = {name: OWN[name] for name in values}
    lines["q"] = Line("m.toml", "variables.q", unit, {"column": "q", "unit": unit})
    found = check_mapping({name: (T, x) for name, x in values.items()}, values, 100.0, lines)
    (one,) = (*found.refused, *found.notices)
    assert one.values["changes"] == (f"variables.q.scale = {factor:.12g}",)


def maneuver(size: float = 0.3, noise: float = 0.0) -> dict[str, FloatArray]:
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


def test_radians_pass() -> None:
    for size, noise in ((1e-3, 0.0), (1e-3, 0.3), (0.03, 0.1), (0.3, 0.3), (1.0, 0.0), (1.0, 0.3)):
        assert check(maneuver(size, noise)) == [], (size, noise)
    values = maneuver(0.3)
    values["theta"][::500] = 1e9  # some wild samples prove nothing
    assert check(values) == []
    for x in (np.full(50, np.nan), np.zeros(50), np.zeros(1)):
        assert check({"phi": x, "p": x}) == []


@pytest.mark.parametrize("size", [0.02, 0.3])
def test_one_channel_in_degrees_is_accused(size: float) -> None:
    for name, unit in (("phi", "deg"), ("theta", "deg"), ("p", "deg/s"), ("q", "deg/s")):
        values = maneuver(size, noise=0.01)
        values[name] = values[name] * DEG
        (found,) = check(values, {name: Line("m.toml", f"variables.{name}", "rad")})
        assert found.values["lines"] == (name,)
        assert found.values["suggestion"] == f'write unit = "{unit}" for variables.{name} in m.toml'


def test_several_channels_in_degrees() -> None:
    for size, names, lines in (
        (1.0, ("elevator",), [("elevator",)]),  # beyond any angle
        (1.0, ("alpha",), [("alpha",)]),
        (1.0, ("psi",), [("psi",)]),
        (0.02, ("phi", "theta", "psi"), [("phi", "theta", "psi")]),  # of one sensor: one finding
    ):
        values = maneuver(size)
        found = check(values | {name: values[name] * DEG for name in names})
        assert [one.values["lines"] for one in found] == lines
    found = check({name: x * DEG for name, x in maneuver(0.3).items()})
    assert {name for one in found for name in one.values["lines"]} == {*maneuver()}
    (one,) = check({"theta": np.full(100, 12.0)})
    assert one.values["suggestion"] == 'write unit = "deg" for theta in a mapping (see stoop map)'


def test_siblings_show_the_wrong_unit_and_a_heading_counted_through_turns_is_none_in_degrees() -> None:
    """The attitude is 57 times too fast for rates that are said to be in deg/s, as only p is of its sensor."""
    values = maneuver(0.02)
    values["p"] = values["p"] / DEG
    units = {"phi": "rad", "theta": "rad", "psi": "rad", "p": "deg/s", "q": "rad/s", "r": "rad/s"}
    (found,) = check(values, {name: Line("m.toml", name, unit) for name, unit in units.items()})
    assert found.values["suggestion"] == 'write unit = "rad/s" for p in m.toml'
    time = np.arange(0.0, 60.0, 0.01)
    rate = 0.5 + 0.2 * np.sin(time)
    heading = np.cumsum(rate) * 0.01
    assert check({"psi": heading, "r": rate}) == []
    assert check({"psi": wrap(heading), "r": rate}) == []
    (found,) = check({"psi": wrap(heading) * DEG, "r": rate})
    assert found.values["lines"] == ("psi",)


def test_a_column_without_a_finite_number_is_empty() -> None:
    nothing, something = np.array([np.nan, np.inf]), np.array([np.nan, 1.0])
    assert empty_columns({"a": nothing, "b": something, "c": np.empty(0)}) == {"a", "c"}
