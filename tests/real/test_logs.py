"""Logs of real autopilots and bags: the numbers that independent readers find, cut anywhere, damaged anywhere."""

import gzip
import tomllib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from naive.dataflash import same_as_pymavlink

from stoop.errors import LogError
from stoop.flight import load_flight
from stoop.logs import Recording, read, ulog
from stoop.logs.dataflash import parse_dataflash
from stoop_draft.mapping_draft import draft_of

SAMPLES = ("sample_log_small.ulg", "sample_appended_multiple.ulg")
HEALTHY = {"normal_flight__E8": (44.2e3, 44.8e3), "normal_flight__E9": (44.5e3, 46.8e3)}
HOVER = HEALTHY | {"add_weight_W3": (60e3, 63e3)}


@pytest.fixture
def samples(shared_data: Path) -> Path:
    return shared_data / "px4-ulog-reader-samples"


def letters(text: str) -> str:
    return "".join(c for c in text if c.isprintable() and c != " ")


def check_as_pyulog(path: Path) -> None:
    from pyulog import ULog

    ours, theirs = read(path), ULog(str(path))
    assert {s.partition("/")[0] for s in ours.streams} == {d.name for d in theirs.data_list}
    for data in theirs.data_list:
        stream = ours.streams[f"{data.name}/{data.multi_id}" if data.multi_id else data.name]
        stamps = data.data["timestamp"] * 1e-6
        kept = np.flatnonzero(np.isin(stamps, stream.time))[: stream.time.size]
        if np.all(np.diff(stamps) > 0.0):
            assert stream.time.size == stamps.size
            for column in (c for c in data.data if "_padding" not in c and c != "timestamp"):
                np.testing.assert_array_equal(stream.columns[column], data.data[column][kept])
    assert ours.parameters == theirs.initial_parameters
    told = {k: str(v) for k, v in theirs.msg_info_dict.items() if not isinstance(v, bytes) and v != ""}
    assert told.items() <= ours.info.items()
    messages = [line.partition("] ")[2] for line in ours.info["messages"].splitlines()]
    assert messages == [m.message for m in theirs.logged_messages]
    for key, wholes in theirs.msg_info_multiple_dict.items():
        assert letters("".join("".join(whole) for whole in wholes)) == letters(ours.info[key])
    lost = 1e-3 * sum(d.duration for d in theirs.dropouts)
    dropouts = f"{path.name}: the logger reports {len(theirs.dropouts)} dropouts, {lost:.2f} s in all"
    assert [str(d) for d in ours.defects if d.kind == "dropout"] == [dropouts] * bool(theirs.dropouts)
    assert {d.kind for d in ours.defects} <= {"dropout", "time order"}


