"""`stoop maneuvers` as a user meets it: known maneuvers are found, edited windows are fitted, bad logs are told."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Cli, Done, Refused

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, from_columns, load_flight, save_flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text, load_vehicle
from stoop_plan.input_design.windows import doubts
from stoop_plan.input_design.windows_file import read_windows

MOTORS = tuple(f"motor_{n}" for n in range(1, 5))
Columns = dict[str, FloatArray]


@pytest.fixture(scope="module")
def hover(hover_file: Path) -> Flight:
    return load_flight(hover_file)


def columns_of(flight: Flight) -> Columns:
    names = [str(n) for n in flight.data.data_vars]
    return {n: flight.column(n) for n in names if n not in ("q0", "q1", "q2", "q3")}


def test_known_maneuvers_are_proposed(hover_file: Path, tmp_path: Path, done: Done) -> None:
    assert "next: stoop identify" in done(["maneuvers", hover_file, "-o", tmp_path / "w"])
    accepted = [e for e in read_windows(tmp_path / "w" / "windows.toml") if e.accept]
    for start, stop in ((10.0, 11.05), (25.0, 27.8)):
        assert any(e.start <= start and e.stop >= stop for e in accepted)
    assert sum(e.stop - e.start for e in accepted) < 20.0
    page = (tmp_path / "w" / "windows.html").read_text()
    assert "fill: var(--fitted)" in page
    bare = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert "://" not in bare.replace("http://www.w3.org", "")


def test_motors_that_no_rotor_has_are_told_before_the_search_and_a_gimbal_is_not(hover: Flight) -> None:
    """An autopilot that logs pulses does not say which of them turn rotors."""
    quad, columns = load_vehicle("quad-x"), columns_of(hover)
    assert doubts({hover.name: hover}, quad) == []
    more = from_columns("hexa", hover.time, {**columns, "motor_5": columns["motor_1"]})
    (doubt,) = doubts({"hexa": more}, quad)
    assert (doubt.code, doubt.values["channels"]) == ("foreign-motors", ("motor_5",))
    text = builtin_text("quad-x").replace('"motor_', '"pwm_')
    vehicle = parse_vehicle(text.replace("[rotors]", "[rotors]\nidle = 1000.0\ngain = 0.001"), "pwm")
    pulses = {f"pwm_{n}": 1000.0 + 1000.0 * columns.pop(f"motor_{n}") for n in range(1, 5)}
    gimbal = 1500.0 + 400.0 * np.sin(hover.time)
    for more, told in (({"pwm_5": pulses["pwm_1"] + 5.0, "pwm_7": gimbal}, True), ({"pwm_7": gimbal}, False)):
        log = from_columns("log", hover.time, {**columns, **pulses, **more})
        assert [one.values["channels"] for one in doubts({"log": log}, vehicle)] == [("pwm_5",)] * told


def without(*names: str) -> Callable[[Columns], Columns]:
    return lambda x: {n: values for n, values in x.items() if n not in names}


def motors(change: Callable[[FloatArray], FloatArray]) -> Callable[[Columns], Columns]:
    return lambda x: {n: change(values) if n in MOTORS else values for n, values in x.items()}


def calm(x: Columns) -> Columns:
    """Return the first 9.5 s, in which nobody moves anything, with noise on the motors, which is commanded, too."""
    rng, first = np.random.default_rng(0), {n: values[:950] for n, values in x.items()}
    noisy = {n: first[n] + 1e-4 * rng.normal(size=950) for n in MOTORS}
    commands = {f"control_{axis}": noisy[f"motor_{i}"] for i, axis in enumerate(("roll", "pitch", "yaw"), 1)}
    return {**first, **commands, **noisy}


def changed(flight: Flight, name: str, change: Callable[[Columns], Columns]) -> Path:
    columns = change(columns_of(flight))
    save_flight(from_columns(name, flight.time[: columns["motor_1"].size], columns), Path(f"{name}.nc"))
    return Path(f"{name}.nc")


def test_logs_that_tell_nothing(hover: Flight, refused: Refused) -> None:
    for change, more, advice in (
        (motors(np.zeros_like), "", "the motors never ran"),
        (without("p", "q", "r"), "", "p, q, r were not recorded"),
        (motors(lambda x: np.full(x.size, np.median(x))), "", "no command was recorded that moves"),
        (calm, "", "no maneuver here"),
        (calm, "--vehicle quad-x", "beyond what feedback"),
    ):  # fmt: skip
        assert advice in refused(f"maneuvers {changed(hover, 'log', change)} {more} -o bad")


def test_logs_of_other_vehicles(hover: Flight, hover_file: Path, flight_file: Path, refused: Refused) -> None:
    nan = changed(hover, "nan", lambda x: {**x, "motor_2": np.nan * x["motor_2"]})
    Path("afile").touch()
    window = '[[window]]\nflight = "quad"\nstart = 9.0\nstop = 14.0\naccept = false\n'
    Path("none.toml").write_text(f'format = "stoop-windows/1"\n{window}')
    for verb, more in (("maneuvers", ""), ("identify", "--maneuver 1:9")):
        for log, vehicle, said in (
            (flight_file, "quad-x", "this log has no rotors"), (hover_file, "hexa-x", "motor_5"),
            (hover_file, "twin-boom", "the vehicle of this log is carried by rotors"),
            (nan, "quad-x", "nan: input 'motor_2' holds no number throughout"),
        ):  # fmt: skip
            assert said in refused(f"{verb} {log} --vehicle {vehicle} {more} -o bad")
    for command, said in {
        f"identify {hover_file} --vehicle quad-x --maneuver none.toml -o bad": "set accept = true",
        f"maneuvers {hover_file} --free rotors.T1 -o bad": "name it with --vehicle",
        f"maneuvers {hover_file} -o afile/w": "afile is a file and holds no folder; name another one with -o",
        f"identify {hover_file} --vehicle quad-x --maneuver 9:9.1 -o bad":
            "0.1 s are too short; choose another window, one that holds 0.5 s without a hole",
        f"maneuvers {hover_file} --vehicle quad-x --fix rotor.m3.factor -o bad":
            "write factor = { value = ..., bounds = [low, high] } into [rotor.m3]",
    }.items():  # fmt: skip
        assert said in refused(command), command


def test_another_vehicles_motors_are_told_before_a_search(hover: Flight, here: Path, cli: Cli) -> None:
    more = {"motor_5": hover.column("motor_1"), "motor_6": hover.column("motor_2"), "az": -hover.column("az")}
    log = changed(hover, "hexa", lambda x: x | more)
    code, _, err = cli(f"identify {log} --vehicle quad-x --maneuver 9:12 --validate 11:14 -o hexa")
    assert code == 2
    assert err.startswith("stoop: hexa: motor_5 and motor_6 move too, but belong to no rotor of quad-x")
    assert "overlaps the fitted" in err.splitlines()[-1]
