"""Assessments and modes of a job: the same for any number of workers, written, refused; equal maneuvers agree."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.flown import maneuver, with_few_free

from stoop.assessment.assessment import Finding, Watch, pack, unpack
from stoop.assessment.bootstrap import CHUNK, bootstrap_plan
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.modes import conditions, modes
from stoop.assessment.uncertainty import repeatability, scatter
from stoop.base.notices import notice
from stoop.errors import IdentificationError, OutputError, SimulationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import fit
from stoop.flight import Flight
from stoop.parallel import Given, LocalProcesses, Plan, execute
from stoop.problem.windows import Window
from stoop.report.identification import render
from stoop.results.result import from_json
from stoop.results.uncertainty import MethodIntervals, Repeatability, SingleEstimate
from stoop.simulation import linearize, trim
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle
from stoop.workflow import Bootstrap, FittedModel, Posterior, Profile
from stoop.workflow.identification import finish, search
from stoop.workflow.summary import repeatability_lines


def plan_of(job: FittedModel, count: int) -> Plan:
    return bootstrap_plan(job.estimate, ErrorBars.of(job.estimate), 0, count)


def here() -> Given:
    return Given(ThreadPoolExecutor(1))


def test_a_problem_comes_back_from_text_to_the_last_bit(job: FittedModel) -> None:
    problem = job.estimate.refit_problem
    z, rung = job.estimate.z, len(problem.prices) - 1
    again, arrays = unpack(pack(problem, {"z": z}))
    assert again.problem.layout.vehicle.structure == problem.problem.layout.vehicle.structure
    assert np.array_equal(arrays["z"], z)
    assert np.array_equal(again.residuals(z[None], rung), problem.residuals(z[None], rung))
    assert pack(problem, {"z": z}) == pack(again, {"z": z})


@pytest.fixture(scope="module")
def bootstrapped(job: FittedModel) -> FittedModel:
    return job.assess(Bootstrap(100, pool=here()))


def test_the_bootstrap_agrees_with_corrected_errors_on_white_noise(bootstrapped: FittedModel) -> None:
    methods = bootstrapped.result.uncertainty
    bootstrap, corrected = (methods[one].parameters for one in ("bootstrap", "corrected"))
    ratios = [one.std_error / corrected[name].std_error for name, one in bootstrap.items()]
    assert 0.85 < float(np.median(ratios)) < 1.15
    assert methods["bootstrap"].figures == {"replicates": 100.0, "refined": 0.0, "failed": 0.0}
    assert any("Bootstrap" in str(s) for s in bootstrapped.result.trust)


def test_any_number_of_workers_gives_the_same_replicates(job: FittedModel, tmp_path: Path) -> None:
    plan = plan_of(job, 3 * CHUNK)
    one, two = (execute(plan, tmp_path / f"{n}.sqlite", LocalProcesses(n)) for n in (1, 2))
    assert one == two
    assert one == execute(plan, tmp_path / "threads.sqlite", here())


def test_more_replicates_keep_the_first(job: FittedModel, tmp_path: Path) -> None:
    few = execute(plan_of(job, CHUNK), tmp_path / "a.sqlite", here())
    more = execute(plan_of(job, 2 * CHUNK), tmp_path / "a.sqlite", here())
    assert few["000000"] == more["000000"]
    assert len(more) == 2


def test_a_profile_of_what_the_data_tell_is_the_corrected_interval(job: FittedModel) -> None:
    found = job.assess(Profile(("Cmq",), here())).result
    profile, corrected = (found.uncertainty[m].parameters["Cmq"] for m in ("profile", "corrected"))
    assert profile.std_error == pytest.approx(corrected.std_error, rel=0.03)
    assert set(found.uncertainty["profile"].parameters) == {"Cmq"}
    assert found.uncertainty["profile"].notes[0].code == "profile-of-some-parameters"


def test_other_names_and_methods_are_refused(job: FittedModel) -> None:
    with pytest.raises(IdentificationError, match="did you mean Cmq"):
        job.assess(Profile(("Cmqq",), here()))
    told = replace(job, result=replace(job.result, method="equation-error"))
    with pytest.raises(IdentificationError, match="output-error"):
        told.assess(Bootstrap(40, pool=here()), Profile(("Cmq",), here()))


def test_the_result_says_all_of_it_in_json(bootstrapped: FittedModel) -> None:
    result = bootstrapped.result
    again = from_json(result.to_json())
    assert again.uncertainty.keys() == {"corrected", "cramer_rao", "bootstrap"}
    assert [*map(str, again.trust)] == [*map(str, result.trust)]
    assert again.identifiability.singular_values == result.identifiability.singular_values
    assert again.identifiability.parameters["Cmq"] == result.identifiability.parameters["Cmq"]


def test_attachments_lie_beside_the_result_and_go_with_it(job: FittedModel, tmp_path: Path) -> None:
    class Told:
        name = "told"

        def __call__(self, fit: Estimate, bars: ErrorBars, seed: int, watch: Watch) -> Finding:
            watch("telling")
            return Finding(MethodIntervals({}), {"posterior.nc": b"abc"})

    heard: list[str] = []
    told = job.assess(Told(), watch=heard.append)
    folder = told.save(tmp_path / "out")
    assert heard == ["telling"]
    assert (folder / "posterior.nc").read_bytes() == b"abc"
    with pytest.raises(OutputError, match="exists already"):
        told.save(folder)
    job.save(folder, overwrite=True)
    assert not (folder / "posterior.nc").exists()


def test_the_posterior_is_read_back_by_arviz(job: FittedModel, tmp_path: Path) -> None:
    import arviz

    assessed = job.assess(Posterior())
    data = arviz.from_netcdf(str(assessed.save(tmp_path / "out") / "posterior.nc"), engine="h5netcdf")
    assert assessed.to_arviz().posterior.equals(data.posterior)
    result = assessed.result
    for name, spread in result.uncertainty["posterior"].parameters.items():
        assert float(data.posterior[name].std()) == pytest.approx(spread.std_error, rel=0.1)
        assert data.posterior[name].attrs["units"] == result.parameters[name].unit
        corrected = result.uncertainty["corrected"].parameters[name].std_error
        assert spread.std_error == pytest.approx(corrected, rel=0.15)
    assert result.uncertainty["posterior"].figures["rhat"] <= 1.01
    assert result.uncertainty["posterior"].figures["marginalization_error"] < 0.1


FREE = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")


def repeated(truth: Vehicle, flown: dict[int, Vehicle]) -> FittedModel:
    moved = maneuver(8.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05))
    flights = [simulate_flight(one, moved, seed, name=f"flight{seed}") for seed, one in flown.items()]
    done = search(truth, flights, [f"{flight.name}@0:8" for flight in flights])
    job = finish(done)
    found = repeatability(done.estimate, done.flights, done.options, lambda _: None)
    return job.with_result(replace(job.result, repeatability=found))


def test_maneuvers_of_one_aircraft_agree_and_one_of_another_stands_out(aircraft: Vehicle) -> None:
    truth = with_few_free(aircraft, FREE)
    alike = repeated(truth, dict.fromkeys(range(4, 8), truth))
    found = alike.result.repeatability
    assert found.maneuvers == (0, 1, 2, 3)
    for name in FREE:
        one, joint = found.parameters[name], alike.result.parameters[name]
        assert one.degrees == 3
        assert one.p_value > 0.001
        assert abs(one.mean - truth.value(name)) < 4.0 * one.std_error
        assert one.std_error == pytest.approx(joint.std_error, rel=0.4)
        assert abs(one.mean - joint.estimate) < 2.0 * joint.std_error
    first, *others = repeatability_lines(found)
    summary = found.summary()
    assert (summary.code, summary.values["compared"], first) == ("repeatability", 4, str(summary))
    assert sorted(n for line in others for n in FREE if f"{n} (4 maneuvers" in line) == sorted(FREE)
    assert "each maneuver fitted alone" in render(alike)
    other = truth.with_numbers({"Cmq": {"value": 1.6 * truth.value("Cmq")}})
    scattered = repeated(truth, {0: truth, 1: truth, 2: other}).result.repeatability
    assert scattered.parameters["Cmq"].verdict == "scatter"
    line = next(line for line in repeatability_lines(scattered) if line.startswith("scatter: "))
    assert "Cmq (3 maneuvers, p = " in line


def test_what_only_one_maneuver_tells_is_not_compared() -> None:
    one, none = SingleEstimate(1.0, 0.1, True), SingleEstimate(1.0, 0.1, False)
    found = Repeatability((0, 1), {"CLalpha": scatter([one, none])}, (notice("maneuver-stopped", "f 1:2"),))
    assert found.summary().code == "repeatability-nothing-compared"
    assert repeatability_lines(found) == [str(found.summary()), "f 1:2: left out, stopped by the user"]
    assert repeatability_lines(Repeatability()) == []


def test_the_result_has_the_modes_of_its_flight_condition(job: FittedModel) -> None:
    (condition,) = job.result.modes
    assert (condition.maneuvers, condition.about, condition.remark) == ((0,), "trim", None)
    flown = job.flights[0].column("V")[job.flights[0].time <= 20.0]
    assert condition.airspeed == pytest.approx(float(np.mean(flown)), rel=0.01)
    steady = trim(job.vehicle, condition.airspeed, condition.altitude)
    known = {m.name: m for m in linearize(job.vehicle, steady).modes}
    assert {m.name for m in condition.modes} == {"short period", "phugoid"}
    for mode in condition.modes:
        assert mode.frequency.estimate == pytest.approx(known[mode.name].frequency, rel=1e-6)
        assert mode.damping.estimate == pytest.approx(known[mode.name].damping, rel=1e-6)
        assert 0.0 < mode.frequency.std_error < 0.2 * mode.frequency.estimate
        assert [seen.maneuver for seen in mode.measured] == [0]


def test_without_a_trim_about_the_mean_state(job: FittedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise SimulationError("none found")

    monkeypatch.setattr("stoop.assessment.modes.trim", fails)
    covariance = job.result.covariance
    (condition,) = modes(job.estimate, covariance.names, covariance.matrix)
    assert condition.about == "mean state"
    assert condition.remark is not None
    assert condition.remark.code == "modes-about-mean-state"
    short, trimmed = (next(m for m in c.modes if "short" in m.name) for c in (condition, job.result.modes[0]))
    assert short.frequency.estimate == pytest.approx(trimmed.frequency.estimate, rel=0.05)
    assert short.frequency.std_error > 0.0


def test_maneuvers_alike_are_one_condition(wrong: Vehicle, flight: Flight) -> None:
    windows = [Window("a", 0.0, 8.0), Window("b", 0.0, 8.0), Window("a", 10.0, 20.0)]
    found = fit(with_few_free(wrong, ["Cmq"]), {name: replace(flight, name=name) for name in "ab"}, windows)
    assert [c.maneuvers for c in conditions(found)] == [(0, 1), (2,)]  # the phugoid was 6 % slower later


def test_intervals_hold_the_truth_as_often_as_they_should(aircraft: Vehicle) -> None:
    vehicle, off = with_few_free(aircraft, ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")), []
    flown = maneuver(12.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05))
    for seed in range(30):
        flight = simulate_flight(vehicle, flown, seed, name="sim")
        found = fit(vehicle, {"sim": flight}, [Window("sim", 0.0, 12.0)])
        names = tuple(p.name for p in found.problem.layout.parameters)
        (condition,) = modes(found, names, ErrorBars.of(found).covariance[: len(names), : len(names)])
        short = next(m for m in condition.modes if m.name == "short period")
        truth = linearize(vehicle, trim(vehicle, condition.airspeed, condition.altitude)).modes[0]
        off.append((short.frequency.estimate - truth.frequency) / short.frequency.std_error)
        off.append((short.damping.estimate - truth.damping) / short.damping.std_error)
    assert np.mean(np.abs(off) < 1.96) >= 0.85  # 60 intervals: 95 % less three standard errors
    assert np.std(off) == pytest.approx(1.0, abs=0.3)
