"""Filter error on simulated turbulence, beside output error on the same flights."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.assessment.error_bars import error_bars
from stoop.errors import IdentificationError
from stoop.estimate import methods
from stoop.estimate.filter_error import raised
from stoop.estimate.fit import Options
from stoop.estimate.treatment import Treatment
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.workflow import identify

from .conftest import MANEUVER


def errors(vehicle, flight, method, colored=False):
    """The fit, errors of what was free, and their standard errors."""
    options = Options(method=method, treatment=Treatment(noise_color=colored))
    found = methods.find(method).fitter()(
        vehicle, {"sim": flight}, [Window("sim", 0.0, 15.0)], options, None, None
    )
    truth = json.loads(flight.data.attrs["truth"])
    bars = error_bars(found)
    off = [found.estimates[p.name] - truth[p.name] for p in found.problem.layout.parameters]
    return found, np.array(off), bars.std[: len(off)]


def scores(vehicle, flight, method):
    found, off, std = errors(vehicle, flight, method)
    return found, off / std


def test_truth_lies_within_the_error_bars(gusty_start, gusty_flight):
    found, z = scores(gusty_start, gusty_flight, "filter-error")
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert np.sqrt(np.mean(z**2)) < 1.6


def test_the_first_noise_is_at_least_what_innovations_show(gusty_start, gusty_flight):
    """Slow errors hardly show in second differences; a search from these alone costs a step for every factor of e."""
    rng, sigma = np.random.default_rng(0), gusty_start.file.sensors.theta.sigma
    slow = 20.0 * sigma * lfilter([0.1], [1.0, -0.99], rng.standard_normal(gusty_flight.time.size))
    flight = replace(gusty_flight, data=gusty_flight.data.assign(theta=gusty_flight.data["theta"] + slow))
    found = methods.find("filter-error").fitter()(
        gusty_start, {"sim": flight}, [Window("sim", 0.0, 15.0)], Options(), None, None
    )
    likelihood, at = found.likelihood, gusty_start.outputs.index("theta")
    low = found.optimum.copy()
    low[likelihood.known + at] -= 4.0
    there = raised(likelihood, low)
    changed = np.flatnonzero(there != low)
    assert likelihood.known + at in changed
    assert there[likelihood.known + at] == pytest.approx(found.optimum[likelihood.known + at], abs=0.5)
    assert np.array_equal(raised(likelihood, found.optimum), found.optimum)


def test_a_limit_of_steps_ends_it_and_more_of_them_go_on(gusty_start, gusty_flight):
    args = (gusty_start, {"sim": gusty_flight}, [Window("sim", 0.0, 15.0)])
    fitter = methods.find("filter-error").fitter()
    whole, few = fitter(*args, Options()), fitter(*args, Options(generations=4))
    assert (few.outcome.status, few.outcome.generation) == ("generations", 4)
    assert "--generations" in few.outcome.advice
    more = fitter(*args, Options(), None, few.outcome.state)
    assert more.outcome.status == "converged"
    assert np.array_equal(more.z, whole.z)
    older = replace(few.outcome.state, memory=np.empty((0, 0)))  # as a release wrote it that kept no secant
    assert fitter(*args, Options(), None, older).outcome.status == "converged"
    assert fitter(*args, Options(budget=100.0)).outcome.status == "budget"


def test_innovations_are_white(gusty_start, gusty_flight):
    found, _ = scores(gusty_start, gusty_flight, "filter-error")
    for residual in (piece.residual for piece in found.evidence.pieces):
        lag = np.mean(residual[1:] * residual[:-1], axis=0) / np.mean(residual**2, axis=0)
        assert np.abs(lag).max() < 4.0 / np.sqrt(len(residual))
        assert np.mean(residual**2) == pytest.approx(1.0, abs=0.1)


def test_a_gain_that_follows_the_flight_finds_the_same(gusty_start, gusty_flight):
    steady, _ = scores(gusty_start, gusty_flight, "filter-error")
    varying, z = scores(gusty_start, gusty_flight, "filter-error-ekf")
    assert np.abs(z).max() < 3.5
    for name in ("CLalpha", "Cmalpha", "Cmq", "Cmelevator"):
        assert varying.estimates[name] == pytest.approx(steady.estimates[name], rel=0.05)


def test_output_error_is_less_sure_by_the_color_of_its_residuals_and_worse_than_filter_error(
    gusty, gusty_start
):
    """By weights of white noise it is too sure in gusts."""
    fixed = gusty_start.with_numbers({f"turbulence.{a}.intensity": {"free": False} for a in "uw"})
    cases = {
        "filter": (gusty_start, "filter-error", False),
        "colored": (fixed, "output-error", True),
        "plain": (fixed, "output-error", False),
    }
    off, held = {case: [] for case in cases}, {case: [] for case in cases}
    for seed in range(8):
        flight = simulate_flight(gusty, parse_maneuver(MANEUVER, "test"), seed=seed, name="sim")
        for case, (vehicle, method, colored) in cases.items():
            _, error, std = errors(vehicle, flight, method, colored)
            off[case].append(error[:10])
            held[case].append(np.abs(error[:10]) <= 1.96 * std[:10])
    size = {case: np.sqrt(np.mean(np.square(e), axis=0)) for case, e in off.items()}
    assert np.median(size["colored"] / size["filter"]) > 3.0
    assert np.median(size["plain"] / size["filter"]) > 3.0
    assert np.mean(held["filter"]) > 0.85
    assert np.mean(held["plain"]) < 0.8 < np.mean(held["colored"])


def test_without_gusts_in_the_file_white_accelerations_stand_for_them(gusty_flight, gusty_start):
    file = gusty_start.file.model_copy(update={"turbulence": None})
    from dataclasses import replace

    found, z = scores(replace(gusty_start, file=file), gusty_flight, "filter-error")
    assert "process-noise" in [n.code for n in found.notices]
    assert np.abs(z[:10]).max() < 5.0


def test_a_result_has_curves_figures_and_its_method(gusty_start, gusty_flight):
    result = identify(gusty_start, gusty_flight, ["0:10"], ["10:15"], Options(method="filter-error")).result
    assert result.method == "filter-error"
    assert [m.role for m in result.maneuvers] == ["fit", "validation"]
    assert 0.0 < result.maneuvers[0].channels["q"].theil < 1.0
    noise = np.sqrt(np.diag(result.noise_covariance.matrix))
    true = [getattr(gusty_start.file.sensors, c).sigma for c in result.noise_covariance.channels]
    assert noise == pytest.approx(true, rel=0.2)


@pytest.mark.parametrize("method", ["filter-error", "filter-error-ekf"])
def test_an_interrupted_fit_is_resumed_to_the_same_result(gusty_start, gusty_flight, resumed, method):
    window, options = [Window("sim", 0.0, 4.0)], Options(method=method)
    found = resumed(methods.find(method).fitter(), gusty_start, {"sim": gusty_flight}, window, options)
    assert found.outcome.status == "converged"


def test_an_unknown_method_is_one_line():
    with pytest.raises(IdentificationError, match="did you mean filter-error"):
        methods.find("filter-eror")


def test_spikes_count_as_not_measured(gusty_start, gusty_flight):
    rng, data, at = np.random.default_rng(0), gusty_flight.data.copy(deep=True), {}
    for channel in gusty_start.outputs:
        sigma = getattr(gusty_start.file.sensors, channel).sigma
        at[channel] = np.flatnonzero(rng.random(data.sizes["time"]) < 0.01)
        data[channel][at[channel]] += 60.0 * sigma * rng.choice([-1.0, 1.0], len(at[channel]))
    fitter, window = methods.find("filter-error").fitter(), [Window("sim", 0.0, 15.0)]
    clean, spiked = (
        fitter(gusty_start, {"sim": replace(gusty_flight, data=d)}, window, Options(), None, None)
        for d in (gusty_flight.data, data)
    )
    assert not any(n.code == "outliers-missing" for n in clean.notices)
    (said,) = [n for n in spiked.notices if n.code == "outliers-missing"]
    assert set(said.values["channels"]) == set(gusty_start.outputs)
    lost = np.isnan(spiked.problem.pieces[0].measured)
    for i, channel in enumerate(gusty_start.outputs):
        assert lost[at[channel], i].all()
    assert lost.sum() <= 1.1 * sum(map(len, at.values()))
    std = error_bars(clean).std
    for (name, value), error in zip(clean.estimates.items(), std, strict=False):
        assert spiked.estimates[name] == pytest.approx(value, abs=error)
