"""Regressions of a whole vehicle: exact without noise, honest with noise; their bootstrap and PRESS."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.fits import fit_by, posed
from scipy.signal import lfilter

from stoop import Flight, Options, Vehicle, load_vehicle
from stoop.assessment.bootstrap import Bootstrap, bootstrap_plan, refit_chunk
from stoop.assessment.covariance import data_information, standard_errors
from stoop.assessment.error_bars import ErrorBars, estimate_uncertainty
from stoop.assessment.goodness_of_fit import left_out_residuals, press_notices
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.regression import least_squares as ls
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import FrequencyDomain, Priors, Rows, TimeDomain, solve
from stoop.estimate.regression.method import (
    LinearProblem,
    RegressionEstimate,
    equation_error,
    frequency_domain,
)
from stoop.parallel import Given
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, unknowns_of
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window

WINDOW, DOMAINS = [Window("noisy", 0.0, 25.0)], [TimeDomain(), FrequencyDomain(0.04, 1.5)]
FREE = Priors(np.zeros(3), np.full(3, np.inf))
NAMES = ("CLalpha", "Cmalpha", "Cmq", "Clp", "Cnbeta", "Cmelevator", "Claileron")


def regressed(vehicle: Vehicle, flight: Flight, domain: ls.Domain) -> tuple[AircraftEquations, ls.Estimates]:
    problem = posed(vehicle, flight)
    equations = AircraftEquations.of(problem.layout, problem.pieces)
    found = equations.estimate(domain)
    assert found is not None
    return equations, found


@pytest.mark.parametrize("domain", DOMAINS)
def test_every_term_is_found_without_noise(full: Vehicle, clean: Flight, domain: ls.Domain) -> None:
    equations, found = regressed(full, clean, domain)
    for place, value in zip(equations.places, found.values, strict=True):
        p = equations.layout.parameters[place]
        assert value == pytest.approx(p.value, rel=3e-3, abs=2e-3), p.name


def test_a_tie_joins_two_coefficients(full: Vehicle) -> None:
    """One number in two equations: the joint fit weighs both by their residuals."""
    rng = np.random.default_rng(0)
    x, X = rng.standard_normal((200, 2)), np.zeros((2, 200, 3))
    X[0, :, 0], X[0, :, 1] = x[:, 0], x[:, 1]
    X[1, :, 0], X[1, :, 2] = x[:, 1], x[:, 0]
    truth, noise = np.array([2.0, -1.0, 0.5]), rng.standard_normal((2, 200)) * [[0.01], [1.0]]
    blocks = [Rows(c, X[i] @ truth + noise[i], X[i], 0.02) for i, c in enumerate("ab")]
    solved = solve(blocks, FREE)
    assert (np.abs(solved.values - truth) < 5.0 * np.sqrt(np.diag(solved.covariance))).all()
    assert np.sqrt(solved.covariance[0, 0]) < 0.001  # the quiet equation rules
    whole = np.concatenate([X[i] / solved.sigma[c] for i, c in enumerate("ab")])
    y = np.concatenate([b.y / solved.sigma[b.equation] for b in blocks])
    np.testing.assert_allclose(solved.values, np.linalg.lstsq(whole, y, rcond=None)[0], rtol=1e-4)


def test_priors_pull_and_bounds_hold() -> None:
    rng = np.random.default_rng(1)
    X = rng.standard_normal((100, 3))
    y = X @ [1.0, 2.0, 3.0] + 0.5 * rng.standard_normal(100)
    tight = Priors(np.array([5.0, 0.0, 0.0]), np.array([1e-6, np.inf, np.inf]))
    assert solve([Rows("a", y, X, 0.02)], tight).values[0] == pytest.approx(5.0, abs=1e-4)
    boxed = replace(FREE, lower=np.zeros(3), upper=np.array([9.0, 9.0, 2.0]))
    assert solve([Rows("a", y, X, 0.02)], boxed).values[2] == pytest.approx(2.0)


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-7])
def test_what_no_row_tells_apart_has_no_error_bar(apart: float) -> None:
    """A loop that ties elevator to angle of attack: their sum is told, neither of them; the numbers stay near the file's."""
    rng = np.random.default_rng(0)
    x, other, off = rng.standard_normal((3, 400))
    X = np.column_stack([x, 2.0 * x + apart * off, other])
    solved = solve([Rows("Cm", X @ [1.0, 0.5, 1.0] + 0.1 * rng.standard_normal(400), X, 0.02)], FREE)
    assert np.isnan(np.diag(solved.covariance)).tolist() == [True, True, False]
    assert solved.values[0] + 2.0 * solved.values[1] == pytest.approx(2.0, abs=0.05)
    assert np.abs(solved.values).max() < 2.0


