"""`stoop maneuvers` as a user meets it: known maneuvers are found, edited windows are fitted, bad logs are told."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.cli.main import main
from stoop.flight import Flight, from_columns, load, save
from stoop.input_design.candidates import candidates
from stoop.input_design.windows import doubts, find_windows
from stoop.input_design.windows_file import read_windows
from stoop.vehicle import load_vehicle
from stoop.vehicle.builtin import resolve_vehicle

QUAD = """
format = "stoop-maneuver/1"
duration = 40.0
rate = 100.0
altitude = 200.0
[[input]]
control = "roll"
shape = "3-2-1-1"
start = 10.0
step = 0.15
amplitude = 15.0
[[input]]
control = "yaw"
shape = "3-2-1-1"
start = 25.0
step = 0.4
amplitude = 1.0
"""
MOTORS = tuple(f"motor_{n}" for n in range(1, 5))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("maneuvers")
    (folder / "m.toml").write_text(QUAD)
    words = ["simulate", "quad-x", "--maneuver", str(folder / "m.toml"), "-o", str(folder / "quad.nc")]
    assert main(words) == 0
    return folder


def changed(place: Path, name: str, change: Callable[[str, FloatArray], FloatArray | None]) -> Path:
    """Write the flight with channels changed, or left out where `change` returns None."""
    flight: Flight = load(place / "quad.nc")
    columns = {str(n): change(str(n), flight.column(str(n))) for n in flight.data.data_vars}
    kept = {n: x for n, x in columns.items() if x is not None and n not in ("q0", "q1", "q2", "q3")}
    save(from_columns(name, flight.time, kept), place / f"{name}.nc")
    return place / f"{name}.nc"


def test_known_maneuvers_are_proposed_and_the_file_can_be_edited(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["maneuvers", str(place / "quad.nc"), "-o", str(place / "w")]) == 0
    said = capsys.readouterr().out
    assert "next: stoop identify" in said
    entries = read_windows(place / "w" / "windows.toml")
    assert any(e.start <= 10.0 and e.stop >= 11.05 for e in entries if e.accept)
    assert any(e.start <= 25.0 and e.stop >= 27.8 for e in entries if e.accept)
    assert sum(e.stop - e.start for e in entries if e.accept) < 20.0
    page = (place / "w" / "windows.html").read_text()
    assert "fill: var(--fitted)" in page
    assert "://" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL).replace(
        "http://www.w3.org", ""
    )


def test_why_speaks_of_the_axis_and_times_have_no_sign_of_their_own(place: Path) -> None:
    flight = load(place / "quad.nc")
    found = find_windows({flight.name: flight}).windows
    assert len(found) > 1
    assert all(w.why.startswith(f"{w.axis} command ") for w in found if w.axis != "motion")
    starts = [one.start for one in candidates(flight, MOTORS)]
    assert min(starts) == 0.0
    assert not np.signbit(starts).any()


def test_motors_that_no_rotor_has_are_told_before_the_search(place: Path) -> None:
    flight = load(place / "quad.nc")
    assert doubts({flight.name: flight}, resolve_vehicle("quad-x")) == []
    columns = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    more = from_columns("hexa", flight.time, {**columns, "motor_5": columns["motor_1"]})
    (doubt,) = doubts({"hexa": more}, resolve_vehicle("quad-x"))
    assert (doubt.code, doubt.values["channels"]) == ("foreign-motors", ("motor_5",))


@pytest.mark.parametrize("vehicle", ["", "quad-x"])
def test_a_hover_in_which_nobody_moved_anything(
    place: Path, vehicle: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    (place / "hover.toml").write_text(QUAD.partition("[[input]]")[0].replace("40.0", "12.0"))
    words = ["simulate", "quad-x", "--maneuver", str(place / "hover.toml"), "--overwrite"]
    assert main([*words, "-o", str(place / "hover.nc")]) == 0
    flight = load(place / "hover.nc")
    columns = {
        str(n): flight.column(str(n)) for n in flight.data.data_vars if n not in ("q0", "q1", "q2", "q3")
    }
    noisy = {n: columns[n] + 1e-4 * rng.normal(size=flight.time.size) for n in MOTORS}
    noisy = {
        f"control_{axis}": x for axis, x in zip(("roll", "pitch", "yaw"), noisy.values(), strict=False)
    } | noisy
    save(from_columns("calm", flight.time, {**columns, **noisy}), place / "calm.nc")
    more = ["--vehicle", vehicle] if vehicle else []
    said = refused(["maneuvers", str(place / "calm.nc"), *more, "-o", str(place / "bad")], capsys)
    assert "no maneuver here" in said
    assert "beyond what feedback" in said


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def off(name: str, x: FloatArray) -> FloatArray:
    return np.zeros(x.size) if name in MOTORS else x


def silent(name: str, x: FloatArray) -> FloatArray | None:
    return None if name in ("p", "q", "r") else x


def still(name: str, x: FloatArray) -> FloatArray:
    return np.full(x.size, np.median(x)) if name in MOTORS else x


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (off, "the motors never ran"),
        (silent, "p, q, r were not recorded"),
        (still, "no command was recorded that moves"),
    ],
)
def test_logs_that_tell_nothing(
    place: Path,
    change: Callable[[str, FloatArray], FloatArray | None],
    advice: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = changed(place, change.__name__, change)
    assert advice in refused(["maneuvers", str(path), "-o", str(place / "bad")], capsys)
    assert not (place / "bad").exists()


@pytest.mark.parametrize("verb", ["maneuvers", "identify"])
def test_logs_of_other_vehicles(
    place: Path, flight_file: Path, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--maneuver", "1:9"] if verb == "identify" else []
    out = ["-o", str(place / "bad")]
    wings = refused([verb, str(flight_file), "--vehicle", "quad-x", *more, *out], capsys)
    assert "'motor_1'" in wings
    assert "this log has no rotors" in wings
    rotors = refused([verb, str(place / "quad.nc"), "--vehicle", "twin-boom", *more, *out], capsys)
    assert "the vehicle of this log is carried by rotors" in rotors
    hexa = refused([verb, str(place / "quad.nc"), "--vehicle", "hexa-x", *more, *out], capsys)
    assert "motor_5" in hexa
    assert "another vehicle" in hexa or "Check --vehicle" in hexa


def test_an_edited_file_that_accepts_nothing(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = place / "none.toml"
    path.write_text(
        'format = "stoop-windows/1"\n[[window]]\nflight = "quad"\nstart = 9.0\nstop = 14.0\naccept = false\n'
    )
    words = ["identify", str(place / "quad.nc"), "--vehicle", "quad-x", "--maneuver", str(path)]
    assert "set accept = true" in refused([*words, "-o", str(place / "bad")], capsys)


def test_what_cannot_be_looked_for_is_said_before_the_search(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quad, file = str(place / "quad.nc"), place / "afile"
    file.write_text("")
    said = refused(["maneuvers", quad, "--free", "rotors.T1", "-o", str(place / "bad")], capsys)
    assert "name it with --vehicle" in said
    said = refused(["maneuvers", quad, "-o", str(file / "w")], capsys)
    assert "afile is a file and holds no folder; name another one with -o" in said
    nan = changed(place, "nan", lambda name, x: x * np.nan if name == "motor_2" else x)
    for more in (["maneuvers"], ["identify", "--maneuver", "9:12"]):
        said = refused(
            [more[0], str(nan), "--vehicle", "quad-x", *more[1:], "-o", str(place / "bad")], capsys
        )
        assert "nan: input 'motor_2' holds no number throughout" in said
    said = refused(
        ["identify", quad, "--vehicle", "quad-x", "--maneuver", "9:9.1", "-o", str(place / "bad")], capsys
    )
    assert "0.1 s are too short; choose another window, one that holds 0.5 s without a hole" in said
    fixed = ["--fix", "rotor.m3.factor", "-o", str(place / "bad")]
    said = refused(["maneuvers", quad, "--vehicle", "quad-x", *fixed], capsys)
    assert "write factor = { value = ..., bounds = [low, high] } into [rotor.m3]" in said


def test_another_vehicles_motors_are_told_before_the_search_of_a_fit(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The search is refused right after: what was told by then was told before it."""
    flight = load(place / "quad.nc")
    columns = {
        str(n): flight.column(str(n)) for n in flight.data.data_vars if n not in ("q0", "q1", "q2", "q3")
    }
    more = {"motor_5": columns["motor_1"], "motor_6": columns["motor_2"], "az": -columns["az"]}
    save(from_columns("hexa", flight.time, {**columns, **more}), place / "hexa.nc")
    words = ["identify", str(place / "hexa.nc"), "--vehicle", "quad-x", "--maneuver", "9:12"]
    assert main([*words, "--validate", "11:14", "-o", str(place / "hexa")]) == 2
    motors, *_, refused = capsys.readouterr().err.splitlines()
    assert motors.startswith("stoop: hexa: motor_5 and motor_6 move too, but belong to no rotor of quad-x")
    assert "overlaps the fitted" in refused


