"""What logs say of themselves, and where they contradict each other."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from stoop.flight.apply_mapping import Mapped
from stoop.logs import Recording, Stream
from stoop_fleet.headers import CLOCKS, Dated, Header, contradictions, header

NOON = datetime(2026, 5, 31, 12, tzinfo=UTC).timestamp()


def recording(info: dict[str, str], streams: dict[str, Stream] | None = None) -> Recording:
    return Recording(Path("log"), "", streams or {}, info=info)


def test_real_logs_tell_vehicle_firmware_date_and_count(shared_data: Path) -> None:
    for name, vehicle, software, began, count in (
        ("px4-ulog-reader-samples/sample_log_small.ulg", "000600000000383638393239510d0035002d", "1.11.2 8583f1da",
         datetime(2021, 4, 21, 6, 30, 38, tzinfo=UTC), 65.0),
        ("ardupilot-dataflash-sample/test.BIN", "003600293036510331323731", "ArduPlane V3.8.2-dev (8178ab40)",
         datetime(2017, 10, 29, 1, 45, 48, tzinfo=UTC), 23.0),
    ):  # fmt: skip
        found = header(Mapped.read(shared_data / name, None, CLOCKS)[0])
        assert (found.vehicle, found.software, found.count) == (vehicle, software, count)
        assert found.zero == pytest.approx(began.timestamp(), abs=1.0)


def test_dates_of_receivers_blackbox_and_bags() -> None:
    clock = np.array([0.0, 0.0, 1e6 * NOON + 2e6, 1e6 * NOON + 3e6])
    for columns, zero in (({"time_utc_usec": clock}, NOON), ({"time_utc_usec": 0.0 * clock}, None)):
        assert header(recording({}, {"vehicle_gps_position": Stream(np.arange(4.0), columns)})).zero == zero
    assert header(recording({"messages": "no board"})) == Header()
    stream = {"main": Stream(np.array([5.0, 6.0]), {})}
    blackbox = {"craft": "Racer", "firmware": "Betaflight 4.5.0", "start": "2026-05-31T12:00:00.000+00:00"}
    assert header(recording(blackbox, stream)) == Header("Racer", "Betaflight 4.5.0", NOON - 5.0)
    assert header(recording(blackbox | {"start": "0000-01-01T00:00:00.000+00:00"}, stream)).zero is None
    assert header(recording({"start": f"{NOON:.3f} s after 1970"}, stream)).zero == NOON


def dated(name: str, begin: float, count: float = np.nan, vehicle: str = "v", lasts: float = 600.0) -> Dated:
    return Dated(name, vehicle, NOON + begin, NOON + begin + lasts, count)


def test_two_vehicles_fly_at_once_and_a_clock_that_ran_backwards_is_told_by_the_count_of_flights() -> None:
    own = [dated("a", 0.0), dated("b", 300.0), dated("c", 900.0), dated("d", 0.0, vehicle="w")]
    found = contradictions(own, "abcd")
    assert found["a"] == "v flies in b, too, at this time; name the vehicles in --flights"
    assert contradictions(own, "bcd") == {"b": found["b"]}, "an earlier flight is believed"
    own = [dated("a", 0.0, 10.0), dated("b", 1000.0, 11.0), dated("c", 2000.0, 11.0), dated("d", -9e8, 12.0)]
    own += [dated("e", 4000.0, 13.0), dated("f", 5000.0)]
    ((flight, why),) = contradictions(own, "abcdef").items()
    assert (flight, "dated 1997-11-22" in why) == ("d", True)
    assert not contradictions(own, "abcef"), "an earlier flight is believed"


def test_a_count_that_was_reset_contradicts_no_date() -> None:
    for counts, out in (
        ([100, 101, 102, 103, 104, 1, 2, 3], []), ([1, 2, 3, 1, 2, 3, 1, 1], []),
        ([100, 101, 1], []),  # the first flight after it
        ([3, 4, 1, 2, 9, 3, 4, 5], [4]),  # a reset, and a flight between the others
        ([9, 1, 2, 3], [0]),  # with a single flight before, a wrong date is likelier
    ):  # fmt: skip
        own = [dated(str(i), 1000.0 * i, count) for i, count in enumerate(counts)]
        assert set(contradictions(own, {one.flight for one in own})) == set(map(str, out)), counts
