"""Propagated figures against closed forms and one draw at a time: expressions, hover, trims, limits, what rests on priors."""

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core.assessment.test_agreement import result
from scipy.stats import kstest, truncnorm

from stoop import Vehicle, load_vehicle, trim
from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.notices import notice
from stoop.errors import SimulationError, StoopError
from stoop.results import uncertainty as of
from stoop.results.result import Covariance, ParameterEstimate, Result
from stoop.simulation import linearize
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import parse_vehicle
from stoop_analysis.draws import Draws, draws_of, from_covariance, truncated_normal
from stoop_analysis.propagation.expressions import parse_expressions
from stoop_analysis.propagation.propagation import Propagation, propagate_draws
from stoop_analysis.propagation.quantities import conditional_draws, figure
from stoop_analysis.propagation.wing_figures import Domain
from stoop_analysis.propagation.wings import (
    level_flight,
    lift_maximum,
    linear_flights,
    static_margin,
    steady_flights,
)
from stoop_analysis.report.propagation import shown

DENSITY = 1.20165
DOMAIN = Domain((33.0, 37.0), 35.0, 200.0, DENSITY, (0.0, 0.2))
WEIGHT, HOVER = 1.5 * 9.80665, Domain((0.0, 6.0), 0.0, 0.0, SEA_LEVEL_DENSITY, speeds=(0.1, 3.0))
GRAVITY, LEVEL = 9.80665, Domain((30.0, 40.0), 35.0, 200.0, DENSITY, (-0.1, 0.2))


def test_a_linear_expression_has_the_error_of_the_delta_method(aircraft: Vehicle) -> None:
    names, covariance = ("CLalpha", "CD0"), np.array([[0.04, -0.001], [-0.001, 0.0001]])
    values = np.random.default_rng(0).multivariate_normal([4.78, 0.06], covariance, 20_000)
    one = parse_expressions({"sum": "2*CLalpha - 30*CD0 + mass.inertia.yy/60"}, aircraft)["sum"]
    drawn = aircraft.parameter_rows(dict(zip(names, values.T, strict=True)), len(values))
    found = figure("Expressions", one.samples(np.hstack([aircraft.parameter_rows(), drawn])), names, values)
    gradient = np.array([2.0, -30.0])
    std = float(np.sqrt(gradient @ covariance @ gradient))
    assert found.estimate == pytest.approx(2 * 4.78 - 30 * 0.06 + 2.0)
    assert found.std_error == pytest.approx(std, rel=0.02)
    assert found.ci95_upper - found.ci95_lower == pytest.approx(2 * 1.96 * std, rel=0.03)
    assert found.sources[0][0] in names


def test_a_value_that_does_not_exist_is_counted(aircraft: Vehicle) -> None:
    values = np.array([[0.0], [1.0]] * 20)
    found = propagate_draws(aircraft, Draws(("CDV",), values, "covariance"), DOMAIN, {"inverse": "1/CDV"})
    assert found["inverse"].failed == 0.5
    (told,) = (n for n in found.notices if n.code == "propagate-figure-failed")
    assert told.values == {"figures": "inverse", "share": 0.5}


