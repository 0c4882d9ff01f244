"""A fitted model in memory and in its folder: every verb gives the same numbers, and nothing is written unasked."""

import pickle
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stoop
from stoop.errors import FlightError, SimulationError, StoopError, StoopWarning
from stoop.flight import Flight, from_columns
from stoop.parallel import Given
from stoop.results.verdict import Verdict
from stoop.workflow.outputs import ARCHIVES


@pytest.fixture(scope="module")
def again(folder: Path) -> stoop.FittedModel:
    return stoop.load(folder)


def other(flight: Flight) -> Flight:
    moved = flight.data.assign_coords(time=flight.data["time"] + 50.0)
    return replace(flight, name="other", data=moved, path=None)


def bootstrapped(model: stoop.FittedModel) -> Any:
    pool = Given(ThreadPoolExecutor(1))
    found = model.assess(stoop.Bootstrap(40, pool=pool)).result.uncertainty["bootstrap"].parameters
    return {name: (one.std_error, one.ci95_lower) for name, one in found.items()}


VERBS: dict[str, Callable[[stoop.FittedModel], Any]] = {
    "validate": lambda m: m.validate(other(m.flights[0]), "70:78").record.maneuvers,
    "propagate": lambda m: m.propagate(draws=100).to_dataframe().to_csv(),
    "linearize": lambda m: (m.linearize(airspeed=33.0).A, m.linearize(airspeed=33.0).outputs),
    "simulate": lambda m: m.simulate({"elevator": np.zeros(50)}, 0.02 * np.arange(50.0))["q"].values,
    "frequency": lambda m: m.frequency(m.flights[0]).to_dict(),
    "export": lambda m: m.export("state-space").files,
    "assess": bootstrapped,
    "to_dataframe": lambda m: m.to_dataframe().to_csv(),
    "to_xarray": lambda m: m.to_xarray().to_dict(),
    "page": lambda m: m.plot.maneuvers()._repr_html_(),
    "text": str,
}


