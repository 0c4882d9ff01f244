"""The cost of eq. (3): by kernel, residuals and hand the same; exact slopes; holes hidden; weights against the likelihood."""

import dataclasses
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from helpers.flown import maneuver as flown_by
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import march
from naive.aircraft import Aircraft
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from stoop import Flight, Options, Vehicle
from stoop.assessment.error_bars import ErrorBars
from stoop.estimate.fit import fit
from stoop.estimate.treatment import Treatment
from stoop.problem import Layout, Misfit, Nuisance, Piece, Weights
from stoop.problem.color import ChannelColor, Color, ColoredWeights
from stoop.problem.evidence import invert, observed_information, simulation_evidence
from stoop.problem.misfit import horizon_ladder
from stoop.problem.windows import Window
from stoop.simulation.fly import fly
from stoop.vehicle import parse_vehicle

TWIN = (files("stoop") / "data" / "twin_boom.toml").read_text()


def sigmas(vehicle: Vehicle) -> np.ndarray:
    return np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    changes = {n: {"free": False} for n in ("CLV", "CDV", "CmV", "CDalpha2", "CDalpha", "CLq")}
    changes |= {"mass.mass": {"free": True, "bounds": (150.0, 230.0)}, "Cmq": {"prior": 5.0}}
    return parse_vehicle(TWIN, "twin").reduced("longitudinal").with_numbers(changes)


def piece(vehicle: Vehicle, maneuver: int, start: float, changes: dict[str, float]) -> Piece:
    flown = fly(vehicle, flown_by(2.0, ("elevator", "doublet", start, 0.3, 0.05)))
    noise = np.random.default_rng(maneuver).standard_normal(flown.outputs.shape)
    measured = flown.outputs + sigmas(vehicle) * noise
    return Piece(maneuver, flown.time, flown.inputs, measured, flown.trim.start, changes)


@pytest.fixture(scope="module")
def problem(vehicle: Vehicle) -> Misfit:
    """Two maneuvers, the first in two pieces with holes in the measurements, the second heavier."""
    each = ((0, 0.3, {}), (0, 0.6, {}), (1, 0.5, {"mass.inertia.yy": 130.0}))
    pieces = [piece(vehicle, *own) for own in each]
    pieces[0].measured[40:60, 2] = np.nan
    pieces[0].measured[90] = np.nan
    pieces[1].measured[:, 4] = np.nan
    nuisances = [
        Nuisance(n, p.maneuver, i, p.start.get(n, 0.0), s)
        for i, p in enumerate(pieces) for n, s in (("V", 2.0), ("alpha", 0.1), ("q", 0.2), ("theta", 0.1))
    ]  # fmt: skip
    nuisances += [Nuisance(f"sensors.{c}.bias", m, None, 0.0, 0.02) for m in (0, 1) for c in ("q", "az")]
    free = [p for p in Layout.of(vehicle, nuisances).parameters if not p.name.endswith(".bias")]
    layout = Layout(vehicle, tuple(free), tuple(nuisances))
    return Misfit(layout, tuple(pieces), Weights.of(sigmas(vehicle) ** 2), horizon_ladder(pieces))


def points(problem: Misfit, count: int) -> np.ndarray:
    middle = problem.layout.unit(np.array([p.value for p in problem.layout.parameters]))
    return np.clip(middle + 0.02 * np.random.default_rng(1).standard_normal((count, problem.dimension)), 0, 1)


def point(problem: Misfit, nuisances: float = 0.0, seed: int = 2) -> np.ndarray:
    extra = nuisances * np.random.default_rng(seed).standard_normal(problem.extra)
    return np.concatenate([points(problem, 1)[0], extra])


