import math
import os
import re
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.stats import linregress

from stoop.base import files
from stoop.base.autopilots import ARDUPILOT
from stoop.base.units import FOOT, POUND_FORCE
from stoop.estimate.regression.least_squares import Priors, Rows, solve
from stoop.flight.flight import from_columns
from stoop.flight.instrument_errors import RATES_DELAY, InstrumentError
from stoop.optimize.levenberg_marquardt import NielsenDamping
from stoop.parallel import Plan, Run, execute
from stoop.parallel.loop import Tally
from stoop.parallel.store import open_store
from stoop.problem.misfit import Piece as Flown
from stoop.problem.prepare import Prepared, with_average_voltage
from stoop.reconstruction.kinematics import OUTPUTS
from stoop.reconstruction.problem import START, Piece, Problem
from stoop.report import charts, estimates
from stoop.results.result import ParameterEstimate
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.vehicle_draft.autopilot import read_setup
from stoop_draft.vehicle_draft.strips import strips, to_flap
from stoop_export.ardupilot_parameters import frame
from stoop_export.fmu import Quantity, Unit, description
from stoop_export.jsbsim_loads import _LOADS
from stoop_export.matlab import _FLY
from stoop_fleet.changes import threshold
from stoop_fleet.mixed_model import Design, fit_robust_model
from stoop_tune.control_laws.ardupilot import plane
from stoop_tune.control_laws.rate_law import SETPOINT
from stoop_tune.gain_search import Specification
from stoop_tune.judgment import worst


def test_the_feedforward_of_a_plane_grows_as_the_air_thins() -> None:
    values = {"RLL_RATE_P": 0.1, "RLL_RATE_I": 0.0, "RLL_RATE_FF": 0.3}
    sea, high = (plane(values, "roll", ratio) for ratio in (1.0, 0.5))
    z = np.exp(np.array([0.01j]))
    for one, other in zip(sea.terms, high.terms, strict=True):
        a, b = (term.response(SETPOINT, z, sea.rate) for term in (one, other))
        np.testing.assert_allclose(b, a * (2.0 if one.name == "FF" else 1.0))


def test_loads_of_jsbsim_are_pounds_and_feet() -> None:
    """A pound-force is 4.4482216 N, a foot-pound 1.3558179 J."""
    assert [size for *_, size in _LOADS["force"]] == pytest.approx([4.4482216] * 3)
    assert [size for *_, size in _LOADS["moment"]] == pytest.approx([1.3558179] * 3)
    assert pytest.approx(1.3558179) == POUND_FORCE * FOOT


def test_one_of_forty_levels_lies_three_deviations_off_by_chance() -> None:
    """The largest of forty normal numbers exceeds 3.1 once in thirteen, 6 never."""
    vehicles = {"vehicle": np.repeat(np.arange(40), 3)}
    for far, outlying in ((3.1, []), (6.0, [39])):
        level = np.append(np.tile([-1.0, 1.0], 20)[:39], far)
        values = np.repeat(level, 3) + np.tile([-0.02, 0.0, 0.02], 40)
        design = Design(values, np.full(120, 0.02), np.ones((120, 1)), vehicles)
        assert [one.level for one in fit_robust_model(design)[1]] == outlying


def test_a_cost_knows_no_turns_of_the_heading() -> None:
    vehicle = load_vehicle("twin-boom")
    rows, inputs = vehicle.parameter_rows(), np.zeros((30, len(vehicle.inputs)))
    start = {"V": 35.0, "psi": math.pi - 0.01, "r": 0.3, "h": 100.0}
    states = vehicle.initial_states(start, rows, inputs[0])
    outputs = vehicle.kernel().trajectories(rows, states, inputs, 0.01)[0]
    turned = outputs + 0.1 + np.array([2.0 * np.pi * (c in ("phi", "psi")) for c in vehicle.outputs])
    for z in (outputs + 0.1, turned, turned - 4.0 * (turned - outputs - 0.1) / 2.0):
        cost = vehicle.kernel().cost(rows, states, inputs, z, np.ones_like(outputs), 0.01)[0]
        assert cost == pytest.approx(0.01 * outputs.size, rel=1e-9)


