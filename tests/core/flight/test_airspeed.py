"""The airspeed of an ArduPilot log high above the sea: what ARSP holds is equivalent, what a flight holds true."""

from pathlib import Path

import numpy as np
import pytest

from stoop.base.atmosphere import standard_density
from stoop.flight import Flight, load_flight
from stoop_plan.log_bytes import Table, dataflash_bytes

HEIGHT = 2000.0  #: m
#: Pa, K, kg/m3: U.S. Standard Atmosphere 1976, table I, 2000 m above the sea
STANDARD = (79501.0, 275.154, 1.0066)
TRUE = 22.0  #: m/s
EQUIVALENT = TRUE * np.sqrt(STANDARD[2] / 1.225)  #: 19.94 m/s, as the manual of any airspeed indicator has it
T = np.arange(0.0, 10.0, 0.01)


def table(name: str, **columns: np.ndarray | float) -> Table:
    values = {"TimeUS": (1e6 * (T + 1.0)).astype(np.uint64)} | {n: x + 0.0 * T for n, x in columns.items()}
    letters = "Q" + "f" * len(columns)
    return Table(name, ",".join(values), letters, "-" * len(letters), "-" * len(letters), values)


def flown(folder: Path, airspeed: np.ndarray, mapping: str = "", **others: Table) -> Flight:
    log = [
        table("ATT", Roll=1.0, Pitch=3.0, Yaw=90.0),
        table("IMU", GyrX=0.01, GyrY=0.0, GyrZ=0.0, AccX=0.5, AccY=0.0, AccZ=-9.8),
        table("ARSP", Airspeed=airspeed, Temp=0.0),
    ]
    kept = {t.name: t for t in log} | {t.name: t for t in others.values()}
    path = folder / "high.bin"
    path.write_bytes(dataflash_bytes(list(kept.values())))
    if mapping:
        path.with_name("high.bin.toml").write_text('extends = "ardupilot"\n[variables]\n' + mapping)
    return load_flight(path)


BARO, POS = table("BARO", Press=STANDARD[0]), table("POS", Alt=HEIGHT)


def wavering(level: float) -> np.ndarray:
    return np.asarray(level + 0.2 * np.sin(2.0 * np.pi * T))


def told(flight: Flight) -> str:
    return next((str(found) for found in flight.notices if found.code.startswith("true-airspeed")), "")


def test_true_airspeed_in_2000_m(tmp_path: Path) -> None:
    """On a hot day the air is thinner by seven percent at the same pressure; a broken thermometer is not believed."""
    celsius, read = STANDARD[1] - 273.15 + np.array([0.0, 20.0, 425.0]), wavering(EQUIVALENT)
    standard, hot, broken = (table("ARSP", Airspeed=read, Temp=x) for x in celsius)
    expanded = np.sqrt((STANDARD[1] + 20.0) / STANDARD[1])
    for others, by, factor in (
        ([BARO, POS, standard], "by pressure and temperature", 1.0),
        ([BARO, POS, hot], "by pressure and temperature", expanded),
        ([BARO, broken], "by the pressure, in the standard atmosphere", 1.0),
        (
            [BARO, POS],
            "by the pressure, in the standard atmosphere",
            1.0,
        ),  # 0 degrees for ever: no thermometer
        ([POS], "by the altitude, in the standard atmosphere", 1.0),
        ([], "the log has neither pressure nor altitude to compute the density", EQUIVALENT / TRUE),
    ):
        flight = flown(tmp_path, wavering(EQUIVALENT), **{t.name: t for t in others})
        np.testing.assert_allclose(np.median(flight.column("airspeed_pitot")), factor * TRUE, rtol=5e-4)
        np.testing.assert_allclose(np.median(flight.column("airspeed_equivalent")), EQUIVALENT, rtol=1e-6)
        assert by in told(flight)
        assert flight.sources["airspeed_pitot"] == flight.sources["airspeed_equivalent"]


def test_a_climb_is_followed_and_a_frozen_pitot_is_one_in_true_airspeed_too(tmp_path: Path) -> None:
    height = np.linspace(100.0, 3100.0, T.size)
    density = standard_density(height)
    flight = flown(tmp_path, TRUE * np.sqrt(density / 1.225), a=table("POS", Alt=height))
    np.testing.assert_allclose(flight.column("airspeed_pitot"), TRUE, rtol=1e-3)
    frozen = np.where(T < 5.0, wavering(EQUIVALENT) + 0.01 * np.cos(9.0 * T), EQUIVALENT)
    flight = flown(tmp_path, frozen, a=table("POS", Alt=HEIGHT + 3.0 * T))
    (fault,) = [f for f in flight.faults if f.variable == "airspeed_pitot"]
    assert fault.kind == "stuck"
    assert fault.start == pytest.approx(1.0 + 5.0, abs=0.1)
    assert np.isnan(flight.without_faults().column("airspeed_pitot")[-100:-1]).all()


@pytest.mark.parametrize("variable", ["airspeed_pitot", "V"])
def test_what_a_mapping_calls_true_stays(tmp_path: Path, variable: str) -> None:
    line = f'{variable} = {{ stream = "ARSP", column = "Airspeed", unit = "m/s" }}\n'
    flight = flown(tmp_path, wavering(TRUE), line, a=POS)
    np.testing.assert_allclose(flight.column(variable), wavering(TRUE), atol=5e-3)
    assert told(flight) == ""
    assert ("airspeed_equivalent" in flight.data) == (variable == "V")
