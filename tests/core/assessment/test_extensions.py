"""Score tests of extensions against simulations and known truth, by each method; error bars hold what the model lacks."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from helpers.flown import maneuver
from numpy.testing import assert_allclose
from scipy.optimize import minimize

import stoop
from stoop import Flight, Options, Vehicle, load_vehicle, simulate_flight
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import Limits, extension_notices, extension_tests, scored
from stoop.assessment.model_error import LEVEL, lacks_nothing, model_error, variances
from stoop.base.arrays import FloatArray
from stoop.estimate import multiple_shooting
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import OutputErrorEstimate, fit
from stoop.estimate.response import simulation_responses
from stoop.problem.misfit import Misfit
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTests
from stoop.strategy import decision
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import catalogue

DURATION = 9.0
STEPS = {
    "pitch": maneuver(DURATION, ("elevator", "3-2-1-1", 1.0, 0.3, 0.12)),
    "roll": maneuver(DURATION, ("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
}
FORCES, WINDOWS = ("CL", "CD", "CQ"), [Window(name, 0.0, DURATION) for name in STEPS]


def flights(truth: Vehicle, seed: int = 5) -> dict[str, Flight]:
    return {n: simulate_flight(truth, m, seed=seed + k, name=n) for k, (n, m) in enumerate(STEPS.items())}


@functools.cache
def fitted(lag: float) -> Estimate:
    base = load_vehicle("twin-boom")
    truth = with_entries(base, {("controls", "aileron", "lag"): lag}) if lag else base
    return fit(base, flights(truth), WINDOWS, Options(seed=1))


def simulated(problem: Misfit, z: FloatArray, vehicle: Vehicle, index: int) -> FloatArray:
    layout = problem.layout
    found = zip(layout.parameters, layout.physical(z[None])[0].tolist(), strict=True)
    changed = replace(layout, vehicle=vehicle.with_numbers({p.name: {"value": v} for p, v in found}))
    return replace(problem, layout=replace(changed, parameters=layout.parameters)).outputs(z, index)


@pytest.mark.parametrize(
    "name",
    [
        "controls.aileron.delay", "Clalphabeta", "sensors.p.scale", "sensors.accelerometer_position.x",
        "controls.rudder.dead_zone", "controls.rudder.rate_limit",
    ],
)  # fmt: skip
def test_responses_are_those_of_simulations(name: str) -> None:
    done = fitted(0.0)
    found = simulation_responses(done.problem, done.z)
    (j, one), index = next((j, e) for j, e in enumerate(found.extensions) if e.name == name), 1
    vehicle = with_entries(done.problem.layout.vehicle, one.entries(one.value(one.step)))
    before, after = done.problem.outputs(done.z, index), simulated(done.problem, done.z, vehicle, index)
    wanted = done.problem.weights.whiten((after - before) / one.step, np.ones(before.shape, dtype=bool))
    assert np.linalg.norm(found.pieces[index][:, :, j] - wanted) / np.linalg.norm(wanted) < 0.05


def test_right_model_lacks_nothing_and_keeps_its_error_bars() -> None:
    done = fitted(0.0)
    bars, (decided, _) = ErrorBars.of(done), decision.test(done, ())
    found, known = extension_tests(done, bars), scored(done, bars)
    assert (found.tested > 80, found.level, found.found) == (True, Limits.level, ())
    assert extension_notices(found) == ()
    assert known is not None
    assert not model_error(known, {}).any()
    assert np.array_equal(decided.bars.std, bars.std)
    assert not decided.notices


def test_missing_lag_is_named_with_its_value_and_what_it_would_move() -> None:
    done = fitted(0.04)
    found = extension_tests(done, ErrorBars.of(done))
    best = found.found[0]
    assert (best.name, best.rivals[:1]) == ("controls.aileron.lag", ("controls.aileron.delay",))
    assert best.value == pytest.approx(0.04, rel=0.25)
    assert {"Clp", "Claileron"} <= set(best.moves)
    assert all(abs(one.beside) < 5.0 for one in found.found[1:])
    (one,) = extension_notices(found)
    assert (one.code, one.subject, one.values["line"]) == ("model-lacks-one-of", best.name, best.line)


def test_what_priors_alone_say_of_the_mass_is_no_contradiction(monkeypatch: pytest.MonkeyPatch) -> None:
    """All forces over the mass are what a flight shows: wrong guesses of the coefficients are not an error of the scales."""
    base = load_vehicle("twin-boom")
    guesses = {
        p.name: {"free": True, "prior": 0.03 * abs(p.value), "mean": p.value * (1.3 if p.name[:2] in FORCES else 1.0)}
        for p in base.parameters if p.free and p.value
    }  # fmt: skip
    done = fit(base.with_numbers(guesses), flights(base), WINDOWS, Options(seed=1))
    for largest, named in ((Limits.max_prior, False), (np.inf, True)):
        monkeypatch.setattr(Limits, "max_prior", largest)
        assert ("mass.mass" in [one.name for one in extension_tests(done, ErrorBars.of(done)).found]) == named


def test_what_is_known_of_a_held_number_does_not_contradict_it() -> None:
    """Within two standard deviations of its prior; without one any change does."""
    name, vehicle = "mass.inertia.zz", load_vehicle("quad-x")
    value = vehicle.value(name)
    for prior, contradicts in ((None, True), (0.2 * value, True), (0.5 * value, False)):
        held = vehicle.with_numbers({name: {"prior": prior, "free": False}})
        (number,) = (one for one in catalogue(held) if one.name == name)
        assert (number.believes(0.6 * value), number.believes(-0.6 * value)) == (contradicts, contradicts)


SECONDS = 16.0
INPUTS = (
    ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 4.5, 2.0, 2.5), ("east", "doublet", 5.0, 2.0, 2.5),
    ("down", "doublet", 5.5, 2.0, 1.0), ("roll", "doublet", 11.0, 0.15, 8.0), ("pitch", "doublet", 12.0, 0.15, 8.0),
    ("yaw", "doublet", 13.0, 0.4, 1.5), ("heave", "3-2-1-1", 14.0, 0.25, 2.0),
)  # fmt: skip
TEXT = load_vehicle("quad-x").text
FORWARD = TEXT + "\n[sensors]\naccelerometer_position = [0.05, 0.0, 0.0]\n"
DEFECTS = {
    "mass.mass": (TEXT, TEXT.replace("mass = 1.5\n", "mass = 1.8\n"), 1.5),
    "mass.inertia.xx": (TEXT, TEXT.replace("xx = 0.0291", "xx = 0.0437"), 0.0291),
    "rotors.lag": (TEXT, TEXT.replace("lag = 0.05\n", ""), 0.05),
    "sensors.accelerometer_position.x": (FORWARD, TEXT, 0.05),
    "rotor.m1.factor": (TEXT.replace("[rotor.m1]", "[rotor.m1]\nfactor = 0.9"), TEXT, 0.9),
    "body_drag.quadratic.x": (TEXT, TEXT[: TEXT.index("[body_drag]")], 0.02),
}  #: extension -> the file of the truth, the file of the fit, the true value


def multirotor(truth: str, fitted: str, seed: int) -> Estimate:
    flown = maneuver(SECONDS, *INPUTS, rate=100.0, wind=(2.0, -1.0, 0.0))
    flight = simulate_flight(parse_vehicle(truth, "truth"), flown, seed=seed, name="sim")
    windows = [Window("sim", 0.0, SECONDS)]
    return multiple_shooting.fit(parse_vehicle(fitted, "quad"), {"sim": flight}, windows, Options(seed=1))


def lacking(truth: str, fitted: str, seed: int) -> ExtensionTests:
    done = multirotor(truth, fitted, seed)
    return extension_tests(done, ErrorBars.of(done))


def test_what_a_wrong_held_inertia_explains_the_model_does_not_lack() -> None:
    done, name = multirotor(TEXT, TEXT.replace("xx = 0.0291", "xx = 0.0320"), 1), "mass.inertia.xx"
    known = scored(done, ErrorBars.of(done))
    assert known is not None
    lacks = [model_error(known, held).any() for held in ({}, {name: 0.003}, {name: 1e-6})]
    assert lacks == [True, False, True]


@pytest.mark.parametrize("seed", [1, 2])
def test_right_quadrotor_lacks_nothing(seed: int) -> None:
    found = lacking(TEXT, TEXT, seed)
    assert (found.tested > 30, found.found) == (True, ())


@pytest.mark.parametrize("name", DEFECTS)
def test_defect_of_a_quadrotor_is_named(name: str) -> None:
    truth, fitted, value = DEFECTS[name]
    found = lacking(truth, fitted, 1)
    best = found.found[0]
    assert name in (best.name, *best.rivals)
    (one,) = (e for e in found.found if e.name == name)
    # a large change is more than one linear step
    assert one.value == pytest.approx(value, rel=0.5)


def test_variances_of_extensions_that_share_nothing() -> None:
    """Each is what its score exceeds its noise by, or zero: the maximum of the evidence of one number."""
    z, G, S = np.array([5.0, -0.5, 20.0]), np.diag([2.0, 1.0, 4.0]), np.diag([4.0, 1.0, 9.0])
    expected = np.maximum(z**2 - np.diag(S), 0.0) / np.diag(G) ** 2
    assert variances(z, G, S) == pytest.approx(expected, rel=1e-2, abs=1e-6)


def test_variances_of_greatest_evidence() -> None:
    rng = np.random.default_rng(4)
    V = rng.standard_normal((60, 5)) + 1.5 * rng.standard_normal((60, 1))
    G = V.T @ V
    S, z = G.copy(), G @ np.array([0.0, 0.6, 0.0, -0.8, 0.0]) + np.linalg.cholesky(G) @ rng.standard_normal(5)

    def deviance(tau: np.ndarray) -> float:
        C = S + G @ np.diag(tau) @ G
        return float(np.linalg.slogdet(C)[1] + z @ np.linalg.solve(C, z))

    found = variances(z, G, S)
    others = [minimize(deviance, z, bounds=[(0.0, None)] * 5).fun for z in (np.full(5, 0.1), np.eye(5)[1])]
    assert deviance(found) < min(others) + 0.05


def test_scores_of_noise_are_significant_as_often_as_stated() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((40, 12)) @ rng.standard_normal((12, 40)) + 3.0 * rng.standard_normal((40, 40))
    S = root @ root.T
    std = np.sqrt(np.diag(S))
    draws = (rng.standard_normal((2000, 40)) @ root.T) / std
    share = np.mean([not lacks_nothing(one, S / np.outer(std, std)) for one in draws])
    assert 0.6 * LEVEL < share < 2.0 * LEVEL


def test_a_lag_that_is_lacking_widens_what_it_moves() -> None:
    """Roll damping and aileron are off by more than their error bars, and not by those that hold what is lacking."""
    done, right = fitted(0.04), fitted(0.0)
    bars, (found, _) = ErrorBars.of(done), decision.test(done, ())
    names = [p.name for p in done.problem.layout.parameters]
    (said,) = (one for one in found.notices if one.code == "bars-widened")
    for name in ("Clp", "Claileron"):
        i = names.index(name)
        assert 3.0 * bars.std[i] < abs(done.estimates[name] - right.estimates[name]) < 3.0 * found.bars.std[i]
        assert any(text.startswith(name) for text in said.values["most"])
    assert np.all(found.bars.std >= bars.std)
    parts = found.bars.part("model") - bars.part("model")
    assert_allclose(
        found.bars.covariance - bars.covariance, parts, rtol=1e-6, atol=1e-12 * np.abs(parts).max()
    )
    assert np.linalg.matrix_rank(parts[: len(names), : len(names)]) < len(names)  # it moves them together


@pytest.fixture(scope="module")
def pitch(wrong: Vehicle, flight: Flight) -> OutputErrorEstimate:
    return fit(wrong, {"sim": flight}, [Window("sim", 0.0, 12.0)], Options())


def test_another_weighting_counts_as_far_as_priors_allow(pitch: OutputErrorEstimate) -> None:
    """The prior alone says by how much an estimate is off: its variance and the square of the distance from its mean."""
    apart = np.random.default_rng(3).normal(0.0, 2.0, len(pitch.z))
    alone, both = (ErrorBars.of(replace(pitch, by_white=pitch.z + move)) for move in (0.0 * apart, apart))
    layout, free = pitch.problem.layout, both.free
    means = [0.0] * layout.dimension + [n.center for n in layout.nuisances]
    limits = [np.hypot(u.prior, u.estimate - m) for u, m in zip(pitch.unknowns, means, strict=True)]
    difference, own = both.apart, np.ix_(free, free)
    assert_allclose(
        np.abs(difference), np.abs(layout.scales * apart)[free], rtol=0.01
    )  # far more than chance explains
    moved = difference / np.hypot(1.0, difference / np.array(limits)[free])  # no parameter has a prior
    assert np.any(np.abs(moved) < 0.7 * np.abs(difference))
    added = both.covariance[own] - alone.covariance[own]
    assert_allclose(added, np.outer(moved, moved), rtol=1e-6, atol=1e-9 * np.abs(added).max())


def test_a_parameter_at_its_bound_makes_others_lean(wrong: Vehicle, flight: Flight) -> None:
    """CL0 held far from the truth: CLalpha takes its place, with an error bar that is only conditional."""
    job = stoop.fit(wrong.with_numbers({"CL0": {"value": 0.3, "bounds": (0.2, 0.35)}}), flight, ["0:12"])
    bars = ErrorBars.of(job.estimate)
    assert bars.at_bound[[p.name for p in job.estimate.problem.layout.parameters].index("CL0")]
    assert "CLalpha" in bars.conditional
    held = job.result.parameters["CL0"]
    assert (held.at_bound, np.isnan(held.std_error)) == (True, True)
    assert any("CLalpha" in w and "Known only if CL0" in w for w in job.result.warnings)