def test_damping_is_updated_as_nielsen_has_it() -> None:
    """H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05: a smooth curve from 2 to 1/3."""
    for ratio, factor in {0.0: 2.0, 0.25: 1.125, 0.5: 1.0, 0.75: 0.875, 1.0: 1.0 / 3.0}.items():
        assert NielsenDamping(1.0).relaxed(ratio) == pytest.approx(factor), ratio


def test_an_average_voltage_is_centered() -> None:
    text = load_vehicle("quad-x").text.replace("[rotors]", "[rotors]\nvoltage_average = 0.4")
    vehicle, time = parse_vehicle(text, "test"), 0.01 * np.arange(200)
    flight = from_columns("a", time, {"voltage": 16.0 - time})
    averaged = with_average_voltage(vehicle, flight).column("voltage")
    np.testing.assert_allclose(averaged[50:150], 16.0 - time[50:150], rtol=1e-12)


def test_a_store_waits_for_the_disk(tmp_path: Path) -> None:
    with open_store(tmp_path / "runs.db", Plan("p", {}, (Run("a", "m:f", {}),)), {}) as store:
        assert store._connection.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL


def test_late_gyros_are_read_as_much_earlier() -> None:
    dt, late = 0.01, 0.05
    time = dt * np.arange(300)
    inputs = np.zeros((300, 6))
    inputs[:, 3] = np.cos(2.0 * (time - late))  # of p, as it is read
    piece = Piece(time, inputs, np.full((300, len(OUTPUTS)), np.nan), dict.fromkeys(START, 0.0))
    unknown = InstrumentError(RATES_DELAY, 0.0, 0.01, "s", "", ())
    problem = Problem((unknown,), (piece,), np.ones(len(OUTPUTS)))
    z = np.append(late / 0.01, np.zeros(len(START)))
    phi = problem.outputs(z, 0)[:, OUTPUTS.index("phi")]
    np.testing.assert_allclose(phi[:250], 0.5 * np.sin(2.0 * time[:250]), atol=2e-4)


def test_what_is_not_identifiable_is_drawn_as_wide_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[tuple[float, float]] = []
    monkeypatch.setattr(estimates, "forest_row", lambda one, ends, kind, text: drawn.append(ends))
    unsure = ParameterEstimate(1.0, 0.5, identifiable=False, unit="1")
    sure = replace(unsure, identifiable=True, ci95_lower=0.1, ci95_upper=1.9)
    model: Any = SimpleNamespace(symbols={}, result=SimpleNamespace(parameters={"a": unsure, "b": sure}))
    estimates.estimates_section(model)
    np.testing.assert_allclose(drawn, [(1.0 - 0.98, 1.0 + 0.98), (0.1, 1.9)], atol=1e-3)


def test_time_left_counts_what_was_computed_now(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = tuple(Run(f"r{i}", "m:f", {"i": i}) for i in range(7))
    seen: list[Tally] = []
    monkeypatch.setattr("stoop.parallel.loop.environment", lambda _: {})

    def submit(task: Any) -> Future[Any]:
        done: Future[Any] = Future()
        results = ["1"] * len(task.runs)
        done.set_result({"worker": "w", "environment": {}, "results": results, "failure": "", "trace": ""})
        return done

    workers = SimpleNamespace(capacity=lambda: 1, submit=submit, status=lambda: "")
    pool: Any = SimpleNamespace(open=contextmanager(lambda: iter([workers])))
    for plan in (runs[:4], runs):
        seen.clear()
        execute(Plan("p", {}, plan), tmp_path / "s.db", pool, seen.append)
    assert [(one.done, one.restored) for one in seen] == [(4, 4), (5, 4), (6, 4), (7, 4)]
    left = [one.seconds_left for one in seen[1:]]
    np.testing.assert_allclose(left, [seen[1].seconds * 2.0, seen[2].seconds / 2.0, 0.0], rtol=1e-9)


def test_the_band_of_white_residuals_narrows_with_the_root_of_their_number(monkeypatch: Any) -> None:
    axes = MagicMock(**{"plot.return_value": [Mock()]})
    monkeypatch.setattr(charts, "canvas", contextmanager(lambda *_, **__: iter([(None, (axes,))])))
    monkeypatch.setattr(charts, "svg", lambda *_: "")
    charts.autocorrelation_panels({"p": (np.ones(3), 0.01, 100), "q": (np.ones(3), 0.01, 400)})
    bands = [call.args[1] for call in axes.axhspan.call_args_list]
    np.testing.assert_allclose(bands, [0.196, 0.098], atol=1e-4)


def test_a_heading_about_south_is_not_stuck() -> None:
    vehicle, n = load_vehicle("twin-boom"), 100
    noise = 0.01 * np.random.default_rng(0).standard_normal((n, len(vehicle.outputs)))
    psi = vehicle.outputs.index("psi")
    noise[:, psi] = np.mod(noise[:, psi] + 2.0 * np.pi, 2.0 * np.pi) - np.pi
    prepared = Prepared((), (Flown(0, 0.01 * np.arange(n), np.zeros((n, len(vehicle.inputs))), noise, {}),))
    assert prepared.without_stuck_channels(vehicle) is prepared


def test_errors_of_a_regression_are_those_of_the_textbook() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal(12)
    y = 1.0 + 2.0 * x + 0.3 * rng.standard_normal(12)
    expected = linregress(x, y)
    rows = Rows("c", y, np.column_stack([np.ones(12), x]), 0.01)
    found = solve([rows], Priors(np.zeros(2), np.full(2, np.inf)))
    np.testing.assert_allclose(found.values, [expected.intercept, expected.slope])
    errors = [expected.intercept_stderr, expected.stderr]
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), errors, rtol=1e-9)


