"""A flight holds arrays, of which a data set is made when it is asked for; its files come back bit for bit."""

import copy
import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import LogError, OutputError
from stoop.flight import Fault, Flight, from_columns, load_flight, save_flight
from stoop.flight.flight import AirData
from stoop_plan.log_bytes import Topic, ulog

TIME = 100.0 + np.arange(50) / 10.0
NOTICES = (notice("untyped-flight-note", text="a note: ±1 °C"), notice("gaps", counts=("imu 2", "gps 1")))


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
    other = replace(flight, name="g", data=flight.data.assign(r=2.0 * flight.data["q"]))
    assert other.channels == ("p", "q", "r")
    np.testing.assert_array_equal(other.column("r"), 2.0 * np.sin(TIME))
    np.testing.assert_array_equal(other.time, TIME)
    assert flight.names == {"p", "q"}
    other.data.attrs["truth"] = "changed"
    assert (other.attributes["truth"], flight.attributes["truth"]) == ("changed", "{}")


def test_copies_pickles_and_samples_between_two_times(flight: Flight) -> None:
    for _ in range(2):
        for other in (copy.deepcopy(flight), pickle.loads(pickle.dumps(flight))):  # noqa: S301 (ours)
            np.testing.assert_array_equal(other.column("p"), flight.column("p"))
            assert (other.name, other.rate, other.attributes) == ("f", 10.0, {"truth": "{}"})
        assert len(flight.data) == 2
    for start, stop in ((100.0, 104.9), (100.05, 101.0), (99.0, 100.0), (104.95, 200.0), (101.5, 101.5)):
        between = TIME[flight.between(start, stop)]
        np.testing.assert_array_equal(between, TIME[(start <= TIME) & (stop >= TIME)])


def test_reading_and_describing_a_flight_needs_no_heavy_library(flight: Flight, tmp_path: Path) -> None:
    """To import it takes half a second, and Dask comes with it where that is installed."""
    save_flight(flight, tmp_path / "f.nc")
    (tmp_path / "f.ulg").write_bytes(ulog([Topic("a", TIME, {"x": TIME})]))
    script = "import sys, pathlib, stoop.logs; from stoop.flight import load_flight, describe; f, u = sys.argv[1:];"
    script += "stoop.logs.read(pathlib.Path(u)); describe(load_flight(f)); print(*sys.modules)"
    command = [sys.executable, "-c", script, tmp_path / "f.nc", tmp_path / "f.ulg"]
    told = subprocess.run(command, check=True, capture_output=True, text=True)
    assert not {"xarray", "pandas", "dask", "pyulog", "numba", "sympy"} & set(told.stdout.split())


def holding(values: FloatArray) -> Flight:
    time = 68.23 + np.arange(values.size) / 100.0
    return from_columns("f", time, {"p": values, "pwm_3": -values}, notices=NOTICES)


def opened(path: Path) -> Any:
    import xarray as xr

    return xr.open_dataset(path, engine="scipy", decode_timedelta=False)


def test_there_and_back_bit_for_bit(tmp_path: Path) -> None:
    """Also beyond what a log may hold: the filter of the grid goes there, and columns may be set by hand."""
    path = tmp_path / "g.nc"
    noise = np.random.default_rng(0).normal(size=30)
    ordinary = (*([x, -x] for x in (0.0, 1e6, 5e-324)), [1.0, np.nan, 2.0], noise)
    for values in (*ordinary, *(np.linspace(0.9e9, large, 30) for large in (1.0000001e9, -3e9, 1e12, 1e29))):
        there = holding(np.zeros(len(values)))
        p = ("time", np.array(values), there.data["p"].attrs)
        there = replace(there, data=there.data.assign(p=p))
        save_flight(there, path)
        back = load_flight(path, rate=50.0)
        assert (back.name, back.path, back.rate) == ("g", path, 100.0)
        assert there.data.identical(back.data)
        assert (there.rate, there.notices, there.faults, there.air) == (100.0, NOTICES, back.faults, back.air)
        assert back.notices == NOTICES
        assert repr(dict(there.sources)) == repr(dict(back.sources))  # NaN is not equal to itself
    assert [p.name for p in tmp_path.iterdir()] == ["g.nc"]
    with pytest.raises(OutputError, match="cannot be written"):
        save_flight(there, tmp_path / "no" / "g.nc")
    with opened(path) as data:
        assert (data["p"].attrs["units"], data.sizes["time"]) == ("rad/s", 30)
    psi = np.array([0.5, -3.0, np.nan, np.pi])  # of several turns it comes back on the circle
    there = from_columns("f", np.arange(4) / 100.0, {"psi": psi})
    save_flight(replace(there, data=there.data.assign(psi=there.data["psi"] + 4.0 * np.pi)), path)
    np.testing.assert_allclose(load_flight(path).column("psi"), psi, atol=1e-12)