def test_outputs_that_move_as_motors_do_are_told_and_a_gimbal_is_not(place: Path, tmp_path: Path) -> None:
    """An autopilot that logs pulses does not say which of them turn rotors."""
    assert main(["vehicle", "quad-x", "-o", str(tmp_path / "pwm.toml")]) == 0
    text = (tmp_path / "pwm.toml").read_text().replace('"motor_', '"pwm_')
    (tmp_path / "pwm.toml").write_text(text.replace("[rotors]", "[rotors]\nidle = 1000.0\ngain = 0.001"))
    flight = load(place / "quad.nc")
    columns = {
        str(n): flight.column(str(n)) for n in flight.data.data_vars if not str(n).startswith(("motor", "q"))
    }
    pulses = {f"pwm_{n}": 1000.0 + 1000.0 * flight.column(f"motor_{n}") for n in range(1, 5)}
    gimbal = 1500.0 + 400.0 * np.sin(flight.time)
    vehicle = load_vehicle(tmp_path / "pwm.toml")
    for more, told in (({"pwm_5": pulses["pwm_1"] + 5.0, "pwm_7": gimbal}, True), ({"pwm_7": gimbal}, False)):
        log = from_columns("log", flight.time, {**columns, "q": flight.column("q"), **pulses, **more})
        found = doubts({"log": log}, vehicle)
        assert [one.values["channels"] for one in found] == [("pwm_5",)] * told
