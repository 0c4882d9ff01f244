"""The main job, on a simulated log and on a real flight: an 8.5 kg V-tail aeroplane, doublets, no vane, a faulty pitot."""

import numpy as np
import pytest
from real import simulated
from real.test_flights import check_simulated_log

import stoop
from stoop.flight import Flight, without
from stoop.vehicle import load_vehicle
from stoop.workflow import FittedModel, Posterior

EXAMPLE = simulated.EXAMPLE
#: number of a maneuver and what it shows
CHANNELS = ((0, "p"), (1, "q"), (2, "r"), (3, "p"), (3, "r"), (3, "beta"))
WINDOWS = ("140:145", "146:152", "160:168.3")
SIGNS = {
    "CLalpha": 1, "Cmalpha": -1, "Cmq": -1, "Cmelevator": -1, "CQbeta": -1, "Clbeta": -1, "Clp": -1, "Claileron": 1,
    "Cnbeta": 1, "Cnr": -1, "Cnrudder": -1, "CD0": 1, "propulsion.CT0": 1,
}  # fmt: skip


def check_job(
    model: FittedModel, wind_e: float, dropout: tuple[float, ...], limits: tuple[float, ...]
) -> None:
    """Check what a user sees of a good fit: figures, status, signs, segments, wind, pitot, error bars.

    Wind in m/s, dropout of the first maneuver in s, limits of Theil's coefficient of each of `CHANNELS`.
    """
    result = model.result
    for (number, channel), limit in zip(CHANNELS, limits, strict=True):
        found = result.maneuvers[number]
        assert found.role == ("validation" if number == 3 else "fit")
        assert found.channels[channel].theil <= limit, (number, channel)
        assert found.channels[channel].theil < found.channels[channel].baseline_theil, (number, channel)
    assert result.status == "converged"
    assert not [name for name, p in result.parameters.items() if p.at_bound]
    # moments over inertia, which are what a flight shows; static stability in pitch is the least known
    parameters, covariance = result.parameters, result.covariance
    for name, sign in SIGNS.items():
        over = {"Cl": "mass.inertia.xx", "Cm": "mass.inertia.yy", "Cn": "mass.inertia.zz"}.get(name[:2])
        relative = np.zeros(len(covariance.names))
        relative[covariance.names.index(name)] = 1.0 / parameters[name].estimate
        if over:
            relative[covariance.names.index(over)] = -1.0 / parameters[over].estimate
        assert sign * parameters[name].estimate > 0.0, name
        assert (relative @ covariance.matrix @ relative) ** 0.5 < 0.8, name
    first, second = result.maneuvers[0].segments  # each with its own initial state
    assert first[1] <= dropout[0] < dropout[1] <= second[0]
    wind = result.wind[0]
    assert wind.values["wind_e"].estimate == pytest.approx(wind_e, abs=0.8)
    assert any("pitot fault" in str(note) for note in wind.notes)
    corrected, white = (result.uncertainty[k].parameters for k in ("corrected", "cramer_rao"))
    assert np.median([corrected[n].std_error / white[n].std_error for n in corrected]) > 1.5
    assert any("Cramer-Rao" in str(s) for s in result.basis)


def test_the_main_job_on_a_simulated_log(simulated_flight: Flight) -> None:
    """Its truth is known: every number comes back within four of its standard errors, most within two."""
    check_simulated_log(simulated_flight)
    model = stoop.fit(EXAMPLE, simulated_flight, [*simulated.WINDOWS], validate=[simulated.VALIDATE])
    check_job(model, simulated.WIND[1], simulated.LOST[0], (0.06, 0.08, 0.06, 0.1, 0.15, 0.35))
    truth, found = load_vehicle(EXAMPLE), model.result.parameters
    told = {name: p for name, p in found.items() if p.identifiable}
    scores = np.abs([(p.estimate - truth.value(name)) / p.std_error for name, p in told.items()])
    assert len(scores) >= 40
    assert scores.max() < 4.0, told
    assert np.mean(scores < 2.0) > 0.85


def test_the_main_job_on_a_real_flight(vtail_flight: Flight) -> None:
    model = stoop.fit(EXAMPLE, vtail_flight, [*WINDOWS], validate=["187:196"])
    check_job(model, -3.2, (142.5, 142.7), (0.12, 0.086, 0.081, 0.25, 0.30, 0.25))
    outside = without(vtail_flight, [(187.0, 196.0)])  # wind learns nothing from the predicted window
    assert outside.air.wind_n != vtail_flight.air.wind_n


def test_the_posterior_mixes(vtail_flight: Flight) -> None:
    """32 parameters of lateral motion, at a quarter of the usual rate: R-hat at most 1.01, widths those of the covariance."""
    flight = stoop.load_flight(vtail_flight.path, rate=25.0)
    vehicle = load_vehicle(EXAMPLE).reduced("lateral")
    # these two windows alone fit moments of no body, one of which would be held: the sampler is given all of them
    free = stoop.Strategy.default().without("held-numbers")
    job = stoop.fit(vehicle, flight, [WINDOWS[0], WINDOWS[2]], strategy=free)
    result = job.assess(Posterior()).result
    found, covariance = result.uncertainty["posterior"], result.covariance
    assert found.figures["rhat"] <= 1.01
    assert min(found.figures["ess_bulk"], found.figures["ess_tail"]) >= 400.0
    std = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)), strict=True))
    ratios = [p.std_error / std[n] for n, p in found.parameters.items()]
    assert len(ratios) == 32
    assert 1.0 / 1.5 < min(ratios) < max(ratios) < 1.5


def test_filter_error_finds_its_maximum_where_intensities_vanish(vtail_flight: Flight) -> None:
    """Noise intensities of this flight lie at their bounds and innovations are colored: far from Fisher's assumptions."""
    found = stoop.fit(EXAMPLE, vtail_flight, [*WINDOWS], method="filter-error")
    assert found.result.status == "converged"
