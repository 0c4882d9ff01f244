"""Free and frequency responses, of models and as measured, against closed forms."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal
from scipy.signal import lfilter

from stoop import load_vehicle, trim
from stoop.assessment.verdict import Limits
from stoop.base.arrays import ComplexArray, FloatArray
from stoop.flight.frequency_responses import Stretch
from stoop.results.extensions import ResponseMisfit
from stoop.results.result import Covariance, NoiseCovariance, ParameterEstimate, Result
from stoop.simulation.fly import simulate_flight
from stoop.simulation.linearize import linearize
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.workflow.demo import MANEUVER as DEMO
from stoop_analysis.free_response import free_response, measured_mode
from stoop_analysis.frequency import ModelResponse, transfer, uncertain_model
from stoop_analysis.handling import Known, bandwidth, equivalent_system, error_correlation, flight_draws
from stoop_analysis.workflow.response_misfit import response_misfits

TIME = np.arange(0.0, 8.0, 0.01)


def record(w: float, zeta: float, noise: float, seed: int = 0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return a doublet until 2 s and what two channels do, an oscillation on a slow drift from then on."""
    random = np.random.default_rng(seed)
    control = np.where(TIME < 1.0, 0.0, np.where(TIME < 1.5, 0.2, np.where(TIME < 2.0, -0.2, 0.0)))[:, None]
    t = np.maximum(TIME - 2.0, 0.0)
    decay, angle = np.exp(-zeta * w * t), w * np.sqrt(1 - zeta**2) * t
    clean = {"r": 0.3 * decay * np.cos(angle) + 0.02 * t, "beta": 0.1 * decay * np.sin(angle + 0.4) + 0.05}
    return control, {n: y + noise * random.standard_normal(len(y)) for n, y in clean.items()}


def test_a_known_oscillation_comes_back_within_its_error() -> None:
    off = []
    for seed in range(20):
        control, channels = record(3.0, 0.2, 0.01, seed)
        found = measured_mode("Dutch roll", 1, free_response(TIME, control, channels), 3.2)
        assert (found.maneuver, found.channels, found.remark) == (1, ("r", "beta"), None)
        assert found.start == pytest.approx(2.0)
        off.append((found.frequency.estimate - 3.0) / found.frequency.std_error)
        off.append((found.damping.estimate - 0.2) / found.damping.std_error)
    assert np.std(off) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(off)) < 0.6


def test_what_is_no_single_oscillation_widens_the_error() -> None:
    """A faster mode left over at the start: noise alone would be far too sure."""
    off, widths = [], []
    for seed in range(4):
        control, channels = record(3.0, 0.2, 0.005, seed)
        t = np.maximum(TIME - 2.0, 0.0)
        other = {n: y + 0.08 * np.exp(-2.5 * t) * np.cos(7.0 * t) for n, y in channels.items()}
        both = (free_response(TIME, control, c) for c in (channels, other))
        pure, mixed = (measured_mode("Dutch roll", 0, one, 3.0) for one in both)
        off += [(mixed.frequency.estimate - 3.0) / mixed.frequency.std_error]
        off += [(mixed.damping.estimate - 0.2) / mixed.damping.std_error]
        widths.append(mixed.damping.std_error / pure.damping.std_error)
    assert np.median(widths) > 2.0
    assert np.max(np.abs(off)) < 3.0


def test_what_cannot_be_told_is_said() -> None:
    (control, channels), random = record(3.0, 0.2, 0.01), np.random.default_rng(4)
    restless = 0.2 * np.sign(np.sin(7.0 * TIME))[:, None] + 0.3 * (TIME > 7.985)[:, None]
    free = free_response(TIME, control, {**channels, "V": np.full(len(TIME), np.nan)})
    noise = free_response(TIME, control, {n: random.standard_normal(len(TIME)) for n in channels})
    never = free_response(TIME, restless, {"r": np.zeros(len(TIME))})
    assert not never.time.size
    for given, name, expected, codes in (
        (free, "spiral", 0.1, {"response-no-oscillation"}), (free, "phugoid", 3.0, {"response-not-recorded"}),
        (free, "Dutch roll", 0.3, {"response-too-short"}), (never, "Dutch roll", 3.0, {"response-no-rest"}),
        (noise, "Dutch roll", 3.0, {"response-not-explained", "response-inaccurate"}),
    ):  # fmt: skip
        found = measured_mode(name, 0, given, expected)
        assert found.remark is not None
        assert found.remark.code in codes
        assert found.remark.subject == name
        assert codes & {"response-not-explained"} or np.isnan(found.frequency.estimate)


FREQUENCY, BAND = np.geomspace(0.5, 40.0, 400), np.geomspace(0.5, 30.0, 40)


