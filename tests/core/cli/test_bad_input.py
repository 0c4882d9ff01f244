"""Whatever is wrong with what the user gives: one line that names the file and the fix, code 2, nothing written."""

import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import pytest
from helpers.command_line import Cli, Refused

TWIN_BOOM = (files("stoop.data") / "twin_boom.toml").read_text()
MANEUVER = (Path(__file__).parents[3] / "examples" / "maneuver_3211.toml").read_text()
COLUMNS = 'q = { column = "q", unit = "rad/s" }\ntheta = { column = "theta", unit = "rad" }\n'
MAPPING = f'[time]\ncolumn = "t"\nunit = "s"\n[variables]\n{COLUMNS}'

#: name -> content, what the complaint of `stoop info` says
LOGS: Mapping[str, tuple[bytes | None, str]] = {
    "missing.ulg": (None, "no such file or folder; check the name"),
    "garbage.ulg": (b"\x00\xff" * 500, "not a ULog file"),
    "cut.nc": (b"CDF\x01" + bytes(range(256)), "write the flight again"),
    "log.bin": (b"abc", "unknown format; stoop reads .ulg, .nc, .csv"),
    "bare.csv": (b"t,q\n0,1\n1,2\n", "needs a mapping"), "\x1b[31mred\x1b[0m.ulg": (b"", "empty"),
    "[bold red]x[1].ulg": (b"", "empty"), "two\nlines.ulg": (b"", "empty"),
}  # fmt: skip


def test_logs(refused: Refused) -> None:
    for name, (content, complaint) in LOGS.items():
        if content is not None:
            Path(name).write_bytes(content)
        said = refused(["info", name])
        assert complaint in said, name
        assert said.startswith(f"stoop: error: {name}: ") or not name.isprintable()
    Path("folder").mkdir()
    assert "folder: no PX4 topic among its files" in refused("info folder")


TRIM, FLY, INFO = (
    "trim v.toml", "simulate twin-boom --maneuver m.toml -o out.nc", "info log.csv --mapping columns.toml",
)  # fmt: skip
#: command, file that is wrong, a text in it, what stands instead, what the complaint says
SPOILED = (
    (TRIM, "v.toml", "zz = 200.0", "zz = 300.0", "mass.inertia"),
    ("linearize v.toml", "v.toml", "zz = 200.0", "zz = 300.0", "mass.inertia"),
    ("simulate v.toml --maneuver m.toml -o out.nc", "v.toml", "zz = 200.0", "zz = 300.0", "mass.inertia"),
    (TRIM, "v.toml", "CLalpha = 4.78", "CLx = { term = \"__import__('os').abort()\", value = 0.1 }", "not allowed"),
    (TRIM, "v.toml", "alpha = 0.0", "alpha = 5.88", "radians"),
    (TRIM, "v.toml", "[mass]", "[mass", "TOML"),
    (TRIM, "v.toml", "CLalpha = 4.78", "CLalpha = 0.0", "no steady flight"),
    (FLY, "m.toml", '"elevator"', '"elevtor"', "elevator"),
    (FLY, "m.toml", "step = 0.3", "stp = 0.3", "step"),
    (FLY, "m.toml", "[[input]]", "[[input", "TOML"),
    (FLY, "m.toml", "airspeed = 35.0", "airspeed = 3.0", "no steady flight"),
    (FLY, "m.toml", "[[input]]", "[noise]\nspeed = 1.0\n[[input]]", "speed"),
    (INFO, "log.csv", "theta", "pitch", "'theta' is not in log.csv"),
    (INFO, "log.csv", "\n", "\nx", "time"),
    (INFO, "columns.toml", "q =", "pitch_rate =", "no variable of stoop"),
    (INFO, "columns.toml", '"rad"', '"grad"', "did you mean rad"),
    (INFO, "columns.toml", "[time]", "[time", "not valid TOML"),
)  # fmt: skip