def test_cost_by_hand(problem: Misfit, vehicle: Vehicle) -> None:
    """The twin flies each piece; squares over sigma squared; one prior and every nuisance add theirs."""
    X, text = points(problem, 1), vehicle.text + '\n[model]\nreduce = "longitudinal"\n'
    named = zip(problem.layout.parameters, problem.layout.physical(X)[0], strict=True)
    values = {p.name: x for p, x in named}
    total = ((values["Cmq"] - vehicle.value("Cmq")) / 5.0) ** 2
    for p in problem.pieces:
        twin = Aircraft(text, values | dict(p.changes), {})

        def name(row: np.ndarray) -> dict[str, float]:
            return dict(zip(vehicle.inputs, row.tolist(), strict=True))

        y = march.march(
            lambda x, u, t=twin: t.rates(x, name(u)), lambda x, u, t=twin: t.readings(x, name(u)),
            twin.start(p.start, name(p.inputs[0])), p.inputs, p.dt,
        )  # fmt: skip
        total += np.nansum(((y - p.measured) / sigmas(vehicle)) ** 2)
    assert problem.costs(X, len(problem.ladder) - 1)[0] == pytest.approx(total, rel=1e-4)


def test_jacobian_is_the_slope_of_the_residuals(problem: Misfit) -> None:
    z = point(problem, 0.3)
    for rung in (0, len(problem.ladder) - 1):
        found, spent = problem.jacobian(z, rung, problem.residuals(z[None, :], rung)[0])
        J, h = found.dense(), 1e-5
        steps = h * np.eye(len(z))
        slope = (problem.residuals(z + steps, rung) - problem.residuals(z - steps, rung)).T / (2 * h)
        largest = np.abs(slope).max(axis=0)
        assert (largest > 0).all()
        np.testing.assert_allclose(J / largest, slope / largest, rtol=0, atol=2e-5)
        # an initial state (four of each piece) is varied on its own piece only, a bias not at all
        assert spent == pytest.approx((problem.dimension + 4) * problem.prices[rung])


@pytest.mark.parametrize("weights", ["plain", "correlated", "colored"])
def test_products_and_gradient_are_those_of_residuals_and_jacobian(problem: Misfit, weights: str) -> None:
    plain = problem.weights
    if weights == "correlated":
        spread = np.sqrt(np.diag(plain.covariance))
        problem = problem.weighted(Weights.of(np.outer(spread, spread) * (0.4 + 0.6 * np.eye(len(spread)))))
    if weights == "colored":
        count = len(problem.layout.vehicle.outputs)
        colors = Color((ChannelColor(np.array([1.0, 0.9, 0.7])),) * count, (1,) * count)
        problem = problem.weighted(ColoredWeights(plain.covariance, plain.root, colors))
        assert problem.weights.logdet < plain.logdet
    generator, z = np.random.default_rng(4), point(problem, 0.3, seed=3)
    z[0] = 1.0
    for rung in (0, len(problem.ladder) - 1):
        r = problem.residuals(z[None, :], rung)[0]
        left, Z = generator.standard_normal(len(r)), z + 1e-3 * generator.standard_normal((3, len(z)))
        R = problem.residuals(Z, rung)
        size = np.abs(R) @ np.abs(left)
        assert problem.products(Z, rung, left) / size == pytest.approx(R @ left / size, abs=1e-13)
        J = problem.jacobian(z, rung, r)[0].dense()
        size, found = np.abs(left) @ np.abs(J), problem.gradient(z, rung, r, left)
        # rounding over the step of a difference
        assert found / size == pytest.approx(left @ J / size, abs=1e-5)
        X = points(problem, 11)
        squares = np.sum(problem.residuals(np.pad(X, ((0, 0), (0, problem.extra))), rung) ** 2, axis=1)
        np.testing.assert_allclose(problem.costs(X, rung), squares, rtol=1e-12)


def test_jacobian_at_a_bound_steps_inwards(problem: Misfit) -> None:
    z = point(problem)
    z[0], z[1] = 1.0, 0.0
    r = problem.residuals(z[None, :], 0)[0]
    J = problem.jacobian(z, 0, r)[0].dense()
    for entry, step in ((0, -1e-5), (1, 1e-5)):
        slope = (problem.residuals((z + step * np.eye(len(z))[entry])[None], 0)[0] - r) / step
        np.testing.assert_allclose(J[:, entry], slope, rtol=1e-2, atol=1e-2 * np.abs(J[:, entry]).max())