def short_period_response(w: FloatArray, sign: float = -1.0, delay: float = 0.08) -> ComplexArray:
    s = 1j * w
    return np.asarray(sign * 20.0 * (s + 1.5) * np.exp(-delay * s) / (s**2 + 2 * 0.6 * 5.0 * s + 25.0))


def known(response: ComplexArray, w: FloatArray = FREQUENCY) -> Known:
    return Known(w, response, np.ones(len(w)), np.zeros((0, len(w)), dtype=complex))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pure_lag_with_delay(sign: float) -> None:
    """Attitude K e^(-tau s)/s lags 90 deg and tau w: all four figures are closed expressions, whatever the sign."""
    half = 0.5 * np.pi / 0.1  # over tau
    found = bandwidth(known(np.asarray(sign * 3.0 * np.exp(-0.1j * FREQUENCY))))
    bands = [e.estimate for e in (found.crossover, found.phase_bandwidth, found.gain_bandwidth)]
    assert bands == pytest.approx([half, 0.5 * half, half / 10 ** (6.0 / 20.0)], rel=1e-4)  # magnitude 3/w
    assert found.phase_delay.estimate == pytest.approx(0.05, rel=1e-3)  # (pi + pi/2 - pi)/(2 w180)
    nothing = bandwidth(known(np.ones(len(FREQUENCY), dtype=complex)))  # is reached
    assert np.isnan([nothing.crossover.estimate, nothing.phase_delay.estimate]).all()


def test_equivalent_systems_come_back() -> None:
    w, short = np.geomspace(1.0, 20.0, 40), {"delay": 0.08, "zero": 1.5, "frequency": 5.0, "damping": 0.6}
    roll = np.asarray(7.0 * np.exp(-0.05j * w) / (0.25j * w + 1.0))
    for response, control, rate, expected in (
        (short_period_response(w, 1.0), "elevator", "q", short | {"gain": 20.0}),
        (short_period_response(w, -1.0), "elevator", "q", short | {"gain": -20.0}),
        (roll, "aileron", "p", {"gain": 7.0, "delay": 0.05, "time_constant": 0.25}),
    ):
        system = equivalent_system(known(response, w), control, rate)
        assert system is not None
        assert {n: e.estimate for n, e in system.parameters.items()} == pytest.approx(expected, rel=1e-4)
        assert system.cost < 1e-6
        assert equivalent_system(known(response[::8], w[::8]), control, rate) is None, "too few frequencies"


def test_intervals_hold_what_random_errors_scatter() -> None:
    """Standard errors of a flight's equivalent system are the scatter over draws of its random errors."""
    w, error, window = np.geomspace(1.0, 20.0, 30), np.full(30, 0.05), np.full(30, 8.0)
    draws = flight_draws(w, short_period_response(w), error, window, seed=3)[:60]
    each = (Known(w, one, np.ones(30), draws[:0], error, window) for one in draws)
    fits = [equivalent_system(one, "e", "q") for one in each]
    for name, truth in (("frequency", 5.0), ("damping", 0.6), ("delay", 0.08)):
        found = [f.parameters[name] for f in fits if f is not None]
        scatter = np.std([e.estimate for e in found])
        assert np.median([e.std_error for e in found]) == pytest.approx(scatter, rel=0.35)
        assert np.mean([e.ci95_lower <= truth <= e.ci95_upper for e in found]) >= 0.85


def test_errors_far_apart_are_independent() -> None:
    shared = error_correlation(np.array([1.0, 1.01, 50.0]), np.full(3, 10.0))
    assert_allclose(np.diag(shared), 1.0)
    assert shared[0, 1] > 0.99
    assert abs(shared[0, 2]) < 1e-3


def test_the_response_is_scipys_and_delays_turn_its_phase() -> None:
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    model = linearize(vehicle, trim(vehicle, 35.0))
    found, j, k = transfer(model, BAND), model.outputs.index("q"), model.inputs.index("elevator")
    with warnings.catch_warnings():  # its numerator begins with rounding errors
        warnings.simplefilter("ignore", signal.BadCoefficients)
        exact = signal.freqresp((model.A, model.B[:, [k]], model.C[[j]], model.D[[j]][:, [k]]), BAND)[1]
    assert_allclose(found[:, j, k], exact, rtol=1e-6)
    late = replace(model, input_delays=model.input_delays + 0.05)
    assert_allclose(transfer(late, BAND)[:, j, k], exact * np.exp(-0.05j * BAND), rtol=1e-6)


