"""The main job on a real flight: an 8.5 kg V-tail aeroplane, pilot doublets, no vane, a faulty pitot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stoop
from stoop.flight import load, without
from stoop.vehicle import load_vehicle
from stoop.workflow import FittedModel, Posterior

EXAMPLE = Path(__file__).parents[2] / "examples" / "vtail.toml"


@pytest.fixture(scope="module")
def job(shared_data: Path) -> FittedModel:
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    return stoop.fit(EXAMPLE, flight, ["140:145", "146:152", "160:168.3"], validate=["187:196"])


@pytest.mark.parametrize(
    ("maneuver", "channel", "limit"),
    [(0, "p", 0.12), (1, "q", 0.086), (2, "r", 0.081), (3, "p", 0.25), (3, "r", 0.30), (3, "beta", 0.25)],
)
def test_figures_asked_for(job: FittedModel, maneuver: int, channel: str, limit: float) -> None:
    found = job.result.maneuvers[maneuver]
    assert found.role == ("validation" if maneuver == 3 else "fit")
    assert found.channels[channel].theil <= limit
    assert found.channels[channel].theil < found.channels[channel].baseline_theil


def test_confirmed_optimum_inside_its_box(job: FittedModel) -> None:
    result = job.result
    assert result.status == "converged"
    assert not [name for name, p in result.parameters.items() if p.at_bound]


@pytest.mark.parametrize(
    ("name", "sign"),
    [
        ("CLalpha", 1), ("Cmalpha", -1), ("Cmq", -1), ("Cmelevator", -1), ("CQbeta", -1), ("Clbeta", -1), ("Clp", -1),
        ("Claileron", 1), ("Cnbeta", 1), ("Cnr", -1), ("Cnrudder", -1), ("CD0", 1), ("propulsion.CT0", 1),
    ],
)  # fmt: skip
def test_derivatives_have_physical_signs(job: FittedModel, name: str, sign: int) -> None:
    """By the covariance of the model as it is, without what it lacks; moments over inertia, which are what a flight shows."""
    parameters, covariance = job.result.parameters, job.result.covariance
    over = {"Cl": "mass.inertia.xx", "Cm": "mass.inertia.yy", "Cn": "mass.inertia.zz"}.get(name[:2])
    relative = np.zeros(len(covariance.names))
    relative[covariance.names.index(name)] = 1.0 / parameters[name].estimate
    if over:
        relative[covariance.names.index(over)] = -1.0 / parameters[over].estimate
    assert sign * parameters[name].estimate > 0.0
    assert (relative @ covariance.matrix @ relative) ** 0.5 < 0.7


def test_splits_at_the_dropout(job: FittedModel) -> None:
    """142.47 to 142.75 s is missing in the roll maneuver: two segments, each with its own initial state."""
    segments = job.result.maneuvers[0].segments
    assert len(segments) == 2
    assert segments[0][1] < 142.5 < 142.7 < segments[1][0]


def test_wind_and_pitot_fault_are_reported(job: FittedModel) -> None:
    wind = job.result.wind[0]
    assert wind.values["wind_e"].estimate == pytest.approx(-3.2, abs=0.8)
    assert any("pitot fault" in str(note) for note in wind.notes)


def test_wind_learns_nothing_from_the_predicted_window(shared_data: Path) -> None:
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    outside = without(flight, [(187.0, 196.0)])
    assert outside.air is not None
    assert flight.air is not None
    assert outside.air.wind_n != flight.air.wind_n


def test_says_that_plain_cramer_rao_is_too_small(job: FittedModel) -> None:
    methods = job.result.uncertainty
    corrected, white = (methods[k].parameters for k in ("corrected", "cramer_rao"))
    ratios = [corrected[n].std_error / white[n].std_error for n in corrected]
    assert sorted(ratios)[len(ratios) // 2] > 2.0
    assert any("Cramer-Rao" in str(s) for s in job.result.basis)


def test_the_posterior_mixes(shared_data: Path) -> None:
    """32 parameters of lateral motion, at a quarter of the usual rate: R-hat at most 1.01, widths those of the covariance."""
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2", rate=25.0)
    vehicle = load_vehicle(EXAMPLE).reduced("lateral")
    # these two windows alone fit moments of no body, one of which would be held: the sampler is given all of them
    free = stoop.Strategy.default().without("held-numbers")
    job = stoop.fit(vehicle, flight, ["140:145", "160:168.3"], strategy=free)
    result = job.assess(Posterior()).result
    found, covariance = result.uncertainty["posterior"], result.covariance
    assert found.figures["rhat"] <= 1.01
    assert min(found.figures["ess_bulk"], found.figures["ess_tail"]) >= 400.0
    std = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)), strict=True))
    ratios = [p.std_error / std[n] for n, p in found.parameters.items()]
    assert len(ratios) == 32
    assert min(ratios) > 1.0 / 1.5
    assert max(ratios) < 1.5


def test_filter_error_finds_its_maximum_where_intensities_vanish(shared_data: Path) -> None:
    """Noise intensities of this flight lie at their bounds and innovations are colored: far from Fisher's assumptions."""
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    found = stoop.fit(EXAMPLE, flight, ["140:145", "146:152", "160:168.3"], method="filter-error")
    assert found.result.status == "converged"