def test_a_correlated_noise_covariance(problem: Misfit) -> None:
    """The cost is e' R^-1 e of the channels that were measured, R being their part of the covariance."""
    sigma = np.sqrt(np.diag(problem.weights.covariance))
    correlation = 0.4 ** np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    full, X = problem.weighted(Weights.of(correlation * np.outer(sigma, sigma))), points(problem, 3)
    Z = np.concatenate([X, np.zeros((3, problem.extra))], axis=1)
    expected = np.sum(full.layout.prior_residuals(Z) ** 2, axis=1)
    for i, p in enumerate(full.pieces):
        for b in range(3):
            for e in full.outputs(Z[b], i) - p.measured:
                seen = np.flatnonzero(np.isfinite(e))
                expected[b] += e[seen] @ np.linalg.solve(full.weights.covariance[np.ix_(seen, seen)], e[seen])
    np.testing.assert_allclose(full.costs(X, len(full.ladder) - 1), expected, rtol=1e-10)
    assert full.weights.logdet == pytest.approx(np.linalg.slogdet(full.weights.covariance)[1])
    diagonal = problem.weighted(Weights.of(np.diag(sigma**2)))
    np.testing.assert_allclose(diagonal.costs(X, 0), problem.costs(X, 0), rtol=1e-12)


def test_a_diverging_candidate_costs_infinity_and_disturbs_none(problem: Misfit) -> None:
    X = points(problem, 9)
    before, names, wild = problem.costs(X, 0), [p.name for p in problem.layout.parameters], X.copy()
    wild[4, names.index("Cmalpha")] = 4e3
    wild[4, names.index("Cmq")] = 1e3
    for p in (problem, problem.weighted(Weights.of(np.diag(problem.weights.covariance.diagonal()) + 1e-12))):
        after = p.costs(wild, 0)
        assert np.isposinf(after[4])
        assert np.isfinite(np.delete(after, 4)).all()
    assert np.array_equal(np.delete(problem.costs(wild, 0), 4), np.delete(before, 4))


def test_tied_biases_share_their_slope() -> None:
    tied = parse_vehicle(TWIN + '\n[sensors.az]\nbias = "=sensors.ax.bias"\n', "tied").reduced("longitudinal")
    p, free = piece(tied, 0, 0.5, {}), tuple(q for q in tied.parameters if q.name == "CL0")
    layout = Layout(tied, free, (Nuisance("sensors.ax.bias", 0, None, 0.0, 0.2),))
    misfit, z = Misfit(layout, (p,), Weights.of(np.ones(6)), horizon_ladder((p,))), np.array([0.5, 0.0])
    J = misfit.jacobian(z, 0, misfit.residuals(z[None, :], 0)[0])[0].dense()
    slope = J[: misfit.ladder[0][0] * 6, 1].reshape(-1, 6)
    assert slope == pytest.approx(np.tile([0.0, 0.0, 0.0, 0.0, 0.2, 0.2], (len(slope), 1)))


def test_angles_are_compared_around_the_circle() -> None:
    twin = parse_vehicle(TWIN, "twin")
    flown = fly(twin, flown_by(2.0, ("rudder", "doublet", 0.5, 0.3, 0.05)))
    around = flown.outputs.copy()
    around[:, twin.outputs.index("psi")] += np.where(np.arange(len(around)) % 2, 2 * np.pi, 0.0)
    around[:, twin.outputs.index("phi")] -= 2 * np.pi
    layout, costs = Layout(twin, tuple(p for p in twin.parameters if p.name == "Cnbeta"), ()), []
    for measured in (flown.outputs, around):
        p = Piece(0, flown.time, flown.inputs, measured, flown.trim.start, flown.trim.changes)
        misfit = Misfit(layout, (p,), Weights.of(np.ones(12)), horizon_ladder((p,)))
        X = layout.unit(np.array([0.1]))[None, :]
        costs.append((misfit.costs(X, 0)[0], np.sum(misfit.residuals(X, 0) ** 2)))
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)
    assert costs[0][0] == pytest.approx(costs[0][1], rel=1e-12)