@pytest.mark.parametrize(
    ("domain", "memory"),
    [(FrequencyDomain(0.1, 5.0), 0.0), (TimeDomain(0.06), 0.0), (TimeDomain(0.06), 0.2), (TimeDomain(0.2), 2.0)],
)  # fmt: skip
def test_error_bars_are_the_scatter(domain: ls.Domain, memory: float) -> None:
    """150 records of white noise, or noise with a memory in s, on the measured side: claimed, and drawn, over achieved.

    The constant and the slow regressor take up the slow part of the noise, the others the fast one: a correction that knows
    no lag beyond 2 s claims a third of the scatter of the former and twice that of the latter.
    """
    rng, dt, truth = np.random.default_rng(3), 0.02, np.array([0.3, 1.0, -2.0, 0.5])
    t = dt * np.arange(2000)
    fast = np.sin(2.0 * t) + np.sin(7.1 * t), np.cos(0.9 * t) * np.sin(3.0 * t)
    X = np.column_stack([np.ones(2000), *fast, np.sin(0.4 * t)])
    X = X if domain.keeps_constants else X[:, 1:]
    truth, k = truth[-X.shape[1] :], X.shape[1]
    rho, none, white = np.exp(-dt / memory) if memory else 0.0, np.zeros((k, k)), not domain.colored
    free, names = Priors(np.zeros(k), np.full(k, np.inf)), ("CL0", "CLalpha", "Cm0", "Cmalpha")[-k:]
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    own = vehicle.with_numbers({p.name: {"free": p.name in names} for p in vehicle.parameters})
    misfit = Misfit(Layout.of(own, ()), (), Weights.of(np.ones(len(own.outputs))), ())
    errors, claimed, drawn = [], [], []
    for record in range(150):
        v = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(6000))[4000:]
        v += 0.3 * rng.standard_normal(2000)
        both = domain.rows(np.column_stack([X @ truth + v, X]), dt)
        solved = solve([Rows("a", both[:, 0], both[:, 1:], dt)], free)
        found = estimate_uncertainty(solved.evidence, none, white=white)
        errors.append(solved.values - truth)
        claimed.append(standard_errors(found.corrected))
        if record % 5 == 0:
            z = (solved.values - misfit.layout.lower) / misfit.layout.width
            evidence = Evidence(unknowns_of(misfit.layout, z, range(k)), solved.evidence, none, white=white)
            linear = LinearProblem.of(misfit, z, evidence, solved.sigma, domain.period(dt), False)
            outcome: Any = None
            fit = RegressionEstimate(misfit, Prepared((), ()), z, outcome, 0.0, 0.0, (), evidence, linear)
            runs = bootstrap_plan(fit, ErrorBars.of(fit), record, 50).runs
            values = [refit_chunk(run.arguments, [None])[0]["values"] for run in runs]  # type: ignore[call-overload, index]
            drawn.append(np.std(np.concatenate(values), axis=0, ddof=1))
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (np.abs(np.mean(claimed, axis=0) / scatter - 1.0) < 0.2).all()
    assert (np.abs(np.mean(drawn, axis=0) / scatter - 1.0) < 0.25).all()


@pytest.mark.parametrize("domain", DOMAINS)
def test_its_evidence_gives_its_covariance(full: Vehicle, noisy: Flight, domain: ls.Domain) -> None:
    """Information from whitened regressors: the covariance for white residuals, constants included."""
    _, found = regressed(full, noisy, domain)
    information = data_information(found.evidence)
    np.testing.assert_allclose(np.linalg.inv(information), found.covariance, rtol=1e-5, atol=1e-12)
    variances = np.nanvar(np.concatenate([piece.residual for piece in found.evidence]), axis=0)
    np.testing.assert_allclose(variances, 1.0, atol=0.2)


