"""A flight holds arrays, of which a data set is made when it is asked for."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.exporters.log_bytes import Topic, ulog
from stoop.flight import Flight, from_columns, save

TIME = 100.0 + np.arange(50) / 10.0


@pytest.fixture
def flight() -> Flight:
    return from_columns("f", TIME, {"q": np.sin(TIME), "p": np.cos(TIME)}, attributes={"truth": "{}"})


def test_the_data_set_holds_what_the_columns_hold(flight: Flight) -> None:
    texts, data = flight.texts("p"), flight.data
    assert list(data.data_vars) == ["p", "q"] == list(flight.channels)
    np.testing.assert_array_equal(data["time"], TIME)
    np.testing.assert_array_equal(data["q"], np.sin(TIME))
    assert data["p"].attrs == texts
    assert texts["units"] == "rad/s"
    assert data.attrs == {"truth": "{}"} == flight.attributes


def test_a_flight_with_another_data_set(flight: Flight) -> None:
    other = replace(flight, name="g", data=flight.data.assign(r=2.0 * flight.data["q"]))
    assert other.channels == ("p", "q", "r")
    np.testing.assert_array_equal(other.column("r"), 2.0 * np.sin(TIME))
    np.testing.assert_array_equal(other.time, TIME)
    assert flight.names == {"p", "q"}
    other.data.attrs["truth"] = "changed"
    assert (other.attributes["truth"], flight.attributes["truth"]) == ("changed", "{}")


def test_copies_and_pickles(flight: Flight) -> None:
    for _ in range(2):
        for other in (copy.deepcopy(flight), pickle.loads(pickle.dumps(flight))):  # noqa: S301 (ours)
            np.testing.assert_array_equal(other.column("p"), flight.column("p"))
            assert (other.name, other.rate, other.attributes) == ("f", 10.0, {"truth": "{}"})
        assert len(flight.data) == 2


def test_samples_between_two_times(flight: Flight) -> None:
    for start, stop in ((100.0, 104.9), (100.05, 101.0), (99.0, 100.0), (104.95, 200.0), (101.5, 101.5)):
        between = TIME[flight.between(start, stop)]
        np.testing.assert_array_equal(between, TIME[(start <= TIME) & (stop >= TIME)])


def test_reading_and_describing_a_flight_needs_no_heavy_library(flight: Flight, tmp_path: Path) -> None:
    """To import it takes half a second, and Dask comes with it where that is installed."""
    save(flight, tmp_path / "f.nc")
    (tmp_path / "f.ulg").write_bytes(ulog([Topic("a", TIME, {"x": TIME})]))
    script = (
        "import sys, pathlib, stoop.logs as l; from stoop.flight import load, describe; f, u = sys.argv[1:];"
    )
    script += "l.read(pathlib.Path(u)); describe(load(f)); print(*sys.modules)"
    command = [sys.executable, "-c", script, tmp_path / "f.nc", tmp_path / "f.ulg"]
    told = subprocess.run(command, check=True, capture_output=True, text=True)
    assert not {"xarray", "pandas", "dask", "pyulog", "numba", "sympy"} & set(told.stdout.split())