def test_gains_are_proposed_for_nineteen_draws_of_twenty() -> None:
    draws = np.random.default_rng(0).permutation(np.linspace(6.0, 12.0, 101))
    figures = {
        "gain margin": ("dB", np.append(9.0, draws)), "phase margin": ("deg", np.full(102, 90.0)),
        "disk margin": ("dB", np.full(102, 8.0)), "noise": ("%", np.full(102, 1.0)),
    }  # fmt: skip
    one: Any = SimpleNamespace(values=lambda: figures)
    estimate, drawn = Specification(gain=6.0).left([one])
    assert estimate[0, 0] == pytest.approx(0.5)
    assert drawn[0, 0] == pytest.approx(np.quantile(draws, 0.05) / 6.0 - 1.0)


def test_a_reversed_output_of_px4_stops_at_its_longest_pulse() -> None:
    for reversed_bits, stop, full in ((0, 1100.0, 1900.0), (1, 1900.0, 1100.0)):
        parameters = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 1, "PWM_MAIN_FUNC1": 101, "PWM_MAIN_MIN1": 1100.0}
        parameters |= {"PWM_MAIN_MAX1": 1900.0, "PWM_MAIN_REV": reversed_bits}
        scale = read_setup(parameters).rotors[0].channels["pwm_1"]
        assert [(pulse - scale.zero) / scale.unit for pulse in (stop, full)] == [0.0, 1.0]