@pytest.mark.parametrize("variance", [1e-4, np.inf])
def test_the_band_follows_the_covariance_or_the_prior(variance: float) -> None:
    """A standard error of 1 % of Cmelevator moves q above the short period by 1 %; a vehicle file has no band."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    gain, point, at = vehicle.value("Cmelevator"), trim(vehicle, 35.0), np.array([30.0])
    parameters = {
        "Cmelevator": ParameterEstimate(gain, prior_mean=gain, prior_std=0.01 * abs(gain)),
        "Cm0": ParameterEstimate(vehicle.value("Cm0"), identifiable=False),
        "Cmq": ParameterEstimate(vehicle.value("Cmq")),
    }
    matrix = np.diag([variance * gain**2, np.inf, 1e-8])
    other = NoiseCovariance((), np.empty((0, 0))), (), (), (), (), 0.0, 0.0, 0.0, 0, "lm", "converged"
    found = uncertain_model(vehicle, point, Result(parameters, Covariance(tuple(parameters), matrix), *other))
    one = found.responses(["elevator"], ["q"], at)["elevator", "q"]
    assert one.magnitude_half_width == pytest.approx(1.96 * 20.0 * np.log10(1.01), rel=0.25)
    assert [(n.code, n.values["parameters"]) for n in found.notices] == [("parameters-held", ("Cm0",))]
    told = uncertain_model(vehicle, point).responses(["elevator"], ["q"], at)["elevator", "q"]
    assert np.isnan(told.magnitude_half_width).all()


def test_the_band_of_a_gain() -> None:
    """A gain of relative standard error 0.05 has a band of 1.96 x 0.05 of its magnitude, and none of its phase."""
    draws = np.exp(0.05 * np.random.default_rng(0).standard_normal((20000, 1))) * np.ones((1, 40))
    one = ModelResponse("u", "y", BAND, np.ones(40, dtype=complex), draws.astype(complex))
    assert one.magnitude_half_width == pytest.approx(1.96 * 0.05 * 20.0 / np.log(10.0), rel=0.02)
    assert_allclose(one.phase_half_width, 0.0, atol=1e-12)


def flown(seed: int, noise: float, modeled: float) -> tuple[ResponseMisfit, ...]:
    """Return the misfits of a model with a share of the true gain, of a first-order system with two inputs that move together."""
    rng = np.random.default_rng(seed)
    u = lfilter([0.3], [1.0, -0.7], rng.standard_normal((2, 3000)))
    u[1] += 0.5 * u[0]
    clean = lfilter([0.1], [1.0, -0.9], u[0]) - 0.3 * lfilter([0.1], [1.0, -0.9], u[1])
    measured = clean + noise * rng.standard_normal(3000)
    both = np.column_stack([measured, measured - clean * modeled])
    return response_misfits([Stretch(50.0, u.T, both)], ("a", "b"), ("p",))


@pytest.mark.parametrize("modeled", [0.0, 0.5, 0.7, 0.9, 1.3])
def test_a_gain_that_is_wrong_by_a_share_leaves_that_share(modeled: float) -> None:
    first, second = flown(1, 1e-3, modeled)
    for one in (first, second):
        assert one.share == pytest.approx(abs(1.0 - modeled), rel=0.02)
        assert one.least <= one.share
    assert first.input == "a"
    assert 0.0 < first.low < first.high <= 2.0 * np.pi * 10.0
    assert flown(1, 30.0, modeled) == (), "the flights do not show it"


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_of_a_right_model_little_more_than_noise_is_left(noise: float) -> None:
    found = [one.least for seed in range(100) for one in flown(seed, noise, 1.0)]
    assert np.mean(np.array(found) > 0.0) < 0.06
    assert max(found) < Limits.error


PULSE = "duration = 40.0\nrate = 50.0\n" + (
    '[[input]]\ncontrol = "elevator"\nshape = "pulse"\nstart = 1.0\nduration = 3.0\namplitude = 0.1\n'
)


@pytest.mark.parametrize("text", [DEMO, PULSE])
def test_where_the_model_is_the_truth_the_record_agrees_with_it(aircraft: Vehicle, text: str) -> None:
    """Phugoids of a tenth of the airspeed, the short period at their start: noise alone was up to seven errors off."""
    off = []
    for seed in range(3):
        flight = simulate_flight(aircraft, parse_maneuver(text, "test"), seed, name="sim")
        V = float(np.mean(flight.column("V")))
        controls = np.column_stack([flight.column(c) for c in aircraft.controls])
        free = free_response(flight.time, controls, {c: flight.column(c) for c in aircraft.outputs})
        for mode in linearize(aircraft, trim(aircraft, V, 200.0)).modes:
            seen = measured_mode(mode.name, 0, free, mode.frequency, V)
            if not seen.remark:
                off.append((seen.frequency.estimate - mode.frequency) / seen.frequency.std_error)
                off.append((seen.damping.estimate - mode.damping) / seen.damping.std_error)
    assert len(off) >= 6
    assert np.max(np.abs(off)) < 3.5  # the greatest of a dozen
    assert np.sqrt(np.mean(np.square(off))) < 1.7
