"""Kinematics against truth: errors put into sensors come back, and what cannot be told is not."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers.flown import maneuver
from scipy.signal import lfilter

from stoop.assessment.contributions import systematic_shifts
from stoop.assessment.error_bars import estimate_uncertainty
from stoop.errors import FlightError
from stoop.flight import from_columns
from stoop.problem.evidence import PieceEvidence
from stoop.reconstruction import compatibility
from stoop.reconstruction.compatibility import Compatibility, corrected_flight
from stoop.reconstruction.kinematics import INPUTS, OUTPUTS, PARAMETERS, SCALED, STATES, kernel
from stoop.reconstruction.problem import PIECES, cut_pieces
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import load_vehicle


def test_a_point_at_rest_in_a_turn_reads_what_geometry_says() -> None:
    """A vane one meter ahead of the reference in a pure pitch rate sees alpha fall by q x / V."""
    rows = np.array([[1.0 if n in {f"{s}.scale" for s in SCALED} else 0.0] for n in PARAMETERS])
    rows[PARAMETERS.index("vane.x")] = 1.0
    state = np.zeros((len(STATES), 1))
    state[STATES.index("u")], state[STATES.index("e0")] = 20.0, 1.0
    inputs = np.zeros((len(INPUTS), 1))
    inputs[INPUTS.index("q")], inputs[INPUTS.index("az")] = 0.5, -9.80665
    rates, outputs = kernel().evaluate(rows, state, inputs)
    assert outputs[OUTPUTS.index("alpha"), 0] == pytest.approx(np.arctan2(-0.5, 20.0))
    assert outputs[OUTPUTS.index("vn"), 0] == pytest.approx(20.0)
    assert rates[STATES.index("w"), 0] == pytest.approx(0.5 * 20.0)
    assert rates[STATES.index("pn"), 0] == pytest.approx(20.0)


def test_without_attitude_nothing_can_be_compared() -> None:
    columns = dict.fromkeys(("p", "q", "r", "V"), np.zeros(1000))
    with pytest.raises(FlightError, match="attitude was not logged"):
        Compatibility.of(from_columns("bare", 0.01 * np.arange(1000), columns))


def test_without_accelerometers_rates_are_held_against_the_attitude() -> None:
    rng = np.random.default_rng(0)
    time = 0.01 * np.arange(2000)
    phi = 0.5 * np.sin(time)
    noisy = phi + 1e-3 * rng.standard_normal(2000)
    columns = turning(time) | {"phi": noisy, "p": 0.5 * np.cos(time) + 0.02}
    result, _ = Compatibility.of(from_columns("turning", time, columns))
    names = {f"{n}.{kind}" for n in "pqr" for kind in ("bias", "scale")}
    assert set(result.findings) == names | {"attitude.delay"}
    bias = result.findings["p.bias"]
    assert bias.estimate == pytest.approx(0.02, abs=max(4.0 * bias.std_error, 1e-3))
    wrong = from_columns("wrong", time, {**columns, "p": -columns["p"]})
    said = " ".join(map(str, Compatibility.of(wrong)[0].notices))
    assert "inconsistent" in said
    assert "not a calibration" in said


def test_a_delay_beyond_what_pieces_have_to_spare_is_no_number() -> None:
    """The attitude comes 0.8 s late: a clock is wrong, and the estimate is not to be taken for a delay."""
    rng, time = np.random.default_rng(0), 0.01 * np.arange(2000)
    late = 0.5 * np.sin(2.0 * (time - 0.8)) + 0.1 * np.sin(0.5 * (time - 0.8))
    columns = turning(time) | {"phi": late, "p": np.cos(2.0 * time) + 0.05 * np.cos(0.5 * time)}
    noisy = {n: x + 1e-3 * rng.standard_normal(time.size) for n, x in columns.items()}
    flight = from_columns("late", time, noisy)
    result, found = Compatibility.of(flight, [(1.0, 19.0)])
    delay = result.findings["attitude.delay"]
    assert abs(delay.estimate) > 0.3
    assert not delay.identifiable
    assert "clocks" in delay.reason
    assert not any(w.startswith("attitude is late") for w in map(str, result.notices))
    early = corrected_flight(found).column("phi")
    np.testing.assert_allclose(np.std(early - flight.column("phi")), 0.0, atol=0.02)  # it was not shifted


def test_what_hovers_is_in_the_air_at_any_speed() -> None:
    """Rotors that carry it tell that it flies; a speed over ground near zero does not tell that it stands."""
    time = np.arange(800) / 100.0
    still = np.zeros(time.size)
    columns = dict.fromkeys(("p", "q", "r", "phi", "theta", "psi", "ax", "ay", "vn", "ve", "vd"), still)
    columns["az"], motors = still - 9.8, {f"motor_{n}": still + 0.6 for n in range(1, 5)}
    (piece,) = cut_pieces(from_columns("f", time, {**columns, **motors})).pieces
    assert (piece.time[0], piece.time[-1]) == (0.0, time[-1])
    with pytest.raises(FlightError, match="in the air for no 3 s; choose a window"):
        cut_pieces(from_columns("f", time, columns))


def turning(time: np.ndarray) -> dict[str, np.ndarray]:
    still = 0.0 * time
    return dict.fromkeys(("theta", "psi", "q", "r"), still) | {
        "phi": 0.5 * np.sin(time),
        "p": 0.5 * np.cos(time),
    }


@pytest.mark.parametrize("period", [0.5, 4.0, 20.0])
def test_a_slow_record_has_no_piece_of_a_few_samples(period: float) -> None:
    """At 0.05 Hz one sample lasts for longer than the shortest piece."""
    least = PIECES.least * period
    time = period * np.arange(PIECES.least - 1)
    with pytest.raises(FlightError, match=f"no {least:.3g} s without a hole"):
        cut_pieces(from_columns("slow", time, turning(time)), [(0.0, 1e4)])


def test_a_search_ends_when_its_steps_are_used_up_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, time = np.random.default_rng(0), 0.01 * np.arange(1000)
    columns = {name: x + 1e-3 * rng.standard_normal(time.size) for name, x in turning(time).items()}
    flight = from_columns("f", time, columns)
    for steps, codes in ((compatibility.MAX_STEPS, set()), (2, {"channel-weights-not-converged"})):
        monkeypatch.setattr(compatibility, "MAX_STEPS", steps)
        notices = Compatibility.of(flight, [(0.0, 10.0)])[0].notices
        assert {one.code for one in notices} & {"channel-weights-not-converged"} == codes


def test_noise_that_gyros_integrate_does_not_give_vanes_a_place() -> None:
    """Vanes at the center of gravity, 50 Hz, calm air: their place was -0.60 +- 0.12 m, and said to be an error."""
    flown = maneuver(
        60.0, ("elevator", "3-2-1-1", 3, 0.15, 0.08), ("aileron", "doublet", 12, 0.5, 0.1), ("rudder", "2-1-1", 20, 0.4, 0.12),
        ("elevator", "doublet", 28, 0.8, 0.05), ("aileron", "doublet", 38, 0.5, 0.1), ("elevator", "3-2-1-1", 46, 0.2, -0.08),
        ("rudder", "doublet", 53, 0.4, 0.12), airspeed=22.0, wind=[3.0, -2.0, 0.0],
    )  # fmt: skip
    vehicle = load_vehicle(Path(__file__).parents[3] / "examples" / "vtail.toml")
    result, _ = Compatibility.of(simulate_flight(vehicle, flown, seed=0))
    truth = dict.fromkeys(("vane.x", "vane.y", "vane.z", "alpha.delay"), 0.0)
    truth |= {"alpha.scale": 1.0, "beta.scale": 1.0}
    for name, value in truth.items():
        one = result.findings[name]
        assert one.std_error >= one.systematic > 0.0
        assert abs(one.estimate - value) < 3.0 * one.std_error, name
    assert not [n.subject for n in result.notices if n.code == "instrument-error"]


def test_a_residual_in_step_with_an_unknown_may_shift_it_by_its_share() -> None:
    """Of a sine that is about the standard error, of noise in the band of the residuals nearly their share of it."""
    rng, n, share = np.random.default_rng(0), 4000, 0.1

    def in_band() -> np.ndarray:
        noise = lfilter([1.0], [1.0, -1.8 * math.cos(0.3), 0.81], rng.standard_normal(n))
        return np.asarray(noise / np.std(noise))

    residual, sine = share * in_band(), math.sqrt(2.0) * np.sin(0.3 * np.arange(n))
    found = []
    for moved in (sine, in_band()):
        piece = PieceEvidence(residual[:, None], moved[:, None, None])
        own = estimate_uncertainty([piece], np.zeros((1, 1)))
        (shift,) = systematic_shifts([piece], own.information, own.noise, 1)
        found.append((shift, math.sqrt(own.corrected[0, 0])))
    (of_sine, std), (of_noise, small) = found
    assert std <= of_sine < 2.0 * std
    assert 5.0 * small < of_noise < share