@pytest.mark.parametrize("method", [equation_error, frequency_domain])
def test_methods_of_identify(full: Vehicle, noisy: Flight, method: Callable[..., RegressionEstimate]) -> None:
    """With a held term, a number that is no term, and a control that stands still, which makes one with the constant."""
    still = replace(noisy, data=noisy.data.assign(elevator=0.0 * noisy.data["elevator"] - 0.05))
    changes = {"mass.inertia.yy": {"free": True, "prior": 10.0}, "Clr": {"free": False}}
    found = method(full.with_numbers(changes), {"noisy": still}, WINDOW, Options())
    bars = ErrorBars.of(found)
    for name in ("Cmelevator", "Cm0"):
        one = bars.identifiability[name]
        assert (one.identifiable, getattr(one.reason, "code", "")) == (False, "not-seen")
    std = dict(zip(found.estimates, bars.std, strict=False))
    for name in ("CLalpha", "Clp", "Cnbeta", "Claileron"):
        assert bars.identifiability[name].identifiable
        assert abs(found.estimates[name] - full.value(name)) < 5.0 * std[name] + 0.03 * abs(full.value(name))
    assert not {"Clr", "mass.inertia.yy"} & set(found.estimates)
    assert any("mass.inertia.yy" in str(n) for n in found.notices)
    # a band takes residuals as white: that is an assumption and no finding
    told = np.isfinite(bars.std) & (bars.std > 0.0)
    assert np.isfinite(bars.cramer_rao_std[told]).all() == (method is equation_error)
    blind = replace(noisy, data=noisy.data.drop_vars("alpha"))
    with pytest.raises(IdentificationError, match="no regression is possible"):
        method(full, {"noisy": blind}, WINDOW, Options())


@pytest.fixture(scope="module", params=["equation-error", "frequency-domain"])
def fit(request: pytest.FixtureRequest, full: Vehicle, noisy: Flight) -> Estimate:
    return fit_by(request.param, full.with_numbers({"CLalpha": {"prior": 0.5}}), {"noisy": noisy}, WINDOW)


def test_the_bootstrap_agrees_with_the_corrected_errors(fit: Estimate) -> None:
    found = Bootstrap(300, Given(ThreadPoolExecutor(1)))(fit, ErrorBars.of(fit), 0, lambda _: None).intervals
    std = dict(zip(fit.estimates, ErrorBars.of(fit).std, strict=False))
    ratios = [found.parameters[name].std_error / std[name] for name in NAMES]
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15)
    assert found.figures == {"replicates": 300.0, "refined": 0.0, "failed": 0.0}


def test_press_is_the_error_of_refits_without_each_second(fit: Estimate) -> None:
    """Done again from the whitened rows and the priors by a general solver, every row of a second left out."""
    (found,) = press_notices(fit)
    problem = fit.refit_problem
    assert isinstance(problem, LinearProblem)
    assert left_out_residuals(fit) is None  # of channels it has none
    free, missed = fit.evidence.free, []
    stated = np.flatnonzero(np.diag(fit.evidence.prior)[free])
    priors = np.diag(np.sqrt(np.diag(fit.evidence.prior)))[free][:, free][stated]
    block = round(1.0 / problem.dt) if np.isfinite(problem.dt) else 1
    (e, J), *means = [(s.residual, s.jacobian[:, :, free]) for s in problem.stretches]
    others = [(r.ravel(), j.reshape(-1, len(free))) for r, j in means]
    for first in range(0, len(e), block):
        kept = ~np.isin(np.arange(len(e)), range(first, first + block))
        A = np.concatenate([J[kept].reshape(-1, len(free)), *(j for _, j in others), priors])
        y = np.concatenate([e[kept].ravel(), *(r for r, _ in others), np.zeros(len(priors))])
        size = np.linalg.norm(A, axis=0)
        missed.append(e[~kept] - J[~kept] @ (np.linalg.lstsq(A / size, y, rcond=None)[0] / size))
    # the estimates are the optimum of the old weights: what is left of the gradient is the naive refit's alone
    naive = np.sqrt(np.mean(np.concatenate(missed) ** 2, axis=0)) * list(problem.deviations.values())
    assert found.values["press"] == pytest.approx(naive.tolist(), rel=1e-3)
    assert found.values["equations"] == ("CL", "CD", "CQ", "Cl", "Cm", "Cn")
    assert all(p > r for p, r in zip(found.values["press"], found.values["rms"], strict=True))  # type: ignore[arg-type]
