"""Our own files: bit for bit there and back, and nothing but LogError from a damaged one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import LogError, OutputError
from stoop.flight import Fault, Flight, from_columns, load, save
from stoop.flight.flight import AirData

NOTICES = (notice("untyped-flight-note", text="a note: ±1 °C"), notice("gaps", counts=("imu 2", "gps 1")))


def flight(values: FloatArray) -> Flight:
    time = 68.23 + np.arange(values.size) / 100.0
    return from_columns("f", time, {"p": values, "pwm_3": -values}, notices=NOTICES)


def opened(path: Path) -> Any:
    import xarray as xr

    return xr.open_dataset(path, engine="scipy", decode_timedelta=False)


def test_there_and_back_bit_for_bit(tmp_path: Path) -> None:
    """Also beyond what a log may hold: the filter of the grid goes there, and columns may be set by hand."""
    path = tmp_path / "g.nc"
    ordinary = (
        *([x, -x] for x in (0.0, 1e6, 5e-324)),
        [1.0, np.nan, 2.0],
        np.random.default_rng(0).normal(size=30),
    )
    for values in (*ordinary, *(np.linspace(0.9e9, large, 30) for large in (1.0000001e9, -3e9, 1e12, 1e29))):
        there = flight(np.zeros(len(values)))
        p = ("time", np.array(values), there.data["p"].attrs)
        there = replace(there, data=there.data.assign(p=p))
        save(there, path)
        back = load(path, rate=50.0)
        assert (back.name, back.path, back.rate) == ("g", path, 100.0)
        assert there.data.identical(back.data)
        assert (there.rate, there.notices, there.faults, there.air) == (100.0, NOTICES, back.faults, back.air)
        assert back.notices == NOTICES
        assert repr(dict(there.sources)) == repr(dict(back.sources))  # NaN is not equal to itself
    assert [p.name for p in tmp_path.iterdir()] == ["g.nc"]
    with pytest.raises(OutputError, match="cannot be written"):
        save(there, tmp_path / "no" / "g.nc")
    with opened(path) as data:
        assert (data["p"].attrs["units"], data.sizes["time"]) == ("rad/s", 30)
    psi = np.array([0.5, -3.0, np.nan, np.pi])  # of several turns it comes back on the circle
    there = from_columns("f", np.arange(4) / 100.0, {"psi": psi})
    save(replace(there, data=there.data.assign(psi=there.data["psi"] + 4.0 * np.pi)), path)
    np.testing.assert_allclose(load(path).column("psi"), psi, atol=1e-12)


def test_air_data_and_faults_come_back(tmp_path: Path) -> None:
    traces = {"time": np.arange(3.0), "pitot": np.array([1.0, np.nan, 2.0])}
    bias = (0.1, 0.2, 0.3)
    air = AirData(
        "pitot", wind_n=1.5, wind_n_std=0.1, accelerometer_bias=bias, notices=NOTICES, traces=traces
    )
    found = notice("constant-reading", "p", value=0.5, unit="rad/s", start=1.0, stop=2.0)
    fault = Fault("stuck", "p", 0.5, 1.0, 2.0, found)
    save(replace(flight(np.arange(5.0)), air=air, faults=(fault,)), tmp_path / "g.nc")
    back = load(tmp_path / "g.nc")
    assert back.faults == (fault,)
    assert back.air is not None
    assert (back.air.wind_n, back.air.notices, back.air.accelerometer_bias) == (1.5, NOTICES, bias)
    assert np.isnan(back.air.pitot_scale)
    for name, trace in traces.items():
        np.testing.assert_array_equal(back.air.traces[name], trace)


def test_sentences_of_older_files_come_back(tmp_path: Path) -> None:
    sentences = ["a note: ±1 °C", "another"]
    fault = {
        "kind": "stuck",
        "variable": "p",
        "value": 0.5,
        "start": 1.0,
        "stop": 2.0,
        "message": "p stands still",
    }
    save(replace(flight(np.arange(5.0)), air=AirData("none")), tmp_path / "g.nc")
    with opened(tmp_path / "g.nc") as whole:
        data = whole.load()
    air = json.loads(data.attrs["air"]) | {"notes": sentences}
    del data.attrs["notices"], air["notices"]
    data.attrs |= {"notes": json.dumps(sentences), "faults": json.dumps([fault]), "air": json.dumps(air)}
    data.to_netcdf(tmp_path / "old.nc", engine="scipy", format="NETCDF3_64BIT")
    back = load(tmp_path / "old.nc")
    assert [str(found) for found in back.notices] == sentences
    assert [(f.kind, f.value, f.message) for f in back.faults] == [("stuck", 0.5, "p stands still")]
    assert back.air is not None
    assert [str(found) for found in back.air.notices] == sentences


def test_files_that_stoop_did_not_write(tmp_path: Path) -> None:
    path = tmp_path / "g.nc"
    there = flight(np.arange(40.0))
    save(there, path)
    told = {"shift": 0.5, "std": 0.1, "reference": "b", "using": "p", "correlation": 0.9, "overlap": 9.0}
    text = json.dumps([notice("clock-aligned", "log", **told).to_dict()])
    with opened(path) as whole:
        data = whole.load()
    cases = {
        number: data.assign_attrs(notices=text.replace("0.5", number))
        for number in ("1" * 400, "[" * 100 + "]" * 100)
    }
    cases |= {"another make": data.drop_attrs(), "clock": data.assign_coords(time=data["time"] ** 2)}
    for case, wrong in cases.items():
        wrong.to_netcdf(tmp_path / "h.nc", engine="scipy", format="NETCDF3_64BIT")
        words = {"another make": "not a flight written by stoop", "clock": "stoop did not write"}
        with pytest.raises(LogError, match=words.get(case, "write the flight again")):
            load(tmp_path / "h.nc")