def test_air_data_and_faults_come_back(tmp_path: Path) -> None:
    traces = {"time": np.arange(3.0), "pitot": np.array([1.0, np.nan, 2.0])}
    bias = (0.1, 0.2, 0.3)
    air = AirData("pitot", wind_n=1.5, accelerometer_bias=bias, notices=NOTICES, traces=traces)
    found = notice("constant-reading", "p", value=0.5, unit="rad/s", start=1.0, stop=2.0)
    fault = Fault("stuck", "p", 0.5, 1.0, 2.0, found)
    save_flight(replace(holding(np.arange(5.0)), air=air, faults=(fault,)), tmp_path / "g.nc")
    back = load_flight(tmp_path / "g.nc")
    assert back.faults == (fault,)
    assert (back.air.wind_n, back.air.notices, back.air.accelerometer_bias) == (1.5, NOTICES, bias)
    assert np.isnan(back.air.pitot_scale)
    for name, trace in traces.items():
        np.testing.assert_array_equal(back.air.traces[name], trace)


def test_sentences_of_older_files_come_back(tmp_path: Path) -> None:
    sentences = ["a note: ±1 °C", "another"]
    fault = {"kind": "stuck", "variable": "p", "value": 0.5, "start": 1.0, "stop": 2.0, "message": "still"}
    save_flight(replace(holding(np.arange(5.0)), air=AirData("none")), tmp_path / "g.nc")
    with opened(tmp_path / "g.nc") as whole:
        data = whole.load()
    air = json.loads(data.attrs["air"]) | {"notes": sentences}
    del data.attrs["notices"], air["notices"]
    data.attrs |= {"notes": json.dumps(sentences), "faults": json.dumps([fault]), "air": json.dumps(air)}
    data.to_netcdf(tmp_path / "old.nc", engine="scipy", format="NETCDF3_64BIT")
    back = load_flight(tmp_path / "old.nc")
    assert [str(found) for found in back.notices] == sentences
    assert [(f.kind, f.value, f.message) for f in back.faults] == [("stuck", 0.5, "still")]
    assert [str(found) for found in back.air.notices] == sentences


def test_a_part_of_a_flight_is_none(tmp_path: Path) -> None:
    save_flight(holding(np.arange(40.0)), path := tmp_path / "g.nc")
    whole = path.read_bytes()
    for end in range(0, len(whole) - 1, 53):
        path.write_bytes(whole[:end])
        with pytest.raises(LogError) as caught:
            load_flight(path)
        assert "\n" not in str(caught.value)


def test_files_that_stoop_did_not_write(tmp_path: Path) -> None:
    path = tmp_path / "g.nc"
    there = holding(np.arange(40.0))
    save_flight(there, path)
    told = {"shift": 0.5, "std": 0.1, "reference": "b", "using": "p", "correlation": 0.9, "overlap": 9.0}
    text = json.dumps([notice("clock-aligned", "log", **told).to_dict()])
    with opened(path) as whole:
        data = whole.load()
    unheard = text.replace("clock-aligned", "unheard-of").replace("message", "said")
    wrongs = (text.replace("0.5", "1" * 400), text.replace("0.5", "[" * 100 + "]" * 100), unheard)
    cases = {wrong: data.assign_attrs(notices=wrong) for wrong in wrongs}
    cases |= {"another make": data.drop_attrs(), "clock": data.assign_coords(time=data["time"] ** 2)}
    for case, wrong in cases.items():
        wrong.to_netcdf(tmp_path / "h.nc", engine="scipy", format="NETCDF3_64BIT")
        words = {"another make": "not a flight written by stoop", "clock": "stoop did not write"}
        with pytest.raises(LogError, match=words.get(case, "write the flight again")):
            load_flight(tmp_path / "h.nc")
