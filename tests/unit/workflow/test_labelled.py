"""A finished fit as tables, arrays, pages and windows in the forms that users of pandas and xarray expect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import FlightError, StoopError
from stoop.flight import Flight
from stoop.problem.windows import Window, as_windows
from stoop.workflow import FittedModel


@pytest.mark.parametrize(
    "given",
    [
        "0:20",
        (0, 20),
        (0.0, 20.0),
        slice(0, 20),
        ["0:20"],
        [(0, 20)],
        [slice(0.0, 20.0)],
        Window("sim", 0.0, 20.0),
    ],
)
def test_a_window_in_every_form(given: object, flight: Flight) -> None:
    flights = {"sim": flight}
    assert as_windows(given, flights) == (Window("sim", 0.0, 20.0),)  # type: ignore[arg-type]


def test_several_windows_and_none(flight: Flight) -> None:
    flights = {"sim": flight}
    assert [w.stop for w in as_windows(["0:2", (3, 4), slice(5, 6)], flights)] == [2.0, 4.0, 6.0]
    assert as_windows((), flights) == ()
    with pytest.raises(FlightError, match="START:STOP"):
        as_windows((1, "x"), flights)  # type: ignore[arg-type]


def test_a_parameter_in_one_step(job: FittedModel) -> None:
    one = job.parameters["CLalpha"]
    table = job.to_dataframe()
    assert list(table.index) == list(job.parameters)
    assert table.loc["CLalpha", "estimate"] == one.estimate
    assert table.loc["CLalpha", "std_error"] == one.std_error


def test_labelled_arrays(job: FittedModel) -> None:
    data = job.to_xarray()
    assert list(data["parameter"].to_numpy()) == list(job.parameters)
    np.testing.assert_allclose(
        np.sqrt(np.diag(data["covariance"])), data["std_error"], rtol=1e-6, equal_nan=True
    )
    fitted = data.where(data["role"] == "fit", drop=True)
    np.testing.assert_array_equal(fitted["measured"] - fitted["simulated"], fitted["residual"])
    trace = job.traces[0]
    np.testing.assert_array_equal(
        data["measured"].sel(channel="q").to_numpy()[: trace.time.size], trace.channels["q"].measured
    )
    assert data.sel(parameter="CLalpha", parameter_2="CLalpha")["covariance"] > 0.0


def test_no_draws_without_a_posterior(job: FittedModel) -> None:
    with pytest.raises(StoopError, match="Posterior"):
        job.to_arviz()


def test_draws_are_read_as_inference_data(job: FittedModel, tmp_path: Path) -> None:
    arviz = pytest.importorskip("arviz")
    draws = np.random.default_rng(0).normal(4.8, 0.1, (4, 50))
    arviz.from_dict(posterior={"CLalpha": draws}, sample_stats={"lp": -(draws**2)}).to_netcdf(
        str(tmp_path / "posterior.nc"), engine="h5netcdf"
    )
    content = (tmp_path / "posterior.nc").read_bytes()
    data = replace(job, attachments={"posterior.nc": content}).to_arviz()
    assert isinstance(data, arviz.InferenceData)
    np.testing.assert_array_equal(data.posterior["CLalpha"], draws)
    assert data.posterior["CLalpha"].dims == ("chain", "draw")
    np.testing.assert_array_equal(data.sample_stats["lp"], -(draws**2))


def test_short_texts_and_tables_for_notebooks(job: FittedModel, tmp_path: Path) -> None:
    assert repr(job).startswith("<FittedModel of ")
    assert "\n" not in repr(job)
    assert len(repr(job.result)) < 100
    assert job._repr_html_().count("<tr>") == len(job.parameters) + 1
    page = job.plot.maneuvers()
    assert page._repr_html_().startswith("<iframe srcdoc=")
    assert page.save(tmp_path / "maneuvers.html").read_text("utf-8").count("<svg") > 3
    for plot in (
        job.plot.estimates,
        job.plot.residuals,
        job.plot.uncertainty,
        job.plot.correlation,
        job.plot.report,
    ):
        assert "<section" in plot()._repr_html_().replace("&lt;", "<")
