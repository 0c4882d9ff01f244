"""Names of vehicles, flights and columns that are code somewhere: in no output do they become more than text."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from studies.robustness.hostile_names import PLAIN, SEVERAL, code, codes, renamed, with_name
from studies.robustness.small_runs import COMMANDS, OUT, inputs, run, written
from studies.robustness.trials import BrokenPromiseError, lay_out

from stoop.exporters.exporter import ModelData
from stoop.exporters.targets import TARGETS
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text

LEARNING = ("rotorpy", "mujoco", "pyflyt", "gym-pybullet-drones", "crazyflow", "isaac")
WRITERS = (
    "identify", "validate", "compatibility", "structure", "maneuvers", "state-space", "flight", "table", "map", "look",
    "propagate",
)  # fmt: skip


def exported(target: str, text: str) -> Mapping[str, bytes]:
    return TARGETS[target].load()(ModelData(parse_vehicle(text, "vehicle.toml"))).files().files


def assert_same_code(found: Mapping[str, bytes], plain: Mapping[str, bytes], name: str) -> None:
    hostile, expected = codes(found), codes(renamed(plain, name))
    assert sorted(hostile) == sorted(expected)
    for place, text in hostile.items():
        assert text == expected[place], f"other code: {place}"


@pytest.mark.parametrize("target", TARGETS)
def test_no_name_of_a_vehicle_becomes_code_of_an_export(target: str) -> None:
    builtin = (
        "quad-x" if target in LEARNING else "quadplane" if target in ("gazebo", "px4-jsbsim") else "twin-boom"
    )
    plain = exported(target, with_name(builtin_text(builtin), PLAIN))
    for name in SEVERAL:
        assert_same_code(exported(target, with_name(builtin_text(builtin), name)), plain, name)


def file_stem(name: str) -> str:
    """Return a name that a file of a result may have."""
    return name.replace("\\", "").replace("/", "\N{DIVISION SLASH}").replace("\0", "\N{SYMBOL FOR NULL}")


def named_inputs(name: str) -> dict[str, bytes]:
    """Return the inputs under a name: of vehicles, of flights in results, of files and of columns."""
    found = dict(inputs())
    for place in ("v.toml", "model/vehicle.toml"):
        found[place] = with_name(found[place].decode(), name).encode()
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


def outputs(command: str, name: str) -> Mapping[str, bytes]:
    """Return the files that a verb writes under a name."""
    table = "columns.csv" if command == "map" else f"./{file_stem(name)}.csv"
    words = {"sim.nc": f"./{file_stem(name)}.nc", "table.csv": table}
    with TemporaryDirectory(prefix="stoop-") as place, contextlib.chdir(place):
        lay_out(Path(place), named_inputs(name))
        Path(OUT).mkdir()
        ended = run(tuple(words.get(word, word) for word in COMMANDS[command]))
        assert ended.code == 0, ended.stderr_lines[-1:]
        assert all(line.isprintable() for line in ended.stderr_lines), "steers a terminal"
        return written(Path(OUT))


@pytest.mark.parametrize("command", WRITERS)
def test_no_name_becomes_code_of_an_output(command: str) -> None:
    plain = outputs(command, PLAIN)
    for name in SEVERAL:
        assert_same_code(outputs(command, name), plain, name)


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
    "a.parm": ("A 1\n# n", "A 1\nB 1\n# n"),
    "a.csv": ("a,n\r\n1,2", "a,n\r\nb,1,2"),
}


def test_a_name_that_becomes_code_is_seen() -> None:
    for place, texts in SEEN.items():
        plain, hostile = (text.encode() for text in texts)
        other = plain.replace(b"n", b"abc") if place not in ("a.c", "a.lua", "a.py") else plain
        assert code(place, plain) == code(place, other)
        assert code(place, plain) != code(place, hostile)
    code("a.csv", b"a,b\r\n-1.5,+2e3")
    for cell in ("=1+1", "+x", "-x()", "@SUM(1)", "\tx"):
        with pytest.raises(BrokenPromiseError):
            code("a.csv", f"a,b\r\n1,{cell}".encode())
    for text in ("<a href='javascript:x()'>", "<p onclick='x()'>"):
        with pytest.raises(BrokenPromiseError):
            code("a.html", text.encode())
