"""`stoop info`: what is in a log, in words and in JSON."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
from helpers.command_line import Done

from stoop.cli.info import unmapped_lines
from stoop.cli.main import parser_for
from stoop.flight import FlownManeuver, from_columns, save_flight
from stoop.flight.maneuvers import apart


def test_describes_a_simulated_flight(flight_file: Path, done: Done) -> None:
    out = done(["info", flight_file, "--verbose"])
    assert out.splitlines()[0] == str(flight_file)
    assert "0.00 to 30.00 s on the log's own clock (30.00 s), 100 Hz grid" in out
    assert re.search(r"^simulation +100\.0 +0 +0\.010 +V alpha beta p q r", out, re.MULTILINE)
    assert re.search(r"^elevator +rad +-0\.2294 +-0\.0294 +0\.1706 +elevator deflection$", out, re.MULTILINE)
    assert "none found" in out
    line = next(line for line in out.splitlines() if line.startswith("next: "))
    words = shlex.split(line)[2:]
    start, stop = map(float, parser_for(words).parse_args(words).maneuver[0].split(":"))
    assert start < 1.0 < 3.1 < stop  # the 3-2-1-1
    found = json.loads(done(["info", flight_file, "--json"]))
    assert found["format"] == "stoop-info/1"
    assert (found["start"], found["stop"], found["rate"]) == (0.0, 30.0, 100.0)
    (row,) = [row for row in found["channels"] if row["variable"] == "V"]
    assert (row["unit"], row["missing"]) == ("m/s", 0.0)
    assert found["maneuvers"][0]["axis"] == "pitch"
    assert (found["faults"], found["control_laws"]) == ([], [])


def test_channels_without_a_value_and_what_shows_nothing_are_told(tmp_path: Path, done: Done) -> None:
    t, nothing = np.arange(500) / 100.0, np.full(500, np.nan)
    still = {f"motor_{n}": np.zeros(500) for n in range(1, 5)}
    save_flight(from_columns("half", t, {"phi": np.sin(t), "vn": nothing} | still), tmp_path / "half.nc")
    out = done(["info", tmp_path / "half.nc"])
    assert "Without any value: vn\n" in out
    assert not re.search(r"^vn ", out, re.MULTILINE)
    said = " ".join(out.split())
    assert "p, q and r not recorded: moments" in said
    assert "the motors never ran" in said
    save_flight(from_columns("none", t, {"vn": nothing}), tmp_path / "none.nc")
    assert "Channels" not in done(["info", tmp_path / "none.nc", "--verbose"])


def test_csv_with_a_mapping(tmp_path: Path, done: Done) -> None:
    log, mapping = tmp_path / "log.csv", tmp_path / "columns.toml"
    mapping.write_text('[time]\ncolumn = "t"\nunit = "s"\n[variables]\nq = {column = "p", unit = "rad/s"}\n')
    log.write_text("\n".join(["t,p", *(f"{1.7e9 + 0.01 * i:.2f},{np.sin(0.1 * i)}" for i in range(500))]))
    out = done(["info", log, "--mapping", mapping])
    assert "1700000000.00 to 1700000004.9" in out
    assert re.search(r"^log\.csv +100\.0 +0 +0\.010 +q$", out, re.MULTILINE)


def test_elements_of_an_array_are_one_name() -> None:
    names = ["id", *(f"data[{i}]" for i in (*range(2, 8), 9, *range(11, 58))), "name[0]", "a[b]", "[1]"]
    told = unmapped_lines({"debug_array": names, "safety": []})
    assert told == ["debug_array: id data[2..7] data[9] data[11..57] name[0] a[b] [1]", "not read: safety"]
    names = ["a[1]", f"a[{'9' * 4301}]", "a[\u0663]"]
    assert unmapped_lines({"log": names}) == [f"log: {' '.join(names)}"]


def test_maneuvers_do_not_overlap() -> None:
    """The calm ends of two are taken once: the weaker is cut, but not into its input, 0.5 s after and 1 s before its ends."""
    found = [
        FlownManeuver("roll", "aileron", 10.0, 15.0, 0.3, 4, 10.0, 1.0),
        FlownManeuver("pitch", "elevator", 14.4, 20.0, 0.3, 4, 20.0, 1.0),
        FlownManeuver("pitch", "elevator", 18.7, 25.0, 0.3, 4, 10.0, 0.8),
        FlownManeuver("yaw", "rudder", 25.0, 30.0, 0.3, 4, 20.0, 0.9),
    ]
    assert [m.window for m in apart(found)] == ["10:14.4", "14.4:19.2", "19.2:25", "25:30"]
