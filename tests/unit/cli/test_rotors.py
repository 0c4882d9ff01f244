"""`stoop rotors`: from logs to a verdict, and what is said of logs that cannot tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main
from stoop.exporters.log_bytes import Event, crazyflie_bytes

VEHICLE = str(Path(__file__).parents[3] / "examples" / "crazyflie.toml")


def hop(commands: tuple[float, ...], seed: int, volts: float = 3.6) -> bytes:
    """A log of 14 s, the middle 10 s of it in the air, with 16-bit commands and a controller's noise."""
    rng = np.random.default_rng(seed)
    time = 5.0 + 0.01 * np.arange(1400)
    up = (time > 7.0) & (time < 17.0)
    columns = {
        f"motor.m{i}": (up * (level + rng.normal(0.0, 500.0, time.size))).clip(0.0).astype(np.uint32)
        for i, level in enumerate(commands, 1)
    }
    return crazyflie_bytes(
        {
            "fixedFrequency": Event(
                0, time, columns | {"pm.vbatMV": np.full(time.size, 1e3 * volts, np.uint16)}
            )
        }
    )


@pytest.fixture
def logs(tmp_path: Path) -> dict[str, str]:
    levels = {
        "a": (42000, 42300, 41800, 42100),
        "b": (42200, 42100, 42000, 41900),
        "c": (41900, 42000, 42150, 42050),
        "fine": (42000, 42050, 42000, 42000),
        "weak": (42000, 42050, 53000, 42000),
    }
    paths = {name: tmp_path / f"{name}.usd" for name in levels}
    for seed, (name, path) in enumerate(paths.items()):
        path.write_bytes(hop(levels[name], seed))
    paths["low"] = tmp_path / "low.usd"
    paths["low"].write_bytes(hop(levels["fine"], 9, 3.3))
    return {name: str(path) for name, path in paths.items()}


def test_weak_rotor_is_named_and_a_healthy_flight_is_not(
    logs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    healthy = [logs[name] for name in "abc"]
    assert main(["rotors", logs["weak"], logs["fine"], "--healthy", *healthy, "--vehicle", VEHICLE]) == 0
    lines = capsys.readouterr().out.splitlines()
    by_name = {line.split()[0]: line for line in lines if line.strip()}
    assert "propeller or mass near M3" in by_name["weak"]
    for name in ("a", "b", "c", "fine"):
        assert "as healthy" in by_name[name]


def test_repeats_together_and_other_voltage(logs: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    words = ["rotors", logs["fine"], logs["low"], "--healthy", logs["a"], "--vehicle", VEHICLE, "--together"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "2 flights" in out
    assert "low: the battery's voltage is more than 5 % from that of the healthy flights" in out


def test_a_flight_is_compared_once_and_with_others(
    logs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        [logs["a"], "--healthy", logs["a"]],
        [logs["weak"], "--healthy", logs["a"], logs["a"]],
    ):
        assert main(["rotors", *words, "--vehicle", VEHICLE]) == 2
        assert "a.usd: given twice" in capsys.readouterr().err


def test_what_would_be_sharper_and_who_is_suspected(
    logs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rotors", logs["weak"], "--healthy", logs["a"], "--vehicle", VEHICLE]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "What would make it sharper - more healthy flights, on several days: with 8 the smallest detectable loss"
        in out
    )
    assert "swap the propeller of M3 with that of a rotor that turns the same way" in out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--vehicle", "twin-boom"], "has no rotors"),
        (["--vehicle", VEHICLE, "--chance", "0.7"], "write a small share"),
        (["--vehicle", "hexa-x"], "motor_5, motor_6 not recorded"),
    ],
)
def test_what_cannot_be_done_is_said(
    logs: dict[str, str], more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rotors", logs["weak"], "--healthy", logs["a"], *more]) == 2
    assert words in capsys.readouterr().err
