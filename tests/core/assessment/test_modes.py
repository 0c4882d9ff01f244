"""Modes with intervals and frequency responses, of models and as measured, against closed forms and Monte Carlo."""

import math

import numpy as np
import pytest

from stoop import load_vehicle, trim
from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.modes import Linearized, differentiated, mode_estimates, state_equation_estimates
from stoop.results.modes import ModeEstimate
from stoop.simulation.linearize import linear_models, linearize, modes_of


def short_period(w: float, zeta: float, *variances: float) -> ModeEstimate:
    A, by_w, by_zeta = np.zeros((3, 4, 4))
    A[1:3, 1:3] = [[0.0, 1.0], [-(w**2), -2.0 * zeta * w]]
    A[np.ix_([0, 3], [0, 3])] = [[-0.02, -9.81], [0.01, 0.0]]
    by_w[2, 1:3], by_zeta[2, 2] = (-2.0 * w, -2.0 * zeta), -2.0 * w
    linear = Linearized(("V", "alpha", "q", "theta"), A, np.array([by_w, by_zeta]))
    modes = {m.name: m for m in mode_estimates(linear, ("w", "zeta"), np.diag(variances))}
    assert modes["phugoid"].remark == ()
    return next(m for n, m in modes.items() if "short" in n)


def test_an_oscillator_by_hand() -> None:
    mode = short_period(4.0, 0.3, 0.1**2, 0.02**2)
    assert mode.method == "delta"
    assert (mode.frequency.estimate, mode.frequency.std_error) == pytest.approx((4.0, 0.1))
    assert (mode.damping.estimate, mode.damping.std_error) == pytest.approx((0.3, 0.02))
    # real part = -zeta w
    sigma = math.hypot(0.3 * 0.1, 4.0 * 0.02)
    assert (mode.real.estimate, mode.real.std_error) == pytest.approx((-1.2, sigma))
    assert mode.real.ci95_upper == pytest.approx(-1.2 + NORMAL_95 * sigma)
    assert mode.time_constant.ci95_upper == pytest.approx(1.0 / (1.2 - NORMAL_95 * sigma))


def test_derivatives_of_eigenvalues_against_differences() -> None:
    random = np.random.default_rng(0)
    A, slopes = random.standard_normal((6, 6)), random.standard_normal((3, 6, 6))
    found, h = Linearized(tuple("abcdef"), A, slopes), 1e-6
    for mode in modes_of(A, found.names):
        for slope, g in zip(slopes, found.gradient(mode.eigenvalue), strict=True):
            ends = [np.linalg.eigvals(A + sign * h * slope) for sign in (1, -1)]
            upper, lower = (end[np.argmin(np.abs(end - mode.eigenvalue))] for end in ends)
            assert g == pytest.approx((upper - lower) / (2 * h), abs=1e-7)


def test_a_pair_that_may_part_is_sampled() -> None:
    """At a damping of 0.97 +- 0.05 a pair is two real roots in about a quarter of all cases."""
    mode = short_period(4.0, 0.97, 0.05**2, 0.05**2)
    assert mode.method == "sampled"
    assert mode.other_character == pytest.approx(0.274, abs=0.04)  # P(zeta > 1) = P(z > 0.6)
    assert [one.code for one in mode.remark] == ["mode-becomes-real"]
    assert mode.remark[0].values == {"share": mode.other_character}
    assert (mode.damping.ci95_lower, mode.damping.ci95_upper) == pytest.approx((0.872, 1.068), abs=0.015)
    assert (mode.frequency.ci95_lower, mode.frequency.ci95_upper) == pytest.approx((3.902, 4.098), abs=0.03)


def test_a_spiral_that_may_go_either_way_has_no_time_constant() -> None:
    A, slope = np.diag([-5.0, -0.01]), np.zeros((1, 2, 2))
    slope[0, 1, 1] = 1.0
    spiral = mode_estimates(Linearized(("p", "phi"), A, slope), ("x",), np.array([[0.02**2]]))[-1]
    assert (spiral.name, math.isnan(spiral.time_constant.ci95_lower)) == ("spiral", True)
    assert "mode-stability-unknown" in [one.code for one in spiral.remark]
    assert spiral.real.ci95_upper == pytest.approx(-0.01 + NORMAL_95 * 0.02)


def test_what_the_data_cannot_tell_makes_the_mode_unknown() -> None:
    mode = short_period(4.0, 0.3, 0.01, np.inf)
    assert (mode.name, math.isnan(mode.frequency.ci95_lower)) == ("short period", True)
    (remark,) = mode.remark
    assert (remark.code, remark.values["parameters"]) == ("mode-depends-on-unknown", ("zeta",))


