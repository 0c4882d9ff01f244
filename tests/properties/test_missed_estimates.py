"""Properties of estimates, searches and stores that no quick test held: each kills a planted defect that others missed."""

from __future__ import annotations

import math
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
from scipy.stats import linregress

from stoop.assessment import verdict
from stoop.base.units import FOOT, POUND_FORCE
from stoop.control_laws.ardupilot import plane
from stoop.control_laws.rate_law import SETPOINT
from stoop.estimate.regression.least_squares import Priors, Rows, solve
from stoop.estimate.regression.recursive import RealTime
from stoop.exporters.jsbsim_loads import _LOADS
from stoop.fleet.mixed_model import Design, fit_robust_model
from stoop.flight.flight import from_columns
from stoop.flight.instrument_errors import RATES_DELAY, InstrumentError
from stoop.optimize.levenberg_marquardt import NielsenDamping
from stoop.parallel import Plan, Run, execute
from stoop.parallel.loop import Tally
from stoop.parallel.store import open_store
from stoop.problem.misfit import Piece as Flown
from stoop.problem.prepare import Prepared, with_average_voltage, without_stuck_channels
from stoop.reconstruction.kinematics import OUTPUTS
from stoop.reconstruction.problem import START, Piece, Problem
from stoop.report import charts, estimates
from stoop.results.result import Covariance, ParameterEstimate, ProcessNoise
from stoop.results.verdict import Need, Use
from stoop.simulation import initial_states, parameter_rows
from stoop.tuning.gain_search import Specification
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle_draft.autopilot import read_setup


def judged(parameters: dict[str, ParameterEstimate]) -> Any:
    variances = np.diag([p.std_error**2 for p in parameters.values()])
    return SimpleNamespace(
        parameters=parameters, covariance=Covariance(tuple(parameters), variances), notices=(), maneuvers=(),
        response_misfits=(), process_noise=ProcessNoise("steady"), status="converged", cost=1.0,
    )  # fmt: skip


def test_a_use_needs_an_error_below_a_fifth_and_a_size() -> None:
    """Without a size nothing is known of the error relative to it."""
    use = Use("control design", (), (Need("damping in roll", ("Clp",), (0.0,)),))
    for estimate, error, justified in ((-0.5, 0.09, True), (-0.5, 0.11, False), (0.0, 0.1, False)):
        result = judged({"Clp": ParameterEstimate(estimate, error)})
        assert verdict._judged(result, use, {"Clp": abs(estimate)}).justified is justified


def test_a_result_is_refused_where_more_than_half_is_unknown() -> None:
    for unknown, refused in ((2, False), (3, True)):
        every = {f"n{i}": ParameterEstimate(1.0, 0.1, identifiable=i >= unknown) for i in range(4)}
        assert bool([*verdict._refusals(judged(every))]) is refused


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
    vehicle = resolve_vehicle("twin-boom")
    rows, inputs = parameter_rows(vehicle), np.zeros((30, len(vehicle.inputs)))
    start = {"V": 35.0, "psi": math.pi - 0.01, "r": 0.3, "h": 100.0}
    states = initial_states(vehicle, start, rows, inputs[0])
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
    text = resolve_vehicle("quad-x").text.replace("[rotors]", "[rotors]\nvoltage_average = 0.4")
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
    """Four of seven runs were there before; the others go on at the speed of those of this process."""
    runs = tuple(Run(f"r{i}", "m:f", {"i": i}) for i in range(7))
    seen: list[Tally] = []
    monkeypatch.setattr("stoop.parallel.loop.environment", dict)

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


def test_the_band_of_white_residuals_narrows_with_the_root_of_their_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes = MagicMock(**{"plot.return_value": [Mock()]})
    monkeypatch.setattr(charts, "canvas", contextmanager(lambda *_, **__: iter([(None, (axes,))])))
    monkeypatch.setattr(charts, "svg", lambda *_: "")
    charts.autocorrelation_panels({"p": (np.ones(3), 0.01, 100), "q": (np.ones(3), 0.01, 400)})
    bands = [call.args[1] for call in axes.axhspan.call_args_list]
    np.testing.assert_allclose(bands, [0.196, 0.098], atol=1e-4)


def test_a_heading_about_south_is_not_stuck() -> None:
    """It jumps between half a turn to either side, as white as its noise."""
    vehicle, n = resolve_vehicle("twin-boom"), 100
    noise = 0.01 * np.random.default_rng(0).standard_normal((n, len(vehicle.outputs)))
    psi = vehicle.outputs.index("psi")
    noise[:, psi] = np.mod(noise[:, psi] + 2.0 * np.pi, 2.0 * np.pi) - np.pi
    prepared = Prepared((), (Flown(0, 0.01 * np.arange(n), np.zeros((n, len(vehicle.inputs))), noise, {}),))
    assert without_stuck_channels(vehicle, prepared) is prepared


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


def test_a_recursive_lag_follows_a_ramp_exactly() -> None:
    """The response of a first-order lag to a ramp from rest is t - T (1 - exp(-t / T))."""
    dt, lag, rate = 0.01, 0.05, 3.0
    servo: Any = RealTime.__new__(RealTime)
    servo._dt, servo._lags, servo._parameters = dt, {}, np.array([[lag]])
    servo._vehicle = SimpleNamespace(rows={"controls.elevator.lag": 0})
    time = dt * np.arange(40)
    found = [servo._lagged("elevator", command) for command in (rate * time).tolist()]
    np.testing.assert_allclose(found, rate * (time - lag * (1.0 - np.exp(-time / lag))), atol=1e-12)


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
