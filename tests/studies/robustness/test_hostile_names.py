"""Names of vehicles and flights that are code somewhere: in no output do they become more than text."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from studies.robustness import small_runs
from studies.robustness.campaign import check
from studies.robustness.hostile_names import NAMES, PLAIN, SEVERAL, code, codes, renamed, with_name
from studies.robustness.small_runs import OUT, TO, inputs, run, written
from studies.robustness.trials import READ, BrokenPromiseError, lay_out, promise, try_case

from stoop.exporters.exporter import ModelData
from stoop.exporters.targets import TARGETS
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text

Made = Callable[[str, str], Mapping[str, bytes]]  #: of a target or a command, and a name
EXPORTED = {
    target: "quad-x"
    if target in ("rotorpy", "mujoco", "pyflyt", "gym-pybullet-drones", "crazyflow", "isaac")
    else "quadplane"
    if target in ("gazebo", "px4-jsbsim")
    else "twin-boom"
    for target in TARGETS
}


def exported(target: str, name: str) -> Mapping[str, bytes]:
    vehicle = parse_vehicle(with_name(builtin_text(EXPORTED[target]), name), "vehicle.toml")
    return TARGETS[target].load()(ModelData(vehicle)).files().files


def same(found: Mapping[str, bytes], plain: Mapping[str, bytes], name: str) -> None:
    found, plain = codes(found), codes(renamed(plain, name))
    promise(sorted(found) == sorted(plain), f"other files: {sorted(found.keys() ^ plain.keys())}")
    for place, text in found.items():
        promise(text == plain[place], f"other code: {place}")


@cache
def plain(made: Made, what: str) -> Mapping[str, bytes]:
    return made(what, PLAIN)


def same_code(_: Path, made: Made, what: str, name: str) -> str:
    same(made(what, name), plain(made, what), name)
    return READ


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("target", TARGETS)
def test_no_name_of_a_vehicle_becomes_code_of_an_export(target: str, name: str, tmp_path: Path) -> None:
    check(
        "hostile names", f"export to {target}", try_case(same_code, tmp_path, exported, target, NAMES[name])
    )


WORDS = {"m1": "end", "m2": "nil", "m3": "lambda", "m4": "double"}


@pytest.mark.parametrize("target", [target for target in TARGETS if target != "ardupilot-jsbsim"])
def test_keywords_as_names_of_rotors(target: str) -> None:
    text = builtin_text("quad-x")
    for name, word in WORDS.items():
        text = re.sub(rf"\b{name}\b", word, text)
    vehicle = parse_vehicle(text, "vehicle.toml")
    assert set(WORDS.values()) <= set(vehicle.rotors)
    found = TARGETS[target].load()(ModelData(vehicle)).files().files
    plain = (
        TARGETS[target].load()(ModelData(parse_vehicle(builtin_text("quad-x"), "vehicle.toml"))).files().files
    )
    for place, content in plain.items():
        if not place.endswith((".mat", ".fmu", ".json")):  # whose keys and texts are the names
            promise(code(place, found[place]) == code(place, content), f"other code: {place}")


FLOWN = ("--duration", "6", "--evaluations", "4", "--shape", "square", *TO)
THROWS = ("--throw", "elevator=20", "aileron=20", "rudder=20")
COMMANDS = {
    **{
        name: words
        for name, words in small_runs.COMMANDS.items()
        if name not in ("compare", "reproduce", "figure", "verify")
    },
    "columns": ("map", "columns.csv", "-o", f"{OUT}/map.toml"),
    "look": ("look", "sim.nc", "-o", f"{OUT}/look.html"),
    "look table": ("look", "table.csv", "-o", f"{OUT}/look.html"),
    "frequency": ("frequency", "sim.nc", "--vehicle", "model", "-o", f"{OUT}/frequency.html"),
    "propagate": ("propagate", "model", "--draws", "100", "-o", f"{OUT}/propagation.html"),
    "derivatives": ("derivatives", "twin.toml", "-o", f"{OUT}/derivatives.csv"),
    "named": ("vehicle", "new", "sim.nc", *small_runs.DIMENSIONS, "--name=NAME", "-o", f"{OUT}/v.toml"),
    "pilot": ("design", "v.toml", "--for", "pilot", *FLOWN, "--duration", "24", "--shape", "3-2-1-1"),
    "ardupilot": ("design", "twin.toml", "--for", "ardupilot", *THROWS, *FLOWN),
    "px4": ("design", "twin.toml", "--for", "px4", *THROWS, *FLOWN),
    "crazyflie": ("design", "quad.toml", "--for", "crazyflie", "--amplitude", "heave=0", *FLOWN),
}  #: name -> command on the inputs, in whose flights, vehicles, tables and words a hostile name is put


def named_inputs(name: str) -> dict[str, bytes]:
    """Return the inputs under a name: of vehicles, of flights in results, of files and of columns."""
    found = dict(inputs())
    for place in ("v.toml", "model/vehicle.toml"):
        found[place] = with_name(found[place].decode(), name).encode()
    for place, builtin in (("twin.toml", "twin-boom"), ("quad.toml", "quad-x")):
        found[place] = with_name(builtin_text(builtin), name).encode()
    result = json.loads(found["model/result.json"])
    for maneuver in result["maneuvers"]:
        maneuver["flight"] = file_stem(name)
    found["model/result.json"] = json.dumps(result).encode()
    found[f"{file_stem(name)}.nc"] = found.pop("sim.nc")
    head, *rows = csv.reader(io.StringIO(found["table.csv"].decode()))
    table = io.StringIO()
    csv.writer(table).writerows([[*head, name], *([*row, f"{i % 7}"] for i, row in enumerate(rows))])
    found["columns.csv"] = table.getvalue().encode()
    for ending in (".csv", ".csv.toml"):
        found[f"{file_stem(name)}{ending}"] = found.pop(f"table{ending}")
    return found


def file_stem(name: str) -> str:
    """Return a name that a file of a result may have."""
    return name.replace("\\", "").replace("/", "\N{DIVISION SLASH}").replace("\0", "\N{SYMBOL FOR NULL}")


def outputs(command: str, name: str) -> Mapping[str, bytes]:
    """Return the files that a verb writes under a name."""
    stem = file_stem(name)
    words = {
        "sim.nc": f"./{stem}.nc",
        "table.csv": f"./{stem}.csv",
        "--name=NAME": f"--name={name}".replace("\0", ""),
    }
    with TemporaryDirectory(prefix="stoop-") as place, contextlib.chdir(place):
        lay_out(Path(place), named_inputs(name))
        Path(OUT).mkdir()
        ended = run(tuple(words.get(word, word) for word in COMMANDS[command]))
        promise(ended.code == 0, f"{command}: {ended.stderr_lines[-1:]}")
        promise(all(line.isprintable() for line in ended.stderr_lines), "steers a terminal")
        return written(Path(OUT))


@pytest.mark.parametrize("name", SEVERAL, ids=range(len(SEVERAL)))
@pytest.mark.parametrize("command", COMMANDS)
def test_no_name_becomes_code_of_an_output(command: str, name: str, tmp_path: Path) -> None:
    check("hostile names", command, try_case(same_code, tmp_path, outputs, command, name))


SEEN = {
    "a.c": ('/* n */ int x;\n// n\nchar *s = "n";', '/* n */ system(); /* */ int x;\n// n\nchar *s = "n";'),
    "a.lua": ('-- n\nlocal x = "n" --[[ n ]]', '-- n\nos.execute()\nlocal x = "n" --[[ n ]]'),
    "a.m": ("% n\nx = y' + z';  % 'n'\ns = 'n''n';", "% n\nx = y' + z';  % 'n'\ns = 'n'; system('n');"),
    "a": ("# n\nparam set A 'n'", "# n\ntouch x\nparam set A 'n'"),
    "a.py": ('"""n"""\nx = "n"', '"""n"""\nimport os\nx = "n"'),
    "a.xml": ("<a b='n'>n</a>", "<a b='n' c='n'>n</a>"),
    "a.html": ("<p>n</p>", "<p>n<img src=x></p>"),
    "a.toml": ('a = "n"', 'a = "n"\nb = "n"'),
    "a.json": ('{"a": "n"}', '{"a": "n", "b": 1}'),
    "a.md": ("# n", "# <b>n</b>"),
    "a.parm": ("A 1\n# n", "A 1\nB 1\n# n"),
    "a.csv": ("a,n\r\n1,2", "a,n\r\nb,1,2"),
}


@pytest.mark.parametrize("place", SEEN)
def test_a_name_that_becomes_code_is_seen(place: str) -> None:
    plain, hostile = (text.encode() for text in SEEN[place])
    other = plain.replace(b"n", b"abc") if place not in ("a.c", "a.lua", "a.py") else plain
    assert code(place, plain) == code(place, other)
    assert code(place, plain) != code(place, hostile)


@pytest.mark.parametrize("cell", ["=1+1", "+x", "-x()", "@SUM(1)", "\tx"])
def test_a_formula_of_a_spreadsheet_is_seen(cell: str) -> None:
    code("a.csv", b"a,b\r\n-1.5,+2e3")
    with pytest.raises(BrokenPromiseError):
        code("a.csv", f"a,b\r\n1,{cell}".encode())


@pytest.mark.parametrize("text", ["<a href='javascript:x()'>", "<p onclick='x()'>"])
def test_a_script_in_an_attribute_is_seen(text: str) -> None:
    with pytest.raises(BrokenPromiseError):
        code("a.html", text.encode())