def test_the_first_horizon_is_as_short_as_the_inputs_allow_and_each_next_one_three_times_as_long() -> None:
    inputs = np.zeros((1000, 2))
    inputs[100:500, 0] = 0.1  # energy 400 of 800, each input in parts of its own range
    inputs[600:, 1] = -7.0

    def one(inputs: np.ndarray) -> Piece:
        return Piece(0, np.arange(len(inputs)) / 50.0, inputs, np.zeros((len(inputs), 1)), {})

    for case, pieces, ladder in (
        # a sixteenth of the energy is 50 samples behind the first step
        ("two inputs", [one(inputs)], ((150,), (450,), (1000,))),
        ("from 1.2 s on", [one(inputs[60:])], ((90,),)),
        ("each within its own length", [one(inputs), one(inputs[80:580])], ((150, 45), (450, 135), (1000, 500))),
        ("not before 0.4 s", [one(np.eye(1000, 1, -7))], ((20,),)),
        ("within half of the piece", [one(np.eye(1000, 1, -999))], ((500,), (1000,))),
        ("still", [one(np.zeros((1000, 2)))], ((100,), (300,), (1000,))),
    ):  # fmt: skip
        assert horizon_ladder(pieces)[: len(ladder)] == ladder, case


def test_layout_turns_units(problem: Misfit) -> None:
    layout = problem.layout
    values = np.array([p.value for p in layout.parameters])
    x = layout.unit(values)
    assert ((x >= 0) & (x <= 1)).all()
    assert layout.physical(x[None, :])[0] == pytest.approx(values, rel=1e-12)
    assert layout.unit(values + 1e9) == pytest.approx(np.ones(layout.dimension))
    Z = np.random.default_rng(0).uniform(size=(2, layout.dimension + layout.extra))
    J = layout.prior_jacobian(Z[0])
    difference = layout.prior_residuals(Z)[1] - layout.prior_residuals(Z)[0]
    assert J @ (Z[1] - Z[0]) == pytest.approx(difference, rel=1e-9)


