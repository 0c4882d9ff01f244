"""The way of a user, on logs as an autopilot writes them: closed loop, wind, gusts, lost messages, and a wrong start."""

from __future__ import annotations

import shlex
import struct
from pathlib import Path

import numpy as np
import pytest
from unit.cli.conftest import Done

from stoop.exporters.log_bytes import ulog_dropout
from stoop.vehicle import load_vehicle
from stoop.vehicle.builtin import builtin_text

QUAD = builtin_text("quad-x")
GUSTS = "\n[turbulence]\nairspeed = 5.0\n" + "".join(
    f"{axis} = {{ intensity = 0.3, length = 50.0 }}\n" for axis in "uvw"
)
SHAPE = '[[input]]\ncontrol = "{}"\nshape = "{}"\nstart = {}\nstep = {}\namplitude = {}\n'
INPUTS = (
    ("roll", "3-2-1-1", 2.0, 0.15, 15.0),
    ("pitch", "3-2-1-1", 5.0, 0.15, 15.0),
    ("yaw", "3-2-1-1", 8.0, 0.3, 1.0),
    ("roll", "doublet", 12.0, 0.3, 12.0),
)
HEADER = 16  #: bytes of a ULog before its messages
LOST = (0.76, 0.79)  #: shares of the log between which a busy card lost data


def lose_data(log: Path) -> None:
    """Take messages of data out of a ULog, as a logger does whose card is busy, and say so in it."""
    content = log.read_bytes()
    at, kept, lost = HEADER, [content[:HEADER]], 0
    while at < len(content):
        end = at + 3 + struct.unpack_from("<H", content, at)[0]
        if content[at + 2 : at + 3] == b"D" and LOST[0] <= at / len(content) < LOST[1]:
            lost += 1
        else:
            kept.append(content[at:end])
        at = end
    assert lost > 10
    log.write_bytes(b"".join([*kept, ulog_dropout(400)]))


def hover_thrust(vehicle: Path) -> float:
    command = max(np.roots([6.0, 2.5, -1.5 * 9.80665 / 4.0]).real)
    model = load_vehicle(vehicle)
    return float(model.value("rotors.T1") * command + model.value("rotors.T2") * command**2)


def test_from_a_log_to_a_model_that_predicts_another(here: Path, done: Done) -> None:
    Path("truth.toml").write_text(QUAD + GUSTS)
    inputs = "".join(SHAPE.format(*one) for one in INPUTS)
    Path("m.toml").write_text(f"duration = 15.0\nrate = 100.0\nwind = [2.0, 1.0, 0.0]\n{inputs}")
    for name, seed in (("log", 1), ("other", 2)):
        done(f"simulate truth.toml --maneuver m.toml --seed {seed} -o {name}.ulg")
        lose_data(Path(f"{name}.ulg"))
    assert "the logger reports 1 dropouts, 0.40 s in all" in " ".join(done("info log.ulg --verbose").split())
    done("map log.ulg -o mapping.toml")
    said = done("info log.ulg --mapping mapping.toml").splitlines()
    (line,) = (line for line in said if line.startswith("next: "))
    wrong = QUAD.replace("T1 = 2.5", "T1 = 1.5").replace("torque_ratio = 0.016", "torque_ratio = 0.022")
    Path("V.toml").write_text(wrong)
    assert hover_thrust(Path("V.toml")) < 0.9 * hover_thrust(Path("truth.toml"))
    command = [*shlex.split(line)[2:], "--method", "equation-error"]
    folder = command[command.index("-o") + 1]
    done(command)
    found = Path(folder) / "vehicle.toml"
    assert hover_thrust(found) == pytest.approx(hover_thrust(Path("truth.toml")), rel=0.02)
    assert load_vehicle(found).value("rotors.torque_ratio") == pytest.approx(0.016, rel=0.1)
    told = done(f"validate {folder} other.ulg -o check").splitlines()
    ahead = next(line.split() for line in told if line.startswith("better than a first-order lag in "))
    better, compared = int(ahead[6]), int(ahead[8])
    assert compared >= 4
    assert better > 0.5 * compared, ahead
    assert Path("check/validation.html").is_file()