TWIN = load_vehicle("twin-boom")
FREE = ("CL0", "CLalpha", "CD0", "Cmalpha", "Cmq", "Clp", "Clbeta", "Cnbeta", "Cnr", "mass.inertia.yy")
VALUES = {name: TWIN.value(name) for name in FREE}


def of_aircraft() -> Linearized:
    scales = {name: abs(value) for name, value in VALUES.items()}
    return differentiated(TWIN, trim(TWIN, 36.0).neighbors(), VALUES, scales)


def trimmed(numbers: dict[str, float]) -> tuple[tuple[str, ...], np.ndarray]:
    vehicle = TWIN.with_numbers({name: {"value": value} for name, value in numbers.items()})
    names, A, *_ = linear_models(vehicle, trim(vehicle, 36.0).lanes(vehicle))
    return names, A[0]


def test_derivatives_of_the_matrix_against_trims_done_again() -> None:
    found = of_aircraft()
    for (name, value), derivative in zip(VALUES.items(), found.derivative, strict=True):
        step = 1e-4 * abs(value)
        (names, upper), (_, lower) = (trimmed({name: x}) for x in (value + step, value - step))
        kept = [names.index(n) for n in found.names]
        expected = (upper - lower)[np.ix_(kept, kept)] / (2.0 * step)
        np.testing.assert_allclose(derivative, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def test_intervals_against_a_monte_carlo_that_trims_every_draw() -> None:
    sigma = np.array([0.03 * abs(v) for v in VALUES.values()])
    covariance = (0.5 * np.ones((len(sigma), len(sigma))) + 0.5 * np.eye(len(sigma))) * np.outer(sigma, sigma)
    estimates = {m.name: m for m in mode_estimates(of_aircraft(), FREE, covariance)}
    draws = np.random.default_rng(1).multivariate_normal(list(VALUES.values()), covariance, 250)
    flown: dict[str, list[complex]] = {}
    for draw in draws:
        names, A = trimmed(dict(zip(VALUES, map(float, draw), strict=True)))
        for mode in modes_of(A, names):
            flown.setdefault(mode.name, []).append(mode.eigenvalue)
    for name in ("short period", "phugoid", "Dutch roll", "roll", "spiral"):
        s, one = np.array(flown[name]), estimates[name]
        assert len(s) == len(draws)
        assert one.real.std_error == pytest.approx(np.std(s.real), rel=0.15), name
        assert 0.91 <= np.mean((one.real.ci95_lower < s.real) & (s.real < one.real.ci95_upper)) <= 0.99, name
        if s[0].imag:
            assert one.frequency.std_error == pytest.approx(np.std(np.abs(s)), rel=0.15), name
            assert one.damping.std_error == pytest.approx(np.std(-s.real / np.abs(s)), rel=0.15), name


def test_dimensional_derivatives_are_those_of_the_textbook_with_their_errors() -> None:
    """d q'/d elevator = qbar S c Cmelevator / Iyy (no Ixy, Iyz): its variance is that of a quotient, to first order."""
    vehicle = load_vehicle("twin-boom").reduced("full")
    point, errors = trim(vehicle, 35.0, 200.0), np.array([0.02, 0.1, 0.01, np.inf])
    values = {n: vehicle.value(n) for n in ("Cmelevator", "mass.inertia.yy", "Clp", "Cnbeta")}
    model, scales = linearize(vehicle, point), {n: abs(x) for n, x in values.items()}
    linear = differentiated(vehicle, point.neighbors(), values, scales)
    found = state_equation_estimates(linear, model.inputs, np.diag(errors**2))
    rows, columns = found.states.index, found.inputs.index
    B = model.B[[model.states.index(n) for n in found.states]]
    np.testing.assert_allclose(found.B, B, rtol=1e-12, atol=1e-15)
    n, inertia = vehicle.value, vehicle.value("mass.inertia.yy")
    moment = 0.5 * n("environment.density") * 35.0**2 * n("reference.area") * n("reference.chord") / inertia
    expected = moment * math.hypot(errors[0], values["Cmelevator"] * errors[1] / inertia)
    assert found.B_std[rows("q")][columns("elevator")] == pytest.approx(expected, rel=1e-4)
    assert found.A_std[rows("p")][rows("p")] > 0.0
    assert found.A_std[rows("theta")][rows("q")] < 1e-6, "kinematics have no error"
    assert math.isnan(found.A_std[rows("r")][rows("beta")]), "Cnbeta is unknown"
    assert math.isfinite(found.A_std[rows("q")][rows("alpha")])
