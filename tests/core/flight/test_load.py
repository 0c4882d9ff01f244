"""From a CSV to a flight, and what goes wrong on the way: one line, naming the file and the fix."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import CLOCK, csv_log, lines_of, mapped_log

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import FlightError, LogError, StoopError
from stoop.flight import Flight, from_columns, load_flight
from stoop.flight.air_data import with_air, without
from stoop.flight.flight import flight_name
from stoop.flight.load import load_several
from stoop.workflow.flights import as_flights
from stoop_plan.log_bytes import Topic, ulog

NAMES = ("phi", "theta", "psi", "p", "q", "elevator")


def codes(flight: Flight) -> set[str]:
    return {found.code for found in flight.notices}


def rows(size: int = 500) -> FloatArray:
    t = 3.0 + 0.01 * np.arange(size)
    phi, theta = 0.3 * np.sin(2 * t), 0.2 * np.sin(t)
    rates = 0.6 * np.cos(2 * t), 0.2 * np.cos(t)
    return np.column_stack([t, phi, theta, 3.0 + 0 * t, *rates, 0.1 * np.sign(theta)])


def write(folder: Path, table: FloatArray) -> Path:
    return mapped_log(folder / "sortie.csv", dict(zip(("t", *NAMES), table.T, strict=True)))


def test_channels_come_as_they_are(tmp_path: Path) -> None:
    recorded = rows()
    flight = load_flight(write(tmp_path, recorded))
    assert (flight.name, flight.rate, flight.time[0], flight.time[-1]) == ("sortie", 100.0, 3.0, 7.99)
    for name, x in zip(NAMES, recorded.T[1:], strict=True):
        np.testing.assert_allclose(flight.column(name), x, atol=1e-9)
    assert flight.data["p"].attrs["units"] == "rad/s"
    assert "no-air-data" in codes(flight)
    np.testing.assert_allclose(np.diff(load_flight(tmp_path / "sortie.csv", rate=50.0).time), 0.02)
    names = {"a/b.csv.gz": "b", "a/b.ulg": "b", "x/flight2": "flight2", "v1.2.csv": "v1.2", ".nc": ".nc"}
    assert {path: flight_name(Path(path)) for path in names} == names


def test_logs_that_are_read_together_have_one_rate(tmp_path: Path) -> None:
    (tmp_path / "slow").mkdir()
    fast, slow = write(tmp_path, rows()), write(tmp_path / "slow", rows()[::2])
    assert [load_flight(path).rate for path in (fast, slow)] == [100.0, 50.0]
    assert [one.rate for one in load_several([slow, slow])] == [50.0, 50.0]
    together = load_several([fast, slow])
    assert [one.rate for one in together] == [100.0, 100.0]
    assert np.array_equal(together[1].column("p"), load_flight(slow, rate=100.0).column("p"), equal_nan=True)
    assert load_several([slow], beside=together)[0].rate == 100.0
    assert [one.rate for one in as_flights([together[0], slow])] == [100.0, 100.0]


def test_rows_out_of_order_are_dropped_and_what_is_missing_or_impossible_leaves_a_gap(tmp_path: Path) -> None:
    table = rows()
    table[[100, 200], 0] = 0.0, np.nan
    table[150:170, 4] = table[300:302, 4] = np.nan
    table[[50, 60], 4] = 1e300, np.inf
    flight = load_flight(write(tmp_path, table))
    assert any("2 of 500 samples dropped" in str(n) for n in flight.notices if n.code == "log-defect")
    assert notice("impossible-values", "sortie.csv", variable="p", count=2) in flight.notices
    np.testing.assert_allclose(flight.column("p")[100], 0.6 * np.cos(2 * 4.0), atol=1e-3)
    assert np.flatnonzero(np.isnan(flight.column("p"))).tolist() == list(range(150, 170))
    assert np.isfinite(flight.column("q")).all()
    assert flight.sources["p"].gaps == 1
    table[:, 1:] = np.nan
    assert np.isnan(load_flight(write(tmp_path, table)).column("p")).all()


def test_nothing_of_use_is_left_and_wild_stamps_make_no_flight_of_hours(tmp_path: Path) -> None:
    for size in (0, 1):
        with pytest.raises(LogError):
            load_flight(write(tmp_path, rows(size)))
    wild = rows()
    wild[250:, 0] = 1e12 + np.arange(250)
    with pytest.raises(StoopError, match="too long for a grid"):  # and memory is not filled
        load_flight(write(tmp_path, wild))
    log = tmp_path / "a.ulg"

    def flown(time: np.ndarray) -> Flight:
        columns = {f"xyz[{i}]": np.ones(time.size, "f4") for i in range(3)}
        log.write_bytes(ulog([Topic("vehicle_angular_velocity", time, columns)]))
        return load_flight(log)

    flight = flown(np.append(2.0 + 0.02 * np.arange(59), 34_359.0))
    assert flight.time[-1] < 4.0
    assert notice("stray-samples", "vehicle_angular_velocity", count=1, distance=60.0) in flight.notices
    with pytest.raises(FlightError, match="only 30 samples in 29000 s: a clock is damaged"):
        flown(1000.0 * np.arange(30))
    (tmp_path / "topics").mkdir()
    (tmp_path / "topics" / "log_cpuload_0.csv").write_text("timestamp,load\n1,2\n3,4\n")
    with pytest.raises(FlightError, match="no variable of the registry"):
        load_flight(tmp_path / "topics")


def test_flights_from_arrays() -> None:
    for time, columns, words in (
        ([0.0, 1.0, 2.0], {"P": np.zeros(3)}, "no variable 'P'"),
        ([0.0, 1.0, 2.0], {"p": np.zeros(2)}, "'p' has 2 samples, the time 3"),
        ([0.0, 1.0, 1.5], {"p": np.zeros(3)}, "not uniform"),
        ([1.0, 0.0], {"p": np.zeros(2)}, "does not increase"),
        ([1.0], {"p": np.zeros(1)}, "does not increase"),
    ):
        with pytest.raises(FlightError, match=words):
            from_columns("f", np.array(time), columns)
    one = turning(speed=False)
    t, phi, psi = one.time, one.column("phi"), one.column("psi")
    several = from_columns("f", t, {"phi": phi - 2 * np.pi, "theta": 0.0 * t, "psi": psi + 6 * np.pi})
    np.testing.assert_allclose(several.column("psi"), psi, atol=1e-12)
    np.testing.assert_allclose(several.column("phi"), phi, atol=1e-12)
    assert np.array_equal(from_columns("f", t, {"psi": psi}).column("psi"), psi)
    parts = from_columns("f", t, {name: several.column(name) for name in ("q0", "q1", "q2", "q3")})
    np.testing.assert_allclose(parts.column("psi"), psi, atol=1e-12)


def turning(speed: bool, pitot: bool = False) -> Flight:
    """A flight through a known wind, in turns; V reads 1 m/s high, the pitot 2 m/s low."""
    t = 0.01 * np.arange(6000)
    heading, airspeed = 0.3 * t, 20.0 + 2.0 * np.sin(0.5 * t)
    columns = {"phi": 0.0 * t, "theta": 0.05 + 0.0 * t, "psi": np.angle(np.exp(1j * heading)), "vd": 0.0 * t}
    columns |= {"vn": airspeed * np.cos(heading) + 3.0, "ve": airspeed * np.sin(heading)}
    columns |= {"V": airspeed + 1.0} if speed else {}
    columns |= {"airspeed_pitot": airspeed - 2.0} if pitot else {}
    return from_columns("turns", t, columns)


def test_a_measured_airspeed_stays_and_a_pitot_tells_the_wind_before_it() -> None:
    bare = turning(speed=True)
    for flight in (with_air(bare), without(with_air(bare), [(0.0, 10.0)])):
        assert np.array_equal(flight.column("V"), bare.column("V"))
        assert flight.sources["V"].source == "simulation"
        assert "airspeed_pitot" not in flight.data
        np.testing.assert_allclose(flight.column("alpha")[300:-300], 0.05, atol=0.01)
        assert flight.sources["alpha"].source == "reconstructed"
        assert flight.air.method == "pitot"
        assert flight.air.wind_n == pytest.approx(3.0, abs=0.1)
        assert [found.code for found in flight.notices].count("airspeed-measured-as-pitot") == 1
    flight = with_air(turning(speed=True, pitot=True))
    assert flight.air.wind_n == pytest.approx(3.0, abs=0.1)
    assert flight.column("airspeed_pitot")[0] == 18.0
    assert flight.column("V")[0] == 21.0
    assert "airspeed-measured-as-pitot" not in codes(flight)
    unmeasured = with_air(turning(speed=False, pitot=True))
    assert unmeasured.sources["V"].source == "reconstructed"
    again = without(unmeasured, [(0.0, 30.0)])
    assert not np.array_equal(again.column("V"), unmeasured.column("V"))  # it is reconstructed anew
    assert not codes(again) & {"airspeed-measured", "airspeed-measured-as-pitot"}


def test_what_hovers_needs_no_air_data(tmp_path: Path) -> None:
    time = 0.01 * np.arange(2400)
    still = {name: np.zeros(time.size) for name in ("phi", "theta", "psi", "vn", "ve", "vd")}
    rotors = {f"motor_{n}": 0.5 + 0.01 * np.sin(time) for n in range(1, 5)}
    assert with_air(from_columns("hover", time, {**still, **rotors})).notices == ()
    assert codes(with_air(from_columns("parked", time, still))) == {"no-air-data-short-flight"}
    assert "no-air-data" not in codes(load_flight(mapped_log(tmp_path / "a.csv", {"t": time, **rotors})))
    names = ("p", "q", "r", "phi", "theta", "psi", "vn", "ve", "vd")
    columns = {"t": np.arange(400) / 100.0} | dict.fromkeys(names, np.full(400, 0.1))
    told = codes(load_flight(mapped_log(tmp_path / "b.csv", columns)))
    found = [code for code in told if "no-air-data" in code]
    assert found == ["no-air-data-short-flight"], "why is told once"


def test_an_attitude_in_two_files_is_whole(tmp_path: Path) -> None:
    whole, text = turning(speed=False), CLOCK
    for file, step, names in (("a", 1, ("phi", "theta")), ("b", 2, ("psi", "vn", "ve", "vd"))):
        columns = {"t": whole.time, **{name: whole.column(name) for name in names}}
        csv_log(tmp_path / f"{file}.csv", {name: x[::step] for name, x in columns.items()})
        text += lines_of(*names, more=f', file = "{file}.csv"')
    (tmp_path / "mapping.toml").write_text(text)
    flight = load_flight(tmp_path)
    rates = {name: round(flight.sources[name].rate) for name in ("phi", "psi", "q0", "q3")}
    assert rates == {"phi": 100, "psi": 50, "q0": 50, "q3": 50}
    parts, truth = (np.array([one.column(f"q{i}") for i in range(4)]) for one in (flight, whole))
    np.testing.assert_allclose(np.abs(np.sum(parts * truth, axis=0))[:-1], 1.0, atol=1e-9)
    assert flight.air is not None
    assert "no-air-data" not in codes(flight)
    assert set(flight.sources) == {str(name) for name in flight.data.data_vars}