@pytest.mark.parametrize(("command", "name", "old", "new", "complaint"), SPOILED)
def test_mistakes(command: str, name: str, old: str, new: str, complaint: str, refused: Refused) -> None:
    rows = (f"{0.01 * i},{0.1 * math.cos(0.02 * i)},{math.sin(0.02 * i)}" for i in range(500))
    table = "\n".join(["t,q,theta", *rows, ""])
    good = {"v.toml": TWIN_BOOM, "m.toml": MANEUVER, "log.csv": table, "columns.toml": MAPPING}
    assert old in good[name]
    for file, text in {**good, name: good[name].replace(old, new, 1 if name == "m.toml" else -1)}.items():
        Path(file).write_text(text)
    said = refused(command)
    assert complaint in said
    assert re.match(r"stoop: error: (v\.toml|m\.toml|twin-boom|log\.csv|columns\.toml): ", said), said


def test_files_of_no_text_and_names_of_flights(refused: Refused) -> None:
    for content in (b"", b"\xff\xfe\x00", b"\x00" * 100):
        Path("v.toml").write_bytes(content)
        assert refused(TRIM).startswith("stoop: error: v.toml: ")
    Path("log.csv").write_text("t,q,theta\n0,1,1\n")
    assert "none.toml: cannot read the mapping file" in refused("info log.csv --mapping none.toml")
    Path("m.toml").write_text(MANEUVER)
    Path("folder.nc").mkdir()
    for name, complaint in (
        ("flight.txt", "end its name in .nc"), ("flight", "end its name in .nc"), ("", "this is a folder"),
        ("nowhere/flight.nc", "there is no folder nowhere; make it first"), ("folder.nc", "this is a folder"),
    ):  # fmt: skip
        assert complaint in refused(["simulate", "twin-boom", "--maneuver", "m.toml", "-o", name]), name