def test_ulogs_hold_what_pyulog_finds(samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in SAMPLES:
        check_as_pyulog(samples / name)
    monkeypatch.setattr(ulog, "LIMITS", ulog.Limits(small=0))  # compiled
    check_as_pyulog(samples / SAMPLES[0])


def check_cut_and_damaged(path: Path, parse: Callable[[Path, bytes], Recording], rows: int) -> None:
    whole, found, rng = path.read_bytes(), [], np.random.default_rng(5)
    for end in (*range(0, 3000, 151), *np.linspace(3000, len(whole), 25).astype(int)):
        found.append(0)
        try:
            found[-1] = sum(stream.time.size for stream in parse(path, whole[:end]).streams.values())
        except LogError as error:
            assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
    assert found == sorted(found)
    assert found[-1] >= rows
    for _ in range(30):
        content = bytearray(whole)
        for place in rng.integers(0, len(whole) if rng.random() < 0.5 else 12_000, size=30):
            content[place] = rng.integers(0, 256)
        with suppress(LogError):
            assert parse(path, bytes(content)).defects


def test_cut_and_damaged_anywhere(samples: Path, shared_data: Path, tmp_path: Path) -> None:
    def parse_ulog(path: Path, content: bytes) -> Recording:
        (tmp_path / "a.ulg").write_bytes(content)
        return read(tmp_path / "a.ulg")

    for name in SAMPLES:
        check_cut_and_damaged(samples / name, parse_ulog, 4000)
    check_cut_and_damaged(shared_data / "ardupilot-dataflash-sample" / "test.BIN", parse_dataflash, 784)


def test_a_dataflash_log_holds_what_pymavlink_finds(shared_data: Path) -> None:
    sample = shared_data / "ardupilot-dataflash-sample" / "test.BIN"
    recording = read(sample)
    assert same_as_pymavlink(recording, sample) == 7164
    assert [str(d) for d in recording.defects] == ["test.BIN byte 65512: the last message is cut"]
    assert recording.info["firmware"] == "ArduPlane V3.8.2-dev (8178ab40)"
    assert recording.parameters["ARSPD_FBW_MAX"] == 22.0


def test_a_bag_holds_the_tables_that_others_made_of_it(shared_data: Path, tmp_path: Path) -> None:
    folder, bag = shared_data / "stanford-skywalker-10hz", tmp_path / "a.bag"
    bag.write_bytes(gzip.decompress((folder / "skywalker_manual_06_30_21.bag.gz").read_bytes()))
    point, controls = ("point.x", "point.y", "point.z"), [f"controls[{i}]" for i in range(4)]
    for name, columns in (("bodyrate", point), ("euler", point), ("actuators", controls)):
        topic = f"/plane/{name}"
        stream = read(bag, topics=frozenset({topic})).streams[topic]
        theirs = np.loadtxt(folder / f"plane_{name}.csv", delimiter=",", skiprows=1)
        assert stream.time.size == len(theirs)
        assert np.abs(stream.time - theirs[:, 0]).max() < 0.2  # theirs is the time of recording
        for k, column in enumerate(columns):
            np.testing.assert_allclose(stream.columns[column], theirs[:, k + 1], rtol=1e-6)


def test_all_flights_of_crazyflies_are_read_whole(shared_data: Path) -> None:
    """32 flights with whole, cut and loaded propellers: checksums fit, and hover commands are those of the source."""
    files = sorted((shared_data / "crazypad-propeller-damage").glob("*.usd"))
    assert len(files) == 32
    for path in files:
        recording = read(path)
        assert (recording.format, recording.defects, recording.info["checksum"]) == ("crazyflie", (), "fits")
        stream = recording.streams["fixedFrequency"]
        assert stream.period == pytest.approx(1.0 / 101.0, rel=0.02)
        assert 25.5 < stream.time[-1] - stream.time[0] < 26.0
        assert len(stream.columns) == 20
        assert 3000.0 < np.median(stream.columns["pm.vbatMV"]) < 4200.0
        hover = float(np.mean(stream.columns["motor.m3"][stream.columns["stateEstimate.z"] > 0.5]))
        low, high = next((HOVER[c] for c in HOVER if path.name.startswith(c)), (0.0, 65535.0))
        assert low < hover < high, path.name


def test_crazyflie(shared_data: Path) -> None:
    """Velocity is the derivative of position, acceleration that of velocity; hover needs 44.4 to 44.8 thousand of 65535."""
    flight = load_flight(shared_data / "crazypad-propeller-damage" / "normal_flight__E8_log00.usd")
    for rate, place in (("ve", "pe"), ("vd", "pd")):  # it hardly moves north
        moved = flight.column(place)[20:] - flight.column(place)[:-20]
        said = np.convolve(flight.column(rate), np.full(21, 0.01))[20:-20]
        assert np.corrcoef(moved, said)[0, 1] > 0.9, rate
    change = np.gradient(flight.column("vd"), flight.time)
    assert np.corrcoef(change, flight.column("ad"))[0, 1] > 0.7
    airborne = flight.column("pd") < -0.3
    assert np.median(flight.column("motor_3")[airborne]) * 65.535 == pytest.approx(44.6, abs=0.5)
    assert 3.0 < flight.column("voltage").min() < flight.column("voltage").max() < 4.3
    assert list(flight.unmapped) == ["fixedFrequency"]


def test_ardupilot(shared_data: Path) -> None:
    """The vehicle stands, leaning on its wing: gravity must point as the attitude says."""
    flight = load_flight(shared_data / "ardupilot-dataflash-sample" / "test.BIN")
    force = np.array([np.nanmedian(flight.column(name)) for name in ("ax", "ay", "az")])
    assert np.linalg.norm(force) == pytest.approx(9.81, rel=0.02)
    phi, theta = (float(np.nanmedian(flight.column(name))) for name in ("phi", "theta"))
    assert np.arctan2(-force[1], -force[2]) == pytest.approx(phi, abs=0.06)
    assert np.arcsin(force[0] / np.linalg.norm(force)) == pytest.approx(theta, abs=0.03)
    assert flight.faults == ()
    assert np.nanmedian(flight.column("pwm_3")) == 1100.0
    assert flight.unmapped["MAG"] == ()


def test_drafts_find_what_the_ready_mapping_takes(shared_data: Path) -> None:
    """The same log without its name: every line without a doubt must be right."""
    log = read(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    names = ("vehicle_attitude", "sensor_combined", "airspeed", "battery_status", "vehicle_air_data")
    made = draft_of(replace(log, format="mat", streams={name: log.streams[name] for name in names}))
    lines = tomllib.loads(made.text)["variables"]
    right = {
        "q": ("gyro_rad[1]", "rad/s"), "az": ("accelerometer_m_s2[2]", "m/s2"), "q0": ("q[0]", "1"),
        "V": ("true_airspeed_m_s", "m/s"), "density": ("rho", "kg/m3"), "voltage": ("voltage_v", "V"),
    }  # fmt: skip
    assert {name: (lines[name]["column"], lines[name]["unit"]) for name in right} == right
    assert not any("scale" in lines[name] for name in right)
