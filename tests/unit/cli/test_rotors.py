"""`stoop rotors`: from logs to a verdict, and what is said of logs that cannot tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from unit.cli.conftest import Done, Refused

from stoop.exporters.log_bytes import Event, crazyflie_bytes

VEHICLE = str(Path(__file__).parents[3] / "examples" / "crazyflie.toml")
LEVELS = {
    "a": (42000, 42300, 41800, 42100),
    "b": (42200, 42100, 42000, 41900),
    "c": (41900, 42000, 42150, 42050),
    "fine": (42000, 42050, 42000, 42000),
    "weak": (42000, 42050, 53000, 42000),
    "low": (42000, 42050, 42000, 42000),
}


def hop(commands: tuple[float, ...], seed: int, volts: float = 3.6) -> bytes:
    rng = np.random.default_rng(seed)
    time = 5.0 + 0.01 * np.arange(1400)
    up = (time > 7.0) & (time < 17.0)
    columns = {
        f"motor.m{i}": (up * (level + rng.normal(0.0, 500.0, time.size))).clip(0.0).astype(np.uint32)
        for i, level in enumerate(commands, 1)
    }
    battery = {"pm.vbatMV": np.full(time.size, 1e3 * volts, np.uint16)}
    return crazyflie_bytes({"fixedFrequency": Event(0, time, columns | battery)})


@pytest.fixture
def logs(tmp_path: Path) -> None:
    for seed, (name, levels) in enumerate(LEVELS.items()):
        (tmp_path / f"{name}.usd").write_bytes(hop(levels, seed, 3.3 if name == "low" else 3.6))


@pytest.mark.usefixtures("logs")
def test_weak_rotor_is_named_and_a_healthy_flight_is_not(here: Path, done: Done) -> None:
    said = done(f"rotors weak.usd fine.usd --healthy a.usd b.usd c.usd --vehicle {VEHICLE}")
    by_name = {line.split()[0]: line for line in said.splitlines() if line.strip()}
    assert "propeller or mass near M3" in by_name["weak"]
    for name in ("a", "b", "c", "fine"):
        assert "as healthy" in by_name[name]
    out = done(f"rotors fine.usd low.usd --healthy a.usd --vehicle {VEHICLE} --together")
    assert "2 flights" in out
    assert "low: the battery's voltage is more than 5 % from that of the healthy flights" in out
    out = " ".join(done(f"rotors weak.usd --healthy a.usd --vehicle {VEHICLE}").split())
    sharper = "more healthy flights, on several days: with 8 the smallest detectable loss"
    assert f"What would make it sharper - {sharper}" in out
    assert "swap the propeller of M3 with that of a rotor that turns the same way" in out


@pytest.mark.usefixtures("logs")
def test_what_cannot_be_done_is_said(refused: Refused) -> None:
    for words, complaint in {
        f"a.usd --healthy a.usd --vehicle {VEHICLE}": "a.usd: given twice",
        f"weak.usd --healthy a.usd a.usd --vehicle {VEHICLE}": "a.usd: given twice",
        "weak.usd --healthy a.usd --vehicle twin-boom": "has no rotors",
        f"weak.usd --healthy a.usd --vehicle {VEHICLE} --chance 0.7": "write a small share",
        "weak.usd --healthy a.usd --vehicle hexa-x": "motor_5, motor_6 not recorded",
    }.items():
        assert complaint in refused(f"rotors {words}"), words