#: command -> what the complaint says
WORDS: Mapping[str, str] = {
    "trim twin-boom --airspeed nan": "--airspeed",
    "trim twin-boom --climb-angle 90": "--climb-angle",
    "trim twin-boom --wind 5 0 0": "--wind: twin-boom flies on its wings here",
    "trim twin-boom --velocity 5 0 0": "--velocity: twin-boom flies on its wings here",
    "trim quad-x --climb-angle 5": "--climb-angle: quad-x flies on its rotors here; write --velocity",
    "trim quad-x --airspeed 9": "quad-x: it has no wings to fly 9 m/s on",
    "trim quad-x --wind 30 0 0": "and its range ends at 1; make it lighter",
    "simulate twin-boom -o a.nc": "--maneuver",
    "design twin-boom -o out --amplitude flap=3": "there is no control 'flap'",
    "design twin-boom -o out --amplitude three": "'three' is not a number; write DEG or CONTROL=DEG",
    "design twin-boom -o out --amplitude 100": "not between 0 and 90 degrees",
    "design twin-boom -o out --amplitude 0": "give one an amplitude above zero",
    "design twin-boom -o out --within alpha=5": "write CHANNEL=LOW:HIGH",
    "design twin-boom -o out --within alpha=9:5": "LOW below HIGH",
    "design twin-boom -o out --within alpha=-9:-5": "widen that limit or choose another airspeed",
    "design twin-boom -o out --duration 1": "is too short",
    "design twin-boom -o out --optimizer best": "there is none of that name",
    "design twin-boom -o out --optimizer ps-gde-lm": "needs residuals; choose --optimizer ps-gde or scipy-de",
    "design twin-boom -o out --for crazyflie": "this flight is on wings; choose --for pilot",
    "design twin-boom -o out --min-amplitude elevator=4": "is below the smallest that can be flown, 4 deg",
    "design twin-boom -o out --for pilot --duration 9": "takes 20.5 s at least",
    "design twin-boom -o out --for ardupilot --throw flap=20": "no such surface; choose from elevator, aileron, rudder",
    "design twin-boom -o out --for px4": "move at full output is not known",
    "design nowhere.json -o out": "name the folder that stoop identify wrote",
    "export nothing.toml --to jsbsim -o out": "there is no such vehicle file",
    "export empty --to jsbsim -o out": "holds no result.json",
    "export twin-boom --to jsbsim -o empty/file": "is a file; name a folder",
    "export twin-boom --to rotorpy -o out": "this one has 0",
    "export quad-x --to ardupilot-jsbsim -o out": "and no rotors; export to px4-jsbsim",
    "export twin-boom --to pyflyt -o out": "PyFlyt flies quadrotors on their rotors",
    "export quad-x --to mujoco --draws 100 -o out": "--draws needs estimates with their errors",
    "vehicle quad_x.toml": "did you mean the built-in vehicle quad-x?",
    "vehicle submarine": "there is no such built-in vehicle",
    "vehicle -o my.toml": "-o needs the name of a vehicle",
    "vehicle new log.ulg --mass 8.5kg -o own.toml": "write it in kg, without the unit",
    "vehicle new --template v-tail --span 2.3 -o v.toml": "--mass",
    "vehicle new --geometry g.toml --mass 9 -o v.toml": "--mass: is 9",
    "vehicle new --geometry g.toml --aerodynamics wind-tunnel -o v.toml": "choose one of handbook, aerosandbox",
    "vehicle new --template glider --mass 2 --span 2 --area 0.4 --aerodynamics aerosandbox -o v.toml": "needs dimensions",
    "example quadroter -o q": "did you mean quadrotor?",
    "example -o q": "needs the name",
    "reproduce figure4": "invalid choice: 'figure4'",
    "reproduce": "required: EXPERIMENT",
    "reproduce figure3 -o empty/file": "is a file; name a folder",
    "compare -o out --optimizers ps-gde,cmaes": "optimizer cmaes",
    "compare -o out --optimizers ps-gde:speed=2": "no speed can be chosen",
    "compare -o out --problems paper-M": "did you mean paper-W",
    "compare -o out --problems bbob-99": "bbob-",
    "compare -o out --problems bbob-01 --first-seed 0": "instance 0",
    "compare -o out --flight log.ulg": "--vehicle and --maneuver",
    "compare -o out --flight no.ulg --vehicle v.toml --maneuver 1:2": "no.ulg",
    "structure twin-boom x.nc --maneuver 0:1 -o o --band 2": "LOW:HIGH",
    "demo -o demo --seed -1": "--seed: '-1' is not a whole number",
    "completion tcsh": "invalid choice: 'tcsh'",
    "map no.csv": "no.csv",
    "trim": "(see stoop trim --help)",
    "nosuch": "there is no verb",
    "info a b": "--help)",
    "identfy": "no verb 'identfy'; did you mean identify? (see stoop --help)",
    "vehcle new": "did you mean vehicle or vehicle new? (see stoop --help)",
    "--debgu trim": "there is no option --debgu; did you mean --debug? (see stoop --help)",
    "identify a.ulg --vehicel=v.toml --maneuver 1:2 -o out": "did you mean --vehicle? (see stoop identify --help)",
}  # fmt: skip


@pytest.mark.parametrize("verb", {command.split()[0]: None for command in WORDS})
def test_words(verb: str, refused: Refused) -> None:
    Path("empty").mkdir()
    Path("empty/file").write_text("mine")
    Path("g.toml").write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n')
    for command, complaint in WORDS.items():
        if command.split()[0] == verb:
            assert complaint in refused(command), command


def test_words_about_a_fitted_model(refused: Refused, fitted: Path) -> None:
    shutil.copytree(fitted, "fit")
    for further, complaint in {
        "--expression x=CLalpa": "no number 'CLalpa'; did you mean CLalpha",
        "--expression CLalpha": "write NAME=EXPRESSION", "--expression a=CD0 a=CL0": "given twice",
        "--airspeed 40": "give LOW:HIGH, the lower", "--airspeed 40:30": "from 0 to 10000 m/s",
        "--airspeed 2:3": "nothing trims at 3 m/s with the estimates; give --airspeed A:B",
        "--source posterior": "its posterior was not sampled", "--draws 5": "give a number from 100",
    }.items():  # fmt: skip
        assert complaint in refused(f"propagate fit {further}"), further


