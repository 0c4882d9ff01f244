"""Our own files: bit for bit there and back, and nothing but LogError from a damaged one."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import LogError, OutputError, StoopError
from stoop.flight import Fault, Flight, from_columns, load, save
from stoop.flight.flight import AirData

any_file = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
NOTICES = (
    notice("untyped-flight-note", text="a note: ±1 °C"),
    notice("gaps", counts=("imu 2", "gps 1")),
)
finite = st.floats(-1e6, 1e6) | st.just(float("nan"))


def flight(values: FloatArray) -> Flight:
    time = 68.23 + np.arange(values.size) / 100.0
    return from_columns("f", time, {"p": values, "pwm_3": -values}, notices=NOTICES)


def assert_same(a: Flight, b: Flight) -> None:
    assert a.data.identical(b.data)
    assert (a.rate, a.notices, a.faults, a.air) == (b.rate, b.notices, b.faults, b.air)
    assert repr(dict(a.sources)) == repr(dict(b.sources))  # NaN is not equal to itself


@any_file
@given(hnp.arrays(np.float64, st.integers(2, 30), elements=finite))
def test_there_and_back_bit_for_bit(tmp_path: Path, values: FloatArray) -> None:
    path = tmp_path / "g.nc"
    there = flight(values)
    save(there, path)
    back = load(path, rate=50.0)
    assert back.name == "g"
    assert back.path == path
    assert back.rate == 100.0
    assert_same(there, back)


@pytest.mark.parametrize("large", [1.0000001e9, -3e9, 1e12, 1e29])
def test_numbers_beyond_what_a_log_may_hold_come_back_too(tmp_path: Path, large: float) -> None:
    """The filter of the grid goes beyond what was recorded, and columns may be set by hand."""
    there = flight(np.arange(30.0))
    data = there.data.assign(p=("time", np.linspace(0.9e9, large, 30), there.data["p"].attrs))
    there = replace(there, data=data)
    save(there, tmp_path / "g.nc")
    assert_same(there, load(tmp_path / "g.nc"))


def test_air_data_and_faults_come_back(tmp_path: Path) -> None:
    import dataclasses

    traces = {"time": np.arange(3.0), "pitot": np.array([1.0, np.nan, 2.0])}
    air = AirData(
        "pitot",
        wind_n=1.5,
        wind_n_std=0.1,
        accelerometer_bias=(0.1, 0.2, 0.3),
        notices=NOTICES,
        traces=traces,
    )
    found = notice("constant-reading", "p", value=0.5, unit="rad/s", start=1.0, stop=2.0)
    fault = Fault("stuck", "p", 0.5, 1.0, 2.0, found)
    there = dataclasses.replace(flight(np.arange(5.0)), air=air, faults=(fault,))
    save(there, tmp_path / "g.nc")
    back = load(tmp_path / "g.nc")
    assert back.faults == (fault,)
    assert back.air is not None
    assert back.air.wind_n == 1.5
    assert back.air.notices == NOTICES
    assert back.air.accelerometer_bias == (0.1, 0.2, 0.3)
    assert np.isnan(back.air.pitot_scale)
    for name, trace in traces.items():
        np.testing.assert_array_equal(back.air.traces[name], trace)


def test_sentences_of_older_files_come_back(tmp_path: Path) -> None:
    """Before notices were typed, files held sentences."""
    sentences = ["a note: ±1 °C", "another"]
    fault = {
        "kind": "stuck",
        "variable": "p",
        "value": 0.5,
        "start": 1.0,
        "stop": 2.0,
        "message": "p stands still",
    }
    there = flight(np.arange(5.0))
    save(replace(there, air=AirData("none")), tmp_path / "g.nc")
    import xarray as xr

    with xr.open_dataset(tmp_path / "g.nc", engine="scipy", decode_timedelta=False) as opened:
        data = opened.load()
    air = json.loads(data.attrs["air"]) | {"notes": sentences}
    del data.attrs["notices"], air["notices"]
    data.attrs |= {"notes": json.dumps(sentences), "faults": json.dumps([fault]), "air": json.dumps(air)}
    data.to_netcdf(tmp_path / "old.nc", engine="scipy", format="NETCDF3_64BIT")
    back = load(tmp_path / "old.nc")
    assert [str(found) for found in back.notices] == sentences
    assert [(f.kind, f.value, f.message) for f in back.faults] == [("stuck", 0.5, "p stands still")]
    assert back.air is not None
    assert [str(found) for found in back.air.notices] == sentences


@pytest.mark.parametrize("number", ["1" * 400, "[" * 100 + "]" * 100, '"x"'])
def test_notices_that_make_no_sentence(tmp_path: Path, number: str) -> None:
    save(flight(np.arange(40.0)), tmp_path / "g.nc")
    text = json.dumps(
        [
            notice(
                "clock-aligned",
                "log",
                shift=0.5,
                std=0.1,
                reference="b",
                using="p",
                correlation=0.9,
                overlap=9.0,
            ).to_dict()
        ]
    ).replace("0.5", number)
    path = tmp_path / "h.nc"
    import xarray as xr

    with xr.open_dataset(tmp_path / "g.nc", engine="scipy", decode_timedelta=False) as opened:
        opened.load().assign_attrs(notices=text).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    with pytest.raises(LogError, match="write the flight again"):
        load(path)


def test_cut_at_many_places(tmp_path: Path) -> None:
    save(flight(np.arange(40.0)), tmp_path / "g.nc")
    whole = (tmp_path / "g.nc").read_bytes()
    for end in range(0, len(whole) - 1, 13):
        (tmp_path / "h.nc").write_bytes(whole[:end])
        with pytest.raises(LogError) as caught:
            load(tmp_path / "h.nc")
        assert "\n" not in str(caught.value)


@any_file
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes(tmp_path: Path, damage: list[tuple[int, int]]) -> None:
    if not (tmp_path / "g.nc").exists():
        save(flight(np.arange(20.0)), tmp_path / "g.nc")
    content = bytearray((tmp_path / "g.nc").read_bytes())
    for place, byte in damage:
        content[place % min(len(content), 4000)] = byte
    (tmp_path / "h.nc").write_bytes(content)
    with suppress(StoopError):
        load(tmp_path / "h.nc")


def test_a_netcdf_file_of_another_make(tmp_path: Path) -> None:
    import xarray as xr

    xr.Dataset({"x": ("time", np.arange(3.0))}).to_netcdf(tmp_path / "x.nc", engine="scipy")
    with pytest.raises(LogError, match="not a flight written by stoop"):
        load(tmp_path / "x.nc")


def test_a_clock_that_is_not_uniform(tmp_path: Path) -> None:
    import dataclasses

    there = flight(np.arange(5.0))
    bent = there.data.assign_coords(time=[0.0, 0.01, 0.02, 0.03, 0.06])
    save(dataclasses.replace(there, data=bent), tmp_path / "g.nc")
    with pytest.raises(LogError, match="stoop did not write"):
        load(tmp_path / "g.nc")


def test_nothing_half_written(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        save(flight(np.arange(3.0)), tmp_path / "no" / "g.nc")
    save(flight(np.arange(3.0)), tmp_path / "g.nc")
    assert [p.name for p in tmp_path.iterdir()] == ["g.nc"]


def test_the_file_opens_in_xarray_with_its_units(tmp_path: Path) -> None:
    import xarray as xr

    save(flight(np.arange(3.0)), tmp_path / "g.nc")
    with xr.open_dataset(tmp_path / "g.nc", engine="scipy", decode_timedelta=False) as data:
        assert data["p"].attrs["units"] == "rad/s"
        assert data.sizes["time"] == 3


def test_a_heading_of_several_turns_comes_back_on_the_circle(tmp_path: Path) -> None:
    time, psi = np.arange(4) / 100.0, np.array([0.5, -3.0, np.nan, np.pi])
    there = from_columns("f", time, {"psi": psi})
    save(replace(there, data=there.data.assign(psi=there.data["psi"] + 4.0 * np.pi)), tmp_path / "f.nc")
    np.testing.assert_allclose(load(tmp_path / "f.nc").column("psi"), psi, atol=1e-12)