def test_bad_expressions_are_refused_in_one_line(aircraft: Vehicle) -> None:
    for text, message in (
        ("CLalphaa/CD0", "no number 'CLalphaa'; did you mean CLalpha"),
        ("mass.inertia.x", "no number 'mass.inertia.x'; did you mean mass.inertia"),
        ("__import__('os')", "there is no function __import__"), ("CD0.real", "has no number 'CD0.real'"),
        ("CD0 +", "cannot read the term"), ("CD0**CL0", "not allowed"), ("[CD0]", "not allowed"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match="expression x") as caught:
            parse_expressions({"x": text}, aircraft)
        assert message in str(caught.value), text
    found = parse_expressions({"x": "1e2*mass.mass + abs(Cmq)^2"}, aircraft)["x"]
    assert found.values(aircraft.parameter_rows()) == pytest.approx(100 * 189.40 + 47.6**2)


@pytest.fixture(scope="module")
def found() -> Propagation:
    rng = np.random.default_rng(0)
    draws = Draws(("mass.mass",), rng.normal(1.5, 0.03, (400, 1)), "covariance")
    return propagate_draws(load_vehicle("quad-x"), draws, HOVER)


def throttle(weight: float) -> float:
    """Return the root of T1 x + T2 x^2 = weight / 4 of a rotor."""
    return (-2.5 + math.sqrt(2.5**2 + 4.0 * 6.0 * weight / 4.0)) / 12.0


def test_hover_by_hand(found: Propagation) -> None:
    """Roll: two rotors at full command, two as far below hover, an arm of 0.177 m."""
    one, ratio = found["hover throttle"], found["thrust over weight at full command"]
    assert one.estimate == pytest.approx(throttle(WEIGHT), rel=1e-4)
    slope = (throttle(1.01 * WEIGHT) - throttle(0.99 * WEIGHT)) / 0.03  # per kg
    assert one.std_error == pytest.approx(slope * 0.03, rel=0.12)
    assert one.sources[0] == ("mass.mass", pytest.approx(1.0, abs=0.01))
    assert ratio.estimate == pytest.approx(4.0 * 8.5 / WEIGHT, rel=1e-3)
    assert ratio.ci95_upper - ratio.estimate > ratio.estimate - ratio.ci95_lower, "one over the mass"
    x = throttle(WEIGHT)
    room = min(1.0 - x, x)
    thrust = [2.5 * y + 6.0 * y * y for y in (x + room, x - room)]
    expected = 2.0 * 0.177 * (thrust[0] - thrust[1]) / 0.0291
    assert found["roll acceleration from hover"].estimate == pytest.approx(expected, rel=1e-3)


def test_what_does_not_hover_is_counted_or_an_error() -> None:
    values = np.concatenate([np.full((50, 1), 1.5), np.full((50, 1), 9.0)])
    draws = Draws(("mass.mass",), values, "covariance")
    found = propagate_draws(load_vehicle("quad-x"), draws, HOVER)
    assert found["hover throttle"].failed == 0.5
    assert "propagate-no-hover" in [n.code for n in found.notices]
    heavy = load_vehicle("quad-x").with_numbers({"mass.mass": {"value": 9.0}})
    with pytest.raises(SimulationError, match="too heavy to hover"):
        propagate_draws(heavy, draws, HOVER)


def test_forward_flight_is_that_of_trim_and_speeds_faster_than_flown_are_marked(found: Propagation) -> None:
    theta = next(c for c in found.curves if c.name == "theta")
    alone = trim(load_vehicle("quad-x"), altitude=0.0, velocity=(6.0, 0.0, 0.0))
    assert theta.estimate[-1] == pytest.approx(alone.start["theta"], abs=1e-6)
    told = next(n for n in found.notices if n.code == "propagate-faster-than-flown")
    ((low, high),) = found.extrapolated
    assert dict(told.values) | {"low": low, "high": high, "flown": 3.0} == told.values
    assert (3.5 < low < 4.0, high) == (True, 6.0)


CRUISE = Domain((34.0, 36.0), 35.0, 200.0, DENSITY, (0.0, 0.2))
#: a rudder that never moves determines no sum's parts
UNKNOWN = ("CQ0", "Cl0", "Cn0", "CQrudder", "Clrudder", "Cnrudder")
KNOWN, SINGLES = ("CLalpha", "Cmelevator", "Cmalpha"), 60

WHOLE = load_vehicle("twin-boom")


def drawn(count: int) -> Draws:
    """Return draws between the bounds of what is unknown, and normal ones of what is known to 0.3 %."""
    rng, bounds = np.random.default_rng(0), {p.name: (p.lower, p.upper) for p in WHOLE.parameters}
    columns = [rng.uniform(*bounds[n], count) for n in UNKNOWN]
    columns += [WHOLE.value(n) * (1.0 + 0.003 * rng.standard_normal(count)) for n in KNOWN]
    return Draws((*UNKNOWN, *KNOWN), np.stack(columns, axis=1), "covariance", UNKNOWN)


@pytest.fixture(scope="module")
def rudderless() -> Propagation:
    expressions = {"even": "Cnrudder**2", "product": "Cn0*CLalpha", "known": "Cmalpha/CLalpha + 0.0001*Cn0"}
    return propagate_draws(WHOLE, drawn(400), CRUISE, expressions)


def test_an_effect_without_slope_is_marked_and_many_figures_are_one_caution(rudderless: Propagation) -> None:
    """A linear regression finds nothing of a square about its middle; the variance of a product is its prior's."""
    assert rudderless["even"].prior_share == 1.0
    assert rudderless["product"].prior_share > 0.99
    assert rudderless["known"].prior_share < 0.1
    assert not rudderless["static margin"].rests_on_prior
    assert sum(one.failed > 0.03 for one in rudderless.figures) > 10
    assert [n.code for n in rudderless.notices].count("propagate-figure-failed") == 1
    (told,) = (n for n in rudderless.notices if n.code == "propagate-rests-on-priors")
    assert told.values["parameters"] == UNKNOWN
    assert {"alpha", "phi", "elevator", "rudder"} <= set(str(told.values["figures"]).split("; "))


def test_trims_with_an_unknown_rudder_are_as_by_single_draws(rudderless: Propagation) -> None:
    """The naive twin: each draw is trimmed by itself, with and without the spread of what is unknown."""
    draws, figures = drawn(400), ("alpha", "phi", "elevator", "rudder")
    trims = np.flatnonzero(np.isfinite(rudderless.samples["alpha"]))[:SINGLES]

    def spread(values: FloatArray) -> FloatArray:
        rows = []
        for row in values[trims]:
            numbers = {n: {"value": float(v)} for n, v in zip(draws.names, row, strict=True)}
            with suppress(StoopError):
                point = trim(WHOLE.with_numbers(numbers), 35.0, 200.0, 0.0, DENSITY)
                rows.append([{**point.start, **point.deflections}[n] for n in figures])
        return np.var(rows, axis=0)

    held = draws.values.copy()
    held[:, : len(UNKNOWN)] = [WHOLE.value(n) for n in UNKNOWN]
    for name, single in zip(figures, 1.0 - spread(held) / spread(draws.values), strict=True):
        assert single > 0.97, name
        assert rudderless[name].prior_share == pytest.approx(single, abs=0.03)
        assert rudderless[name].rests_on_prior


def test_conditional_draws_of_a_normal_distribution() -> None:
    rng, covariance = np.random.default_rng(0), np.array([[1.0, 0.8, 0.0], [0.8, 2.0, 0.3], [0.0, 0.3, 1.0]])
    draws = rng.multivariate_normal([1.0, 2.0, 3.0], covariance, 20_000)
    given = conditional_draws(draws, np.array([True, False, False]), np.array([1.5, 0.0, 0.0]))
    assert (given[:, 0] == 1.5).all()
    assert given[:, 1:].mean(axis=0) == pytest.approx([2.0 + 0.8 * 0.5, 3.0], abs=0.04)
    assert np.cov(given[:, 1:].T) == pytest.approx(np.array([[2.0 - 0.64, 0.3], [0.3, 1.0]]), abs=0.05)


def spread(vehicle: Vehicle, names: tuple[str, ...], count: int, size: float = 0.05) -> Draws:
    center = np.array([vehicle.value(n) for n in names])
    noise = np.random.default_rng(0).standard_normal((count, len(names)))
    return Draws(names, center + size * np.maximum(np.abs(center), 0.01) * noise, "covariance")


def polar_aircraft() -> Vehicle:
    """Return an aircraft whose lift and drag depend on the angle of attack alone: CD = CD0 + CDalpha2 alpha^2."""
    zero: dict[str, Any] = {n: {"value": 0.0} for n in ("CL0", "CLelevator", "CDalpha", "Cm0")}
    whole = load_vehicle("twin-boom").with_numbers({**zero, "CDalpha2": {"value": 1.3}})
    return whole.reduced("longitudinal")


def speed_of(lift: float, weight: float = 189.40 * GRAVITY) -> float:
    return math.sqrt(2.0 * weight / (DENSITY * 2.8667 * lift))


@pytest.mark.parametrize("name", ["twin-boom", "vtail"])
def test_draws_are_those_of_one_at_a_time(name: str, request: pytest.FixtureRequest) -> None:
    """The naive twin: SciPy's root finding, and exact differentiation, of each draw by itself."""
    root = request.config.rootpath
    vehicle = load_vehicle(name) if name == "twin-boom" else load_vehicle(root / "examples" / "vtail.toml")
    speed, names = vehicle.value("reference.airspeed"), ("CLalpha", "Cmalpha", "Cnbeta", "Clp", "CD0")
    names += ("controls.aileron.lag",) if name == "vtail" else ()
    draws = spread(vehicle, names, 3)
    rows = vehicle.parameter_rows(dict(zip(names, draws.values.T, strict=True)), 3)
    flight = level_flight(vehicle, rows, 200.0, DENSITY)
    at = steady_flights(flight, {"V": np.full(3, speed)})
    models = linear_flights(flight, at)
    assert at.flies.all()
    for i, values in enumerate(draws.values):
        one = vehicle.with_numbers({n: {"value": float(v)} for n, v in zip(names, values, strict=True)})
        point = trim(one, speed, 200.0, 0.0, DENSITY)
        theirs, angles = linearize(one, point), {n: point.start[n] for n in ("alpha", "theta", "phi")}
        wanted, by_all = angles | point.deflections, at.start | at.deflections
        assert {n: by_all[n][i] for n in wanted} == pytest.approx(wanted, abs=1e-8)
        assert {n: at.thrust[n][i] for n in point.thrust} == pytest.approx(point.thrust, rel=1e-7)
        assert models.names == theirs.states
        assert np.allclose(models.A[i], theirs.A, atol=1e-6 * np.abs(theirs.A).max())
        for control, effect in models.effects.items():
            if f"{control}.lag" not in models.names:
                column = theirs.B[:, theirs.inputs.index(control)]
                assert np.allclose(effect[i], column, atol=1e-6 * np.abs(column).max())


def test_static_margin_is_the_ratio_of_two_slopes_and_moves_with_the_moment_point() -> None:
    """A moment point ahead of the center of gravity by 0.1 chord, at small angles without drag: 0.1 less."""
    ahead = "alpha = 0.0\nmoment_point = [0.055, 0.0, 0.0]\n"
    moved = builtin_text("twin-boom").replace("alpha = 0.0\n", ahead)
    numbers = {n: {"value": 0.0} for n in ("CD0", "CDalpha", "CL0")}
    for vehicle, alpha, margin in (
        (load_vehicle("twin-boom"), 0.1, 2.12 / 4.78),
        (parse_vehicle(moved, "moved").with_numbers(numbers), 0.0, 2.12 / 4.78 - 0.1),
    ):
        flow = {"V": np.array([35.0]), "alpha": np.array([alpha])}
        still = {c: np.zeros(1) for c in vehicle.controls}
        assert static_margin(vehicle, vehicle.parameter_rows(), flow, still) == pytest.approx(
            margin, rel=1e-6
        )


def test_best_glide_of_a_parabolic_polar() -> None:
    vehicle = polar_aircraft()
    draws = spread(vehicle, ("CD0", "CLalpha"), 100, 0.02)
    found = propagate_draws(vehicle, draws, Domain((20.0, 60.0), 35.0, 200.0, DENSITY, (-0.1, 0.6)))
    # (CL/CD)max = CLalpha / (2 sqrt(CD0 CDalpha2)) at alpha = sqrt(CD0 / CDalpha2)
    best, weight = 4.78 / (2.0 * math.sqrt(0.06 * 1.3)), 189.40 * GRAVITY
    speed = speed_of(4.78 * math.sqrt(0.06 / 1.3), weight * math.cos(math.atan(1.0 / best)))
    assert found["best glide ratio"].estimate == pytest.approx(best, rel=1e-3)
    assert found["airspeed of the best glide"].estimate == pytest.approx(speed, rel=5e-3)
    # relative: d ln = d ln CLalpha - 1/2 d ln CD0
    assert found["best glide ratio"].std_error / best == pytest.approx(math.hypot(0.02, 0.01), rel=0.25)
    # CL^3/CD^2 is greatest where the induced drag is three times the other
    lift, drag = 4.78 * math.sqrt(3.0 * 0.06 / 1.3), 4.0 * 0.06
    flat = math.atan(drag / lift)
    sink = speed_of(lift, weight * math.cos(flat)) * math.sin(flat)
    assert found["least sink rate"].estimate == pytest.approx(sink, rel=1e-2)


def test_a_lift_with_a_maximum_gives_a_stall_speed() -> None:
    bent = 'CLalpha = 4.78\nCLalpha2 = { term = "alpha^2", value = -8.0, bounds = [-50.0, 0.0] }'
    text = builtin_text("twin-boom").replace("CLalpha = 4.78", bent)
    vehicle = parse_vehicle(text, "stalling").reduced("longitudinal")
    flow = {"V": np.array([35.0]), "alpha": np.zeros(1)}
    peak = lift_maximum(vehicle, vehicle.parameter_rows(), flow, {"elevator": np.zeros(1)}, 0.0, 0.4)
    assert peak == pytest.approx(4.78 / 16.0, abs=1e-6)
    domain = Domain((33.0, 40.0), 35.0, 200.0, DENSITY, (0.0, 0.4))
    found = propagate_draws(vehicle, spread(vehicle, ("CLalpha",), 50, 0.02), domain)
    assert found["angle of attack of greatest lift"].estimate == pytest.approx(4.78 / 16.0, abs=1e-4)
    assert found["stall speed"].estimate < 33.0
    assert "propagate-stall" in [n.code for n in found.notices]


def test_lowest_airspeed_within_the_angles_flown_and_extrapolation_beyond_them() -> None:
    """Thrust along the body's axis: V^2 = 2 W / (rho S (CL + CD tan alpha)) in level flight."""
    vehicle, most = polar_aircraft(), 0.12
    domain = Domain((25.0, 40.0), 35.0, 200.0, DENSITY, (0.0, most))
    found = propagate_draws(vehicle, spread(vehicle, ("CLalpha",), 50), domain)
    slowest = speed_of(4.78 * most + (0.06 + 1.3 * most**2) * math.tan(most))
    assert found["lowest airspeed, alpha as flown"].estimate == pytest.approx(slowest, rel=1e-3)
    assert "propagate-no-stall" in [n.code for n in found.notices]
    told = next(n for n in found.notices if n.code == "propagate-extrapolated")
    alpha = next(c for c in found.curves if c.name == "alpha")
    assert alpha.estimate[alpha.airspeed <= told.values["high"]].min() > most
    assert (told.values["low"], found.extrapolated) == (25.0, ((25.0, told.values["high"]),))


def test_draws_that_do_not_trim_are_counted_and_nothing_that_trims_is_an_error() -> None:
    vehicle = polar_aircraft()
    draws = Draws(("CLalpha",), np.repeat([4.78, 0.01], [40, 10])[:, None], "covariance")
    found = propagate_draws(vehicle, draws, LEVEL)
    assert found["alpha"].failed == pytest.approx(0.2)
    assert {"propagate-no-trim", "propagate-figure-failed"} <= {n.code for n in found.notices}
    with pytest.raises(SimulationError, match=r"nothing trims at 3 m/s .* give --airspeed A:B"):
        propagate_draws(vehicle, draws, Domain((3.0, 4.0), 3.0, 200.0, DENSITY))


COUNT, ALONE = 4000, {"a": ParameterEstimate(1.0, 0.1)}


def fitted(parameters: dict[str, ParameterEstimate], matrix: np.ndarray) -> Result:
    return result({}, 0.1, "one", parameters=parameters, covariance=Covariance(tuple(parameters), matrix))


def test_far_from_bounds_the_covariance_comes_back() -> None:
    far, rng, mean = np.full(3, 1e3), np.random.default_rng(0), np.array([1.0, 2.0, 3.0])
    covariance = np.array([[4.0, 1.2, 0.0], [1.2, 1.0, 0.3], [0.0, 0.3, 0.5]])
    drawn = truncated_normal(mean, covariance, -far, far, 20_000, rng)
    assert np.allclose(np.cov(drawn.T), covariance, atol=0.1)
    assert np.allclose(drawn.mean(axis=0), mean, atol=0.05)


@pytest.mark.parametrize("low", [-1.0, 0.5, 5.0])
def test_a_bound_cuts_off_as_scipy_does(low: float) -> None:
    """At 5 standard errors nearly all draws are rejected, and Gibbs sampling takes over."""
    rng = np.random.default_rng(1)
    drawn = truncated_normal(np.zeros(1), np.eye(1), np.array([low]), np.array([np.inf]), COUNT, rng)
    assert drawn.min() >= low
    assert kstest(drawn[:, 0], truncnorm(low, np.inf).cdf).pvalue > 0.01


def test_gibbs_sampling_of_two_corners_agrees_with_rejection() -> None:
    rng, covariance = np.random.default_rng(4), np.array([[1.0, 0.8], [0.8, 1.0]])
    low, high = np.array([2.8, -np.inf]), np.array([np.inf, 1.0])
    drawn = truncated_normal(np.zeros(2), covariance, low, high, COUNT, rng)
    plain = np.random.default_rng(5).multivariate_normal(np.zeros(2), covariance, 400_000)
    plain = plain[((plain >= low) & (plain <= high)).all(axis=1)]
    assert np.allclose(drawn.mean(axis=0), plain.mean(axis=0), atol=0.05)


def test_what_the_data_do_not_determine_is_drawn_from_prior_or_box_or_held() -> None:
    parameters = {
        "known": ParameterEstimate(1.0, 0.1),
        "prior": ParameterEstimate(2.0, prior_mean=3.0, prior_std=0.5, identifiable=False),
        "box": ParameterEstimate(0.2, bound_lower=0.0, bound_upper=1.0, identifiable=False),
        "held": ParameterEstimate(7.0, identifiable=False),
    }
    found = from_covariance(fitted(parameters, np.diag([0.01, np.inf, np.inf, np.inf])), COUNT, 0)
    drawn = dict(zip(found.names, found.values.T, strict=True))
    assert drawn["prior"].mean() == pytest.approx(3.0, abs=0.05)
    assert drawn["prior"].std() == pytest.approx(0.5, abs=0.03)
    assert kstest(drawn["box"], "uniform").pvalue > 0.01
    assert np.all(drawn["held"] == 7.0)
    assert found.undetermined == ("prior", "box", "held")
    assert [one.code for one in found.notices] == ["parameters-held"]


def test_what_cannot_be_drawn_from_is_refused_with_the_way_out() -> None:
    figures = {"rhat": 1.3, "sample_size": 20.0, "std_error": 0.2}
    failed = notice("posterior-not-converged", **figures, max_rhat=1.01, needed=400.0, max_std_error=0.03)
    plain = fitted(ALONE, np.array([[0.01]]))
    stuck = replace(plain, uncertainty={"posterior": of.MethodIntervals({}, {"rhat": 1.3}, (failed,))})
    unknown = fitted({"a": ParameterEstimate(1.0)}, np.array([[np.inf]]))
    for fit, source, advice in (
        (stuck, None, r"not converged \(R-hat 1.300\); take --source covariance"),
        (plain, "posterior", "was not sampled; run stoop identify with --posterior"),
        (fitted({}, np.empty((0, 0))), "covariance", "holds no covariance"),
        (unknown, "covariance", "determines no parameter"),
    ):
        with pytest.raises(StoopError, match=advice):
            draws_of(fit, None, 100, source=source)
    one, other = (draws_of(stuck, None, 100, source="covariance") for _ in range(2))
    assert (one.source, other.source) == ("covariance", "covariance")
    assert np.array_equal(one.values, other.values)
    assert not np.array_equal(one.values, from_covariance(stuck, 100, 4).values)


def test_draws_of_a_posterior_file(tmp_path: Path) -> None:
    xr, values = pytest.importorskip("xarray"), np.random.default_rng(0).normal(size=(4, 500))
    data = xr.Dataset({"a": (("chain", "draw"), values)})
    data.to_netcdf(tmp_path / "posterior.nc", group="posterior", engine="h5netcdf")
    fit = replace(fitted(ALONE, np.array([[0.01]])), uncertainty={"posterior": of.MethodIntervals({}, {})})
    found = draws_of(fit, (tmp_path / "posterior.nc").read_bytes(), 1000)
    assert (found.source, found.values.shape) == ("posterior", (1000, 1))
    assert found.values[:, 0].std() == pytest.approx(values.std(), rel=0.05)


def test_speeds_of_rotors_are_shown_in_rpm() -> None:
    for group, unit, factor, text in (
        ("Hover", "rad/s", 9.549297, "rpm"), ("Hover", "1", 1.0, ""), ("Control authority", "rad/s", 57.29578, "deg/s"),
    ):  # fmt: skip
        assert shown(SimpleNamespace(group=group, unit=unit)) == (pytest.approx(factor), text)  # type: ignore[arg-type]