def test_a_file_is_replaced_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who has the old file open, or another name for it, keeps its content; the new one is on the disk before it is seen."""
    target, other = tmp_path / "a", tmp_path / "b"
    target.write_bytes(b"old")
    os.link(target, other)
    synced: list[tuple[int, bytes]] = []

    def fsync(handle: int) -> None:
        synced.append((os.fstat(handle).st_size, target.read_bytes()))

    monkeypatch.setattr(files.os, "fsync", fsync)
    files.write_file(target, b"newer")
    assert target.read_bytes() == b"newer"
    assert other.read_bytes() == b"old"
    assert synced == [(5, b"old")]


def test_the_script_of_matlab_integrates_inputs_that_are_linear_in_time_exactly() -> None:
    steps = re.findall(r"(k\d) = \{name\}_equations\((.*), (.*), p\);", _FLY)
    assert [name for name, *_ in steps] == ["k1", "k2", "k3", "k4"]
    (total,) = re.findall(r"    s = (s \+ h / 6 .*);", _FLY)
    known = {"s": 1.0, "h": 0.5, "a": 2.0, "b": 5.0}
    for name, _, inputs in steps:  # x' = u
        known[name] = eval(inputs, {}, known)  # noqa: S307
    assert eval(total, {}, known) == pytest.approx(1.0 + 0.5 * 3.5)  # noqa: S307
    known = {"s": 1.0, "h": 0.5, "a": 0.0, "b": 0.0}
    for name, state, _ in steps:  # x' = x, whose fourth order is the series of the exponential function
        known[name] = eval(state, {}, known)  # noqa: S307
    series = sum(0.5**n / math.factorial(n) for n in range(5))
    assert eval(total, {}, known) == pytest.approx(series)  # noqa: S307


def test_the_structure_of_a_unit_names_its_outputs() -> None:
    """FMI 2.0.4, section 2.2.8: the index of the first variable is 1; FMI 3.0 names value references."""
    kinds = ("independent", "parameter", "input", "output", "local", "output")
    unit = Unit("u", "u", tuple(Quantity(f"q{i}", "1", 0.0, kind) for i, kind in enumerate(kinds)), "")
    two, three = (ET.fromstring(description(unit, version)) for version in ("2.0", "3.0"))  # noqa: S314
    names = [one.attrib["name"] for one in two.findall("ModelVariables/ScalarVariable")]
    places = [int(one.attrib["index"]) for one in two.findall("ModelStructure/Outputs/Unknown")]
    assert [names[place - 1] for place in places] == ["q3", "q5"]
    references = [one.attrib["valueReference"] for one in three.findall("ModelStructure/Output")]
    variables = [one.attrib for one in three.findall("ModelVariables/Float64")]
    named = {one["valueReference"]: one["name"] for one in variables}
    assert [named[one] for one in references] == ["q3", "q5"]


def test_a_threshold_expects_the_alarms_that_were_asked_for() -> None:
    """Of statistics with an exponential tail, n exp(-x) exceed x."""
    drawn = -np.log((np.arange(10_000) + 0.5) / 10_000)
    for expected in (0.5, 5.0, 100.0):
        assert 10_000 * math.exp(-threshold(drawn, expected)) == pytest.approx(expected, rel=0.02)


def test_the_worst_noise_is_the_largest_and_the_worst_margin_the_smallest() -> None:
    spreads = ({"p5": 1.0, "p95": 3.0}, {"p5": 2.0, "p95": 2.5})
    figures = [{"noise": ("%", s), "gain margin": ("dB", s)} for s in spreads]
    judged: Any = [SimpleNamespace(axis="roll", figures=lambda f=f: f) for f in figures]
    assert worst(judged, "roll", "noise") == 3.0
    assert worst(judged, "roll", "gain margin") == 1.0


def test_a_maneuver_has_half_a_second_before_it_and_a_second_after() -> None:
    time = 0.01 * np.arange(4000)
    inside = (time >= 20.0) & (time < 22.0)
    elevator = np.where(inside, np.where(time < 21.0, 0.1, -0.1), 0.0)
    still = dict.fromkeys("pqr", np.zeros(time.size))
    flight = from_columns("f", time, {"V": np.full(time.size, 25.0), "elevator": elevator, **still})
    (found,) = flight.find_maneuvers()
    assert found.start == pytest.approx(20.0 - 0.5, abs=0.11)
    assert found.stop == pytest.approx(22.0 + 1.0, abs=0.11)


def test_ailerons_roll_and_elevons_together_do_not() -> None:
    wing: Any = SimpleNamespace(span=2.0, root_chord=0.25, taper=1.0, area=0.5, sweep=0.0)
    wing.position = (0.06, 0.0, 0.0)
    own = strips(wing, 0.0, np.zeros(3), (5.0, 4.0))
    flap: Any = SimpleNamespace(chord=0.25, span=(0.5, 0.95))
    apart, together = (to_flap(own, flap, symmetric, 0.8, 0.5, 0.0) for symmetric in (False, True))
    assert apart.moment[0] > 0.01
    assert apart.roll == pytest.approx(apart.moment[0], rel=0.05)
    assert together.moment[0] == pytest.approx(0.0, abs=1e-12)
    assert together.force[2] < -0.1


def test_frames_of_ardupilot_are_found_by_their_azimuths() -> None:
    """A rotor straight behind is at 180 degrees, a hair's breadth to the left of it at -180."""
    for (number, kind), places in ARDUPILOT.frames.items():
        rotors: list[Any] = []
        for azimuth, spin in places:
            at = math.cos(math.radians(azimuth + 1e-6)), math.sin(math.radians(azimuth + 1e-6)), 0.0
            rotors.append(SimpleNamespace(position=at, axis=(0.0, 0.0, -1.0), spin=spin))
        found = frame(rotors)
        assert (found.number, found.kind is None) == (number, False), (number, kind)
