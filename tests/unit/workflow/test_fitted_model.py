"""A fitted model in memory and in its folder: every verb gives the same numbers, and nothing is written unasked."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stoop
from stoop.errors import FlightError, SimulationError, StoopError
from stoop.flight import Flight
from stoop.parallel import Given
from stoop.results.verdict import Verdict
from stoop.workflow.outputs import ARCHIVES


@pytest.fixture(scope="module")
def folder(job: stoop.FittedModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return job.save(tmp_path_factory.mktemp("model") / "result")


@pytest.fixture(scope="module")
def again(folder: Path) -> stoop.FittedModel:
    return stoop.load(folder)


def other(flight: Flight) -> Flight:
    """Return another record."""
    return replace(
        flight, name="other", data=flight.data.assign_coords(time=flight.data["time"] + 50.0), path=None
    )


def bootstrapped(model: stoop.FittedModel) -> Any:
    pool = Given(ThreadPoolExecutor(1))
    found = model.assess(stoop.Bootstrap(40, pool=pool)).result.uncertainty["bootstrap"].parameters
    return {name: (one.std_error, one.ci95_lower) for name, one in found.items()}


VERBS: dict[str, Callable[[stoop.FittedModel], Any]] = {
    "validate": lambda m: m.validate(other(m.flights[0]), "70:78").record.maneuvers,
    "predict from a state": lambda m: (
        m.predict(other(m.flights[0]), "70:78", initial_state={"alpha": 0.1}).record.maneuvers
    ),
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
def test_a_loaded_model_does_what_the_model_did(
    verb: str, job: stoop.FittedModel, again: stoop.FittedModel
) -> None:
    np.testing.assert_equal(_plain(VERBS[verb](again)), _plain(VERBS[verb](job)))


def _plain(value: Any) -> Any:
    """Return arrays, nested dataclasses and bytes as something that compares entry by entry."""
    return repr(value) if not isinstance(value, tuple | dict | np.ndarray | str | bytes) else value


def test_a_loaded_model_is_saved_as_the_same_files(
    folder: Path, again: stoop.FittedModel, tmp_path: Path
) -> None:
    copy = again.save(tmp_path / "copy")
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
    with pytest.raises(
        StoopError, match=r"old: estimate.npz is missing, so that the fit cannot be assessed"
    ) as said:
        old.assess(stoop.Bootstrap(40))
    assert "\n" not in str(said.value)
    assert stoop.load(old.save(tmp_path / "new")).parameters.keys() == old.parameters.keys()


@pytest.mark.parametrize("name", ARCHIVES)
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 damaged"])
def test_a_damaged_archive_is_one_line(folder: Path, tmp_path: Path, name: str, content: bytes) -> None:
    shutil.copytree(folder, tmp_path / "r")
    (tmp_path / "r" / name).write_bytes(content)
    with pytest.raises(StoopError, match=rf"{name}") as said:
        _ = stoop.load(tmp_path / "r").estimate
    assert "\n" not in str(said.value)


def test_the_estimate_of_another_fit_is_refused(job: stoop.FittedModel, folder: Path) -> None:
    parameters = {n: replace(p, estimate=1.01 * p.estimate) for n, p in job.parameters.items()}
    mixed = replace(stoop.load(folder), result=replace(job.result, parameters=parameters))
    with pytest.raises(StoopError, match=r"holds another fit than result\.json beside it"):
        _ = mixed.estimate


def test_nothing_is_written_unasked(job: stoop.FittedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a file was written")

    for name in ("write_text", "write_bytes", "mkdir"):
        monkeypatch.setattr(Path, name, refused)
    for verb in ("validate", "propagate", "linearize", "frequency", "export"):
        VERBS[verb](job)


def test_a_prediction_from_a_given_state_is_the_simulation_from_it(job: stoop.FittedModel) -> None:
    """Against a simulation of the same inputs by the function that makes flights, which shares no code with predictions."""
    start, flight = {"V": 34.0, "alpha": 0.03, "q": 0.01, "theta": 0.02}, other(job.flights[0])
    found = job.predict(flight, "70:74", initial_state=start).model.traces[0]
    biases = {name: {"value": prior.mean} for name, prior in job.biases("other").items()}
    vehicle = job.vehicle.with_numbers(biases)
    inside = flight.between(70.0, 74.0)
    inputs = {name: flight.column(name)[inside] for name in vehicle.recorded}
    altitude = float(flight.column("altitude")[inside][0]) if "altitude" in flight.names else 200.0
    naive = stoop.simulate(vehicle, inputs, flight.time[inside], altitude=altitude, initial_state=start)
    for name in ("V", "alpha", "q", "theta"):
        simulated = found.channels[name].simulated
        np.testing.assert_allclose(simulated, naive.column(name), rtol=2e-3, atol=2e-4, err_msg=name)
    assert found.channels["V"].simulated[0] == pytest.approx(
        34.0 + job.vehicle.value("sensors.V.bias", 0.0), abs=0.5
    )


def test_the_measured_state_is_the_default_of_what_is_not_given(job: stoop.FittedModel) -> None:
    flight = other(job.flights[0])
    measured, none, some = (
        job.predict(flight, "70:74", initial_state=state).model.traces[0].channels["V"].simulated
        for state in ("measured", {}, {"V": 40.0})
    )
    assert np.array_equal(measured, none)
    assert abs(measured[0] - flight.column("V")[flight.between(70.0, 74.0)][0]) < 1.0
    assert some[0] == pytest.approx(40.0, abs=0.5)


@pytest.mark.parametrize(
    ("state", "says"), [({"alfa": 0.1}, "did you mean alpha"), ({"V": np.nan}, "V is nan")]
)
def test_a_wrong_state_is_one_line(job: stoop.FittedModel, state: dict[str, float], says: str) -> None:
    flight = other(job.flights[0])
    with pytest.raises(SimulationError, match=says):
        job.predict(flight, "70:74", initial_state=state)
    with pytest.raises(SimulationError, match=says):
        job.simulate({"elevator": np.zeros(9)}, 0.02 * np.arange(9.0), initial_state=state)


ROUGHLY: dict[str, Callable[[stoop.FittedModel], Any]] = {
    "model": lambda m: m,
    "result": lambda m: m.result,
    "plots": lambda m: m.plot,
    "page": lambda m: m.plot(),
    "flight": lambda m: m.flights[0],
    "page of a flight": lambda m: m.flights[0].plot(),
    "vehicle": lambda m: m.vehicle,
    "parameters of the vehicle": lambda m: m.vehicle.parameters,
    "validated": lambda m: m.predict(other(m.flights[0]), "70:78"),
    "propagated": lambda m: m.propagate(draws=100),
    "linear": lambda m: m.linearize(airspeed=33.0),
    "frequency": lambda m: m.frequency(m.flights[0]),
    "exported": lambda m: m.export("state-space"),
    "derivatives": lambda m: stoop.derivatives("twin-boom"),
    "dimensional derivatives": lambda m: stoop.derivatives("twin-boom", dimensional=True),
    "verdict": lambda m: m.verdict,
}


@pytest.mark.parametrize("name", ROUGHLY)
def test_no_text_of_an_object_is_long(name: str, job: stoop.FittedModel) -> None:
    text = repr(ROUGHLY[name](job))
    assert len(text.splitlines()) <= 10
    assert len(text) < 1000


def test_a_model_is_printed_with_its_verdict_and_reasons_first(job: stoop.FittedModel) -> None:
    shown = str(job.verdict)
    lines = shown.splitlines()
    assert lines[0] == f"verdict: {job.verdict.headline}"
    assert 3 <= len(lines) <= 10
    assert str(job).startswith(shown + "\n\n")
    assert all(name in str(job).removeprefix(shown) for name in job.parameters)
    page = job._repr_html_()
    assert page.startswith("<p ")
    assert page.index("verdict: ") < page.index("<table>")
    assert str(Verdict()) == "verdict: none was made"


def test_derivatives_and_exports_are_shown_as_what_they_are(job: stoop.FittedModel) -> None:
    found = stoop.derivatives("twin-boom")
    table = found.to_dataframe().set_index("name")
    matrix = [line.split() for line in repr(found).splitlines()[1:-1]]
    assert [row[0] for row in matrix[1:]] == ["CX", "CY", "CZ", "Cl", "Cm", "Cn"]
    for load, *values in matrix[1:]:
        for by, value in zip(matrix[0], values, strict=True):
            assert float(value) == pytest.approx(table.loc[f"{load}_{by}", "value"], rel=6e-3, abs=1e-12)
    assert len(table) == found.tables[0].values.size
    assert table.loc["Cm_alpha", "unit"] == "1"
    exported = job.export("state-space")
    assert all(name in repr(exported) for name in exported.files)
    assert f"{len(exported.files[exported.main])} bytes" in repr(exported)


def test_one_count_of_free_numbers(job: stoop.FittedModel) -> None:
    count = f"{len(job.vehicle.free_parameters)} free parameters"
    assert len(job.vehicle.free_parameters) == len(job.parameters)
    for text in (repr(job), repr(job.vehicle), repr(job.result), job.plot.report()._repr_html_()):
        assert count in text


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


def test_names_and_channels_are_looked_up_or_advised(job: stoop.FittedModel, flight: Flight) -> None:
    first, parameters = next(iter(job.parameters)), job.vehicle.parameters
    assert np.array_equal(flight["q"].to_numpy(), flight.column("q"))
    assert "q" in flight
    assert parameters[first] is next(p for p in parameters if p.name == first)
    assert parameters[0] is next(iter(parameters))
    lookups: tuple[Callable[[], Any], ...] = (
        lambda: flight["qq"],
        lambda: parameters[first + "x"],
        lambda: job.parameters[first + "x"],
    )
    for lookup in lookups:
        with pytest.raises(KeyError, match="did you mean"):
            lookup()


def test_a_keyword_is_an_option_or_advised(
    job: stoop.FittedModel, wrong: stoop.Vehicle, flight: Flight
) -> None:
    regression = stoop.fit(wrong, flight, "0:20", method="equation-error", seed=1)
    assert (regression.result.method, regression.result.seed) == ("equation-error", 1)
    calls: tuple[Callable[[], Any], ...] = (
        lambda: stoop.fit(wrong, flight, "0:20", metod="equation-error"),
        lambda: stoop.propagate(job, expresions={}),
        lambda: job.design(durations=3.0),
    )
    for call in calls:
        with pytest.raises(TypeError, match="did you mean"):
            call()
    with pytest.raises(AttributeError, match="did you mean fit"):
        _ = stoop.fitt


def test_exchanged_arguments_are_named(job: stoop.FittedModel, wrong: stoop.Vehicle, flight: Flight) -> None:
    with pytest.raises(StoopError, match="vehicle is expected first, not a Flight"):
        stoop.fit(flight, wrong, "0:20")
    with pytest.raises(StoopError, match=r"not a Flight; give what stoop\.fit returns"):
        stoop.predict(flight, job)
    with pytest.raises(StoopError, match="a flight is expected, not the vehicle"):
        stoop.check(wrong)


@pytest.mark.parametrize(
    ("damage", "match"),
    [
        (lambda a: a | {"0.time": a["0.time"][:, None]}, "is no curve"),
        (
            lambda a: {k: x.astype(np.int8) if k.startswith("0.input") else x for k, x in a.items()},
            "is no curve",
        ),
    ],
)
def test_curves_are_columns_of_double_precision(
    folder: Path, tmp_path: Path, damage: Callable[[Any], Any], match: str
) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    with np.load(copy / "traces.npz") as file:
        arrays = dict(file)
    np.savez(copy / "traces.npz", **damage(arrays))
    with pytest.raises(StoopError, match=match):
        stoop.load(copy)


@pytest.mark.parametrize(
    "process",
    [
        {"states": ["u"], "intensities": [], "share": 0.0},
        {"states": ["u"], "intensities": [-1.0], "share": 0.0},
        {"states": ["u"], "intensities": [None], "share": 0.0},
        {"states": ["u"], "intensities": [1.0], "share": 2.0},
    ],
)
def test_process_noise_has_positive_intensities(folder: Path, tmp_path: Path, process: Any) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    document = json.loads((copy / "result.json").read_text())
    document["process_noise"] = {"gain": "steady", **process}
    (copy / "result.json").write_text(json.dumps(document))
    with pytest.raises(StoopError, match="process noise without positive intensities"):
        stoop.load(copy)