#: further words of `stoop identify` with a flight of 30 s -> complaint
FITS = {
    "--maneuver x": "START:STOP", "--maneuver -5:-1": "outside the record, which runs from 0.00 to 30.00 s",
    "--maneuver -5:20": "runs from 0.00 to 30.00 s on the log's own clock; write 0:20 for",
    "--maneuver 20:60": "runs from 0.00 to 30.00 s on the log's own clock; write 20:30 for",
    "--maneuver -9:90": "runs from 0.00 to 30.00 s on the log's own clock; write 0:30 for",
    "--maneuver 0:20 --free CLalfa": "did you mean CLalpha", "--maneuver 0:20 --free CLq --fix CLq": "keep one",
    "--maneuver 0:20 --free Clp": "--free Clp: the equations of",
    "--maneuver 0:20 --fix sensors.p.bias": "--fix sensors.p.bias: the equations of",
    "--maneuver 0:20 --optimizer magic": "ps-gde-lm",
    "--maneuver 0:20 --noise none.csv": "none.csv: no such file; check the name",
    "--maneuver 0:20 --target-cost nan": "--target-cost: 'nan' is not a number",
    "--maneuver 0:20 --generations 0": "--generations: '0' is not a whole number from 1 to",
    "--maneuver 0:20 --budget inf": "--budget: 'inf' is not a positive number",
    "--maneuver 0:20 --seed x": "whole number", "--maneuver 0:20 --resume": "no interrupted search", "": "--maneuver",
}  # fmt: skip


def test_fits(refused: Refused, flight_file: Path) -> None:
    shutil.copy(flight_file, "flight.nc")
    text = TWIN_BOOM.replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    Path("v.toml").write_text(text)
    for further, complaint in FITS.items():
        assert complaint in refused(f"identify flight.nc --vehicle v.toml -o bad {further}"), further
    for missing in ("none.nc --vehicle v.toml", "flight.nc --vehicle none.toml"):
        assert "none." in refused(f"identify {missing} --maneuver 0:20 -o bad")
    for name, controls, more, complaints in (
        ("pwm", "[controls.elevator]\nmix = { pwm_3 = 0.001 }\n[controls.aileron]\n", "", ("pwm_3", "elevator")),
        ("tied", '[controls.aileron]\nlag = 0.05\n[controls.elevator]\nlag = "=controls.aileron.lag"\n',
         "--fix controls.elevator.lag",
         ("--fix controls.elevator.lag: tied to controls.aileron.lag; name that one",)),
    ):  # fmt: skip
        basis = text if name == "pwm" else TWIN_BOOM
        Path(f"{name}.toml").write_text(f"{basis}\n{controls}[controls.rudder]\n")
        said = refused(f"identify flight.nc --vehicle {name}.toml --maneuver 0:20 -o bad {more}")
        assert all(complaint in said for complaint in complaints), said
    for extra in ("", "--overwrite", "--resume"):
        said = refused(f"identify flight.nc --vehicle v.toml --maneuver 0:20 -o . {extra}")
        assert "flight.nc: is read by this run" in said
    Path("old").mkdir()
    Path("old/result.json").write_text("mine")
    assert "--overwrite" in refused("identify flight.nc --vehicle v.toml --maneuver 0:20 -o old")


def test_names_in_a_vehicle_file_are_text(refused: Refused, cli: Cli) -> None:
    for name in ("[bold red]x[/] \x1b[31m", "two\\nlines", "\u202ereversed"):
        quoted = name.replace("\x1b", "\\u001b")
        Path("v.toml").write_text(TWIN_BOOM.replace('name = "Twin-boom', f'name = "{quoted}'), "utf-8")
        code, out, err = cli("trim v.toml --reduce longitudinal")
        assert (code, err) == (0, "")
        assert all(line.isprintable() for line in out.split("\n"))
        assert "[bold red]x[/]" in out or "bold" not in name


def test_a_process_whose_output_is_ascii_leaves_no_traceback(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stoop", os.fsdecode(b"lost\xff")], cwd=tmp_path, capture_output=True, check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"stoop: error: there is no verb 'lost\\udcff'")