@pytest.mark.parametrize("verb", VERBS)
def test_a_loaded_model_does_what_the_model_did_and_nothing_is_written_unasked(
    verb: str, job: stoop.FittedModel, again: stoop.FittedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a file was written")

    for name in ("write_text", "write_bytes", "mkdir") * (verb != "assess"):  # it keeps a store of its runs
        monkeypatch.setattr(Path, name, refused)
    found, expected = (VERBS[verb](one) for one in (again, job))
    if not isinstance(found, tuple | dict | np.ndarray | str | bytes):
        found, expected = repr(found), repr(expected)
    np.testing.assert_equal(found, expected)


@pytest.mark.parametrize("copied", ["loaded", "pickled"])
def test_a_copy_of_a_model_saves_the_same_files(
    copied: str, folder: Path, again: stoop.FittedModel, job: stoop.FittedModel, tmp_path: Path
) -> None:
    copy = (again if copied == "loaded" else pickle.loads(pickle.dumps(job))).save(tmp_path / "copy")  # noqa: S301
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(path.name for path in copy.iterdir())
    for name in set(names) - {"flight.nc"}:
        assert (copy / name).read_bytes() == (folder / name).read_bytes(), name
    one, two = (stoop.load_flight(place / "flight.nc") for place in (folder, copy))
    assert one.channels == two.channels
    for channel in one.channels:
        assert np.array_equal(one.column(channel), two.column(channel), equal_nan=True), channel


def test_an_older_folder_loads_and_says_what_is_missing(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "old")
    for name in ARCHIVES:
        (tmp_path / "old" / name).unlink()
    old = stoop.load(tmp_path / "old")
    assert old.validate(other(old.flights[0]), "70:78").record.maneuvers
    with pytest.raises(StoopError, match=r"^.*old: estimate.npz is missing, so that the fit cannot be .*$"):
        old.assess(stoop.Bootstrap(40))
    assert stoop.load(old.save(tmp_path / "new")).parameters.keys() == old.parameters.keys()


def test_a_prediction_from_a_given_state_is_the_simulation_from_it(job: stoop.FittedModel) -> None:
    """Against a simulation of the same inputs by the function that makes flights, which shares no code with predictions."""
    start, flight = {"V": 34.0, "alpha": 0.03, "q": 0.01, "theta": 0.02}, other(job.flights[0])
    runs = [job.predict(flight, "70:74", initial_state=s).model for s in (start, "measured", {})]
    found, measured, none = ({n: c.simulated for n, c in run.traces[0].channels.items()} for run in runs)
    inside = flight.between(70.0, 74.0)
    assert np.array_equal(measured["V"], none["V"]), "of what is not given"
    assert abs(measured["V"][0] - flight.column("V")[inside][0]) < 1.0
    vehicle = job.vehicle.with_numbers({n: {"value": prior.mean} for n, prior in job.biases("other").items()})
    inputs = {name: flight.column(name)[inside] for name in vehicle.recorded}
    altitude = float(flight.column("altitude")[inside][0]) if "altitude" in flight.names else 200.0
    naive = stoop.simulate(vehicle, inputs, flight.time[inside], altitude=altitude, initial_state=start)
    for name in start:
        np.testing.assert_allclose(found[name], naive.column(name), rtol=2e-3, atol=2e-4, err_msg=name)
    assert found["V"][0] == pytest.approx(34.0 + job.vehicle.value("sensors.V.bias", 0.0), abs=0.5)


def test_a_wrong_state_is_one_line(job: stoop.FittedModel) -> None:
    flight, time = other(job.flights[0]), 0.02 * np.arange(9.0)
    for state, says in (({"alfa": 0.1}, "did you mean alpha"), ({"V": np.nan}, "V is nan")):
        with pytest.raises(SimulationError, match=says):
            job.predict(flight, "70:74", initial_state=state)
        with pytest.raises(SimulationError, match=says):
            job.simulate({"elevator": np.zeros(9)}, time, initial_state=state)
    for start in ("measurd", {"alpha": "x"}, 3):
        with pytest.raises(StoopError, match=r"initial.state"):
            job.validate(flight, ["70:74"], initial_state=start)  # type: ignore[arg-type]


RANGE, NUMBER = "give LOW:HIGH, the lower number first, from 0", "give a number from"
ODD: dict[str, tuple[Any, ...]] = {
    RANGE: ((20.0,), 33.0, "33", (40.0, 30.0), (np.nan, 30.0), (-5.0, 30.0), ("a", "b")),
    NUMBER: ("x", np.nan, (20.0, 30.0), -20000.0),
}


def test_conditions_that_cannot_be_are_one_line_and_those_not_flown_are_named(job: stoop.FittedModel) -> None:
    flight, time = job.flights[0], 0.02 * np.arange(999.0)
    for verb, name, said in (
        (job.propagate, "airspeed", RANGE), (partial(job.tune, {}), "airspeed", RANGE), (job.linearize, "altitude", NUMBER),
        (partial(job.frequency, flight), "band", RANGE), (partial(stoop.trim, job.vehicle), "airspeed", NUMBER),
    ):  # fmt: skip
        for value in ODD[said]:
            with pytest.raises(SimulationError, match=f"^{name} .*: {said}"):
                verb(**{name: value})
    with pytest.warns(StoopWarning, match=r"200 m/s: the fitted maneuvers were flown at 3\d"):
        job.linearize(airspeed=200.0)
    with pytest.raises(FlightError, match=r"sensors: holds no input of .* \(elevator\)"):
        job.frequency(from_columns("sensors", time, {"q": np.sin(time)}))
    with pytest.raises(FlightError, match="no flight is given"):
        stoop.find_windows({})


def test_texts_of_a_model_are_short_and_begin_with_its_verdict(job: stoop.FittedModel) -> None:
    shown, page = str(job.verdict), job._repr_html_()
    assert shown.startswith(f"verdict: {job.verdict.headline}\n")
    assert 3 <= len(shown.splitlines()) <= 10
    assert str(job).startswith(shown + "\n\n")
    assert all(name in str(job).removeprefix(shown) for name in job.parameters)
    assert page.startswith("<p ")
    assert page.index("verdict: ") < page.index("<table>")
    assert page.count("<tr>") == len(job.parameters) + 1
    assert str(Verdict()) == "verdict: none was made"
    made = (job.linearize(airspeed=33.0), job.export("state-space"), stoop.derivatives("twin-boom"))
    own = (job, job.result, job.plot, job.flights[0], job.vehicle, job.vehicle.parameters, job.verdict)
    for text in map(repr, (*own, *made)):
        assert (len(text.splitlines()) <= 10, len(text) < 1000) == (True, True)


def test_a_table_or_dataset_is_a_flight_everywhere(job: stoop.FittedModel) -> None:
    flight = other(job.flights[0])
    dataset = flight.data.assign_attrs(name="other")
    table = dataset.to_dataframe().reset_index()
    table.attrs["name"] = "other"
    expected = job.predict(flight, "70:74").record.maneuvers[0].channels["q"].rmse
    for given in (dataset, table):
        found = job.predict(given, "70:74").record.maneuvers[0].channels["q"].rmse
        assert found == pytest.approx(expected, rel=1e-6)
        assert job.frequency(given).responses
        assert stoop.look(given) is not None
        stoop.check(given)
    with pytest.raises(FlightError, match="no column 'time'"):
        stoop.check(table.drop(columns="time"))


def test_names_are_looked_up_or_advised(job: stoop.FittedModel, wrong: stoop.Vehicle, flight: Flight) -> None:
    first, parameters = next(iter(job.parameters)), job.vehicle.parameters
    assert np.array_equal(flight["q"].to_numpy(), flight.column("q"))
    assert ("q" in flight, parameters[first].name) == (True, first)
    assert parameters[0] is next(iter(parameters))
    regression = stoop.fit(wrong, flight, "0:20", method="equation-error", seed=1)
    assert (regression.result.method, regression.result.seed) == ("equation-error", 1)
    expected = r"not a Flight; give what stoop\.fit returns"
    calls: tuple[tuple[Callable[[], Any], type[Exception], str], ...] = (
        (lambda: flight["qq"], KeyError, "did you mean"),
        (lambda: parameters[first + "x"], KeyError, "did you mean"),
        (lambda: job.parameters[first + "x"], KeyError, "did you mean"),
        (lambda: stoop.fit(wrong, flight, "0:20", metod="equation-error"), TypeError, "did you mean"),
        (lambda: stoop.propagate(job, expresions={}), TypeError, "did you mean"),
        (lambda: job.design(durations=3.0), TypeError, "did you mean"),
        (lambda: stoop.fitt, AttributeError, "did you mean fit"),
        (lambda: stoop.fit(flight, wrong, "0:20"), StoopError, "vehicle is expected first, not a Flight"),
        (lambda: stoop.predict(flight, job), StoopError, expected),
        (lambda: stoop.check(wrong), StoopError, "a flight is expected, not the vehicle"),
        (lambda: job.plot.maneuvers("validatio"), StoopError, r"no role 'validatio'; did you mean validation\?"),
        (job.to_arviz, StoopError, "Posterior"),
    )  # fmt: skip
    for call, error, match in calls:
        with pytest.raises(error, match=match):
            call()


def test_labelled_tables_and_arrays(job: stoop.FittedModel) -> None:
    table, data = job.to_dataframe(), job.to_xarray()
    assert list(table.index) == list(data["parameter"].to_numpy()) == list(job.parameters)
    for name, one in job.parameters.items():
        assert (table.loc[name, "estimate"], table.loc[name, "std_error"]) == (one.estimate, one.std_error)
    errors = np.sqrt(np.diag(data["covariance"]))
    np.testing.assert_allclose(errors, data["std_error"], rtol=1e-6, equal_nan=True)
    fitted, trace = data.where(data["role"] == "fit", drop=True), job.traces[0]
    np.testing.assert_array_equal(fitted["measured"] - fitted["simulated"], fitted["residual"])
    measured = data["measured"].sel(channel="q").to_numpy()
    np.testing.assert_array_equal(measured[: trace.time.size], trace.channels["q"].measured)
    assert data.sel(parameter="CLalpha", parameter_2="CLalpha")["covariance"] > 0.0


def test_draws_are_read_as_inference_data(job: stoop.FittedModel, tmp_path: Path) -> None:
    arviz = pytest.importorskip("arviz")
    draws = np.random.default_rng(0).normal(4.8, 0.1, (4, 50))
    data = arviz.from_dict(posterior={"CLalpha": draws}, sample_stats={"lp": -(draws**2)})
    data.to_netcdf(str(tmp_path / "posterior.nc"), engine="h5netcdf")
    data = replace(job, attachments={"posterior.nc": (tmp_path / "posterior.nc").read_bytes()}).to_arviz()
    np.testing.assert_array_equal(data.posterior["CLalpha"], draws)
    assert data.posterior["CLalpha"].dims == ("chain", "draw")
    np.testing.assert_array_equal(data.sample_stats["lp"], -(draws**2))


def test_notebooks_show_pages(job: stoop.FittedModel, tmp_path: Path) -> None:
    page = job.plot.maneuvers()
    assert page._repr_html_().startswith("<iframe srcdoc=")
    assert page.save(tmp_path / "maneuvers.html").read_text("utf-8").count("<svg") > 3
    for plot in (job.plot.estimates, job.plot.residuals, job.plot.uncertainty, job.plot.correlation):
        assert "<section" in plot()._repr_html_().replace("&lt;", "<")