@pytest.mark.parametrize("right", [True, False])
def test_observed_information_is_the_slope_of_the_gradient(problem: Misfit, right: bool) -> None:
    """That of Gauss and Newton where the readings are those of the model; with large residuals it is not."""
    z = point(problem)
    if right:
        read = (replace(p, measured=problem.outputs(z, i)) for i, p in enumerate(problem.pieces))
        problem = replace(problem, pieces=tuple(read))
    rung = len(problem.ladder) - 1

    def gradient(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r = problem.residuals(z[None, :], rung)[0]
        J = problem.jacobian(z, rung, r)[0].dense()
        return J.T @ r, J.T @ J

    free = np.delete(np.arange(len(z)), 3)  # one at a bound, say
    normal, scales = gradient(z)[1], problem.layout.scales[free]
    factor = invert(normal[np.ix_(free, free)] / np.outer(scales, scales)).factor
    steps = np.zeros((factor.shape[1], len(z)))
    steps[:, free] = 0.01 * factor.T / scales
    slopes = [(gradient(z + d)[0] - gradient(z - d)[0])[free] / scales @ factor / 0.02 for d in steps]
    evidence = simulation_evidence(problem, z, 1.0)
    at_bound = [replace(u, fixed="bound") if j == 3 else u for j, u in enumerate(evidence.unknowns)]
    found = observed_information(problem, z, replace(evidence, unknowns=tuple(at_bound)), factor)
    np.testing.assert_allclose(found, slopes, atol=2e-3 * np.max(np.abs(slopes)))
    assert (np.max(np.abs(found - np.eye(len(found)))) < 1e-3) == right


def test_a_positive_number_has_its_prior_in_the_logarithm() -> None:
    """Half is as likely as twice; the slope is that of differences, and a normal prior about the value pulls alike."""
    name = "mass.inertia.xx"
    free = {name: {"value": 2.0, "prior": 0.8, "free": True, "bounds": [0.2, 20.0]}}
    layout = Layout.of(parse_vehicle(TWIN, "twin").with_numbers(free), ())
    place = [p.name for p in layout.parameters].index(name)
    one, own = layout.parameters[place], layout.priors[0].tolist().index(place)
    width = one.upper - one.lower

    def at(value: float) -> np.ndarray:
        return np.where(np.arange(len(layout.start)) == place, (value - one.lower) / width, layout.start)

    def pull(value: float) -> float:
        return float(layout.prior_residuals(at(value)[None])[0, own])

    assert (pull(2.0), pull(4.0)) == (pytest.approx(0.0, abs=1e-12), pytest.approx(np.log(2.0) / 0.4))
    assert pull(1.0) == pytest.approx(-pull(4.0))
    per_value = layout.prior_jacobian(at(5.0))[own, place] / width
    assert per_value == pytest.approx((pull(5.001) - pull(4.999)) / 0.002, rel=1e-6)
    mean, std = one.prior_about(5.0)
    assert ((5.0 - mean) / std, std) == pytest.approx((pull(5.0), 1.0 / per_value))
    z = at(5.0)[None]
    assert layout.prior_costs(z)[0] == pytest.approx(np.sum(layout.prior_residuals(z) ** 2))
    other = next(p for p in layout.parameters if p.name == "Clp")
    assert other.prior_about(1.0)[0] == other.prior_mean


def test_a_bias_is_shared_by_the_pieces_of_its_maneuver(problem: Misfit) -> None:
    z, places = point(problem), [(n.name, n.maneuver) for n in problem.layout.nuisances]
    moved = z + 2.0 * np.eye(len(z))[problem.dimension + places.index(("sensors.q.bias", 0))]
    shift = 0.04 * (np.arange(6) == problem.layout.vehicle.outputs.index("q"))
    for i, of_maneuver in enumerate((1.0, 1.0, 0.0)):
        difference = problem.outputs(moved, i) - problem.outputs(z, i)
        assert difference == pytest.approx(np.tile(of_maneuver * shift, (len(difference), 1)), abs=1e-15)


def test_the_reference_is_a_model_that_says_nothing(problem: Misfit) -> None:
    sigma, total = np.sqrt(np.diag(problem.weights.covariance)), 0.0
    for p in problem.pieces:
        first = np.array([c[np.isfinite(c)][0] if np.isfinite(c).any() else 0.0 for c in p.measured.T])
        total += np.nansum(((p.measured - first) / sigma) ** 2)
    assert problem.reference(len(problem.ladder) - 1) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("covariance", [np.array([4.0, 9.0, 1.0]), np.eye(3) + 0.5])
def test_coloring_undoes_whitening(covariance: np.ndarray) -> None:
    rng, weights = np.random.default_rng(1), Weights.of(covariance)
    seen = rng.random((30, 3)) < 0.7
    error = rng.standard_normal((30, 3)) * seen
    np.testing.assert_allclose(weights.colored(weights.whiten(error, seen), seen), error, atol=1e-12)


def process(color: ChannelColor, count: int) -> np.ndarray:
    """Return the covariance (count, count) of readings: the autocorrelation goes on as its autoregression says."""
    r = color.autocorrelation.tolist()
    a = np.linalg.solve(toeplitz(r[:-1]), r[1:])
    while len(r) < count:
        r.append(float(a @ r[: -len(a) - 1 : -1]))
    return toeplitz(r[:count])


@given(st.integers(1, 6), st.integers(1, 30), st.floats(0.0, 0.98), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_whitening_is_an_inverse_root_of_covariance(order: int, count: int, slow: float, seed: int) -> None:
    """Of the stationary process, from its first reading on; the others are its transpose and its inverse."""
    color, one = ChannelColor(np.append(1.0, 0.9 * slow ** np.arange(1, order + 1))), np.eye(count)
    white = color.whiten(one)
    np.testing.assert_allclose(white @ process(color, count) @ white.T, one, atol=1e-9)
    assert np.all(np.triu(white, 1) == 0.0)
    left = np.random.default_rng(seed).standard_normal((count, 2))
    np.testing.assert_allclose(color.whiten_back(left), white.T @ left, atol=1e-12)
    np.testing.assert_allclose(color.colored(white @ left), left, atol=1e-9)


def test_readings_that_are_missing_or_slow_are_no_neighbors() -> None:
    """After a gap a stretch begins anew; of a channel read every third sample, neighbors are three samples apart."""
    color, present = ChannelColor(np.array([1.0, 0.8, 0.5])), np.zeros((20, 3), dtype=bool)
    present[:8, 0] = present[11:, 0] = present[::3, 1] = present[:, 2] = True
    rng = np.random.default_rng(1)
    residuals = rng.standard_normal((4, 20, 3)) * present
    weights = ColoredWeights(np.eye(3), np.eye(3), Color((color, color, ChannelColor(np.ones(1))), (1, 3, 1)))
    white = weights.whiten(residuals, present)
    for lane, own in zip(white, residuals, strict=True):
        np.testing.assert_allclose(lane[:8, 0], color.whiten(own[:8, :1])[:, 0])
        np.testing.assert_allclose(lane[11:, 0], color.whiten(own[11:, :1])[:, 0])
        np.testing.assert_allclose(lane[::3, 1], color.whiten(own[::3, 1:2])[:, 0])
        np.testing.assert_array_equal(lane[:, 2], own[:, 2])
    assert np.all(white[:, ~present] == 0.0)
    left = rng.standard_normal((20, 3))
    total = np.sum(left * present * white[0])
    assert np.sum(weights.whiten_back(left, present) * residuals[0]) == pytest.approx(total)
    np.testing.assert_allclose(weights.colored(white[0], present), residuals[0], atol=1e-12)


def test_slow_errors_are_weighed_by_their_color(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    """Estimates are nearer the truth, and the two weightings differ by no more than the error bars."""
    rng, data = np.random.default_rng(5), flight.data
    for channel in ("p", "q", "r", "alpha", "beta", "phi", "theta"):
        steps = np.append(0.0, np.radians(0.05) * rng.standard_normal(len(flight.time) - 1))
        if channel in flight.names:
            data = data.assign({channel: data[channel] + lfilter([1.0], [1.0, -0.98], steps)})
    disturbed, window = {"sim": dataclasses.replace(flight, data=data)}, [Window("sim", 0.0, 30.0)]
    found = fit(wrong, disturbed, window, Options())
    plain = fit(wrong, disturbed, window, Options(treatment=Treatment(noise_color=False)))
    assert [one.name for one in found.decisions if one.name == "noise-color"]
    assert not isinstance(plain.problem.weights, ColoredWeights)
    np.testing.assert_array_equal(plain.disagreement, 0.0)
    true = np.array([aircraft.value(n) for n in plain.estimates])
    size = ErrorBars.of(plain).std[: len(true)]
    known = size > 0.0
    off = [(np.array([*one.estimates.values()]) - true)[known] / size[known] for one in (found, plain)]
    assert np.sqrt(np.mean(off[0] ** 2)) < 0.8 * np.sqrt(np.mean(off[1] ** 2))
    free, bars = found.evidence.free, ErrorBars.of(found)
    apart = found.disagreement[free] / bars.std[free]
    assert 0.0 < np.sqrt(np.mean(apart**2)) < 1.0
