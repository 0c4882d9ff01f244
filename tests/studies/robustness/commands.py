"""Hostile numbers through complete commands of the command line.

A command ends with code 0 and outputs that are whole and keep their promises, or with code 2 and one line of ours that says
what is wrong; never with a traceback, a warning of a library, or characters that steer a terminal.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import strategies as st
from studies.robustness import hostile_flights as hostile
from studies.robustness.small_runs import OUT, TO
from studies.robustness.trials import READ, Bounds, lay_out, promise
from studies.robustness.verb_outputs import check_outputs, strict_json

from stoop.cli.main import USER_ERROR, main
from stoop.errors import StoopError
from stoop.vehicle_draft.request import TEMPLATES
from stoop.workflow.outputs import ARCHIVES

COMPILING, FITTING = (
    7,
    30,
)  #: s, of equations that no command has had before, and of the longest command on an old server
BOUNDS = Bounds(seconds=FITTING + COMPILING, wall=300.0, memory=2**29)
SHORT = ("short", "twin-boom", "quad-x")  #: flights of a few seconds
METHODS = ("equation-error", "output-error", "multiple-shooting", "frequency-domain", "filter-error")
CHEAP = ("--generations", "2", "--budget", "60")
SPANS = (
    "1:3", "0:0.5", "0:6", "-1:2", "2:0", "nan:nan", "0:inf", "-1e308:1e308", "0:1e-9", "flight@0:2", "0:2#a",
    "1e5:100002", "0:100",
)  # fmt: skip
WORDS = (
    "0", "1", "-1", "1e-9", "1e9", "1e-300", "1e300", "1e308", "1e999", "nan", "-inf", "5e-324", "0.1", "", "a", "1e5", "200",
)  # fmt: skip
CONDITION = ("--airspeed", "--altitude", "--climb-angle")
ERROR = "stoop: error: "
PLACE = re.compile(r'File "[^"]*?([^/"]+\.py)", line (\d+)')


class Command:
    """The words of one command line as they are drawn, and the files that it is given."""

    def __init__(self, choices) -> None:
        self.d, self.tame, self.files = choices, choices.tame, {}

    def flight(self, *names: str, stem: str = "flight", most: int = 4) -> str:
        """Draw a flight of one of some vehicles; return its path."""
        found = hostile.hostile_record(self.d, self.d.one(*names), 0 if self.tame else most)
        files = hostile.as_files(self.d, found, stem)
        self.files.update(files)
        return next(iter(files))

    def text(self, name: str, text: str | bytes) -> str:
        """Add a file; return its path."""
        self.files[name] = text if isinstance(text, bytes) else text.encode()
        return name

    def vehicle(self, name: str, most: int = 3) -> str:
        """Draw a vehicle file; return its path."""
        tame = self.tame or not most
        text = hostile.vehicle(name).text if tame else hostile.hostile_vehicle(self.d, name, most)
        return self.text("vehicle.toml", text)

    def identified(self, name: str, hostile_share: float = 1.0) -> str:
        """Draw an identification with hostile numbers in its result or vehicle; return its folder."""
        files = dict(identified(name))
        if not self.tame and self.d.chance(hostile_share):
            document = json.loads(files["result.json"])
            hostile.hostile_numbers(self.d, document, 4)
            files["result.json"] = json.dumps(document).encode()
            if self.d.chance(0.5):
                files["vehicle.toml"] = hostile.hostile_vehicle(self.d, name, 2)
        self.files.update({f"result/{file}": content for file, content in files.items()})
        return "result"

    def options(self, *names: str, share: float = 0.3, words: tuple[str, ...] = WORDS) -> list[str]:
        """Draw some options with hostile values."""
        return [] if self.tame else [f"{name}={self.d.one(*words)}" for name in names if self.d.chance(share)]

    def one(self, usual: str, words: tuple[str, ...] = WORDS, share: float = 0.5) -> str:
        """Draw the usual word, or a hostile one."""
        return self.d.one(*words) if not self.tame and self.d.chance(share) else usual

    def perhaps(self, *words: str, share: float = 0.5) -> list[str]:
        """Draw some words, or none."""
        return list(words) if self.d.chance(share) else []


@cache
def identified(name: str) -> Mapping[str, bytes]:
    """Return the files of a sound identification by equation error."""
    files = hostile.as_files(hostile.SoundChoices(0), hostile.record(name), "flight")
    files["vehicle.toml"] = hostile.vehicle(name).text.encode()
    words = [
        "identify",
        next(iter(files)),
        "--vehicle",
        "vehicle.toml",
        "--maneuver",
        "0:2",
        "--method",
        METHODS[0],
    ]
    with TemporaryDirectory(prefix="stoop-") as place:
        run_quietly([*words, *CHEAP, *TO], files, Path(place))
        return {file.name: file.read_bytes() for file in Path(place, OUT).iterdir()}


def _maneuvers(c: Command) -> list[str]:
    name = c.d.one("long", "long", "long hover")
    words = ["maneuvers", c.flight(name, most=3), *TO]
    return [*words, "--vehicle", c.vehicle("short", 1)] if name == "long" and c.d.chance(0.3) else words


def _identify(c: Command) -> list[str]:
    name = c.d.one("short", "short", "hover")
    path, vehicle = c.flight(name, most=2), c.vehicle(name, c.d.one(0, 0, 0, 1, 2))
    if c.d.chance(0.02):
        c.text(vehicle, hostile.vehicle("many").text)
    method = c.d.one(*METHODS[:1] * 4, *METHODS)
    words = [
        "identify",
        path,
        "--vehicle",
        vehicle,
        "--maneuver",
        c.one("0:2", SPANS, 0.15),
        "--method",
        method,
        *CHEAP,
        *TO,
    ]
    words += c.options("--validate", share=0.3, words=("2:3.9", "2:3.9", "3:3.9", *SPANS))
    words += c.options("--target-cost", share=0.05)
    if not c.tame and c.d.chance(0.03):
        row = ",".join(c.d.one(*WORDS) for _ in hostile.vehicle(name).outputs)
        words += ["--noise", c.text("noise.csv", row + "\n")]
    return words


def _agreement(c: Command) -> list[str]:
    first, other = c.identified("short"), json.loads(identified("short")["result.json"])
    if not c.tame:
        hostile.hostile_numbers(c.d, other, 2)
    for maneuver in other["maneuvers"]:
        maneuver["flight"] = "other"
    c.text("other/vehicle.toml", hostile.vehicle("short").text)
    c.text("other/result.json", json.dumps(other))
    return ["agreement", first, "other"]


def _polar(c: Command) -> list[str]:
    words = [
        "polar",
        c.flight("glide", most=3),
        "--mass",
        c.one("190", share=0.2),
        "--area",
        c.one("2.9", share=0.2),
    ]
    return [*words, *c.options("--window", share=0.1, words=SPANS), *c.options("--disc", share=0.2), *TO]


def _rotors(c: Command) -> list[str]:
    path = c.flight("long hover", most=2)
    healthy = [c.flight("long hover", stem=f"healthy{i}", most=1) for i in range(c.d.one(1, 2, 3))]
    vehicle = c.vehicle("quad-x", c.d.one(0, 1))
    return ["rotors", path, "--healthy", *healthy, "--vehicle", vehicle, *c.options("--chance", share=0.1)]


def _structure(c: Command) -> list[str]:
    path, vehicle = c.flight("long", "twin-boom", most=2), c.vehicle("twin-boom", c.d.one(0, 1))
    words = ["structure", vehicle, path, "--maneuver", c.one("0:5.9", SPANS, 0.1), *TO]
    words += c.options("--band", share=0.15, words=("0.1:2", "0:1e-9", "0:9999", "nan:1", "1:1"))
    return words + c.perhaps("--candidates", "Cm: alpha, q, elevator, alpha^2, alpha*elevator")


def _vehicle_new(c: Command) -> list[str]:
    words = ["vehicle", "new", *([c.flight(*SHORT)] if c.d.chance(0.7) else [])]
    for option, size in {"--mass": "3", "--span": "2", "--chord": "0.2", "--area": "0.4"}.items():
        words += [option, c.one(size, share=0.2)] if c.tame or c.d.chance(0.8) else []
    words += c.options("--template", share=0.8, words=TEMPLATES) or ["--template", "conventional"]
    return [*words, *c.options("--name", share=0.2, words=hostile.NAMES), "-o", "v.toml"]


def _simulate(c: Command) -> list[str]:
    name = c.d.one(*hostile.MANEUVERS)
    maneuver = c.text("maneuver.toml", hostile.hostile_maneuver(c.d, name, 0 if c.tame else c.d.one(0, 1, 2)))
    ending = c.d.one(".nc", ".nc", ".nc", ".csv", ".ulg", ".bin")
    words = [
        "simulate",
        c.vehicle(name, c.d.one(0, 1, 3)),
        "--maneuver",
        maneuver,
        "-o",
        f"simulated{ending}",
    ]
    return words + c.perhaps("--no-noise", share=0.3)


def _trim(c: Command) -> list[str]:
    words = ["trim", c.vehicle(c.d.one("twin-boom", "short", "quad-x"))]
    words += c.options(*CONDITION, "--density", "--heading", share=0.15)
    if not c.tame and c.d.chance(0.1):
        words += ["--velocity", *(c.d.one(*WORDS) for _ in range(3))]
    return words + c.perhaps("--json")


def _linearize(c: Command) -> list[str]:
    words = ["linearize", c.vehicle(c.d.one("twin-boom", "short", "quad-x"))]
    return [*words, *c.options(*CONDITION, "--density", share=0.15), *c.perhaps("--json", "linear.json")]


def _derivatives(c: Command) -> list[str]:
    words = [
        "derivatives",
        c.vehicle(c.d.one("twin-boom", "twin-boom", "short"), 2),
        *c.options(*CONDITION, share=0.15),
    ]
    words += ["--axes", c.d.one("body", "stability"), *c.perhaps("--dimensional")]
    return [*words, "-o", c.d.one("written.csv", "written.json")]


def _frequency(c: Command) -> list[str]:
    words = ["frequency", c.flight("long", "long hover", *SHORT, most=3)]
    words += c.options("--maneuver", share=0.15, words=SPANS)
    words += c.options("--band", share=0.2, words=("1:20", "0:1e-9", "5:1", "nan:1", "1:9999"))
    words += c.options("--input", "--channel", share=0.1, words=("elevator", "q", "V", "", "a"))
    if c.d.chance(0.4):
        words += ["--vehicle", c.identified("short") if c.d.chance(0.5) else c.vehicle("short")]
    return [*words, "-o", "written.html"]


def _propagate(c: Command) -> list[str]:
    words = ["propagate", c.identified(c.d.one("short", "hover")), "--draws", c.one("100", share=0.15)]
    words += c.options("--airspeed", share=0.2, words=("18:30", "0:1e-9", "5:1", "nan:1", "1:9999"))
    words += c.options("--altitude", "--seed", share=0.1)
    sums = ("a=CLalpha/CD0", "a=1/0", "a=CLalpha**1e9", "=", "a=(", "a=b")
    return [*words, *c.options("--expression", share=0.3, words=sums), "-o", "written.html"]


def _export(c: Command) -> list[str]:
    model = c.identified("short") if c.d.chance(0.4) else c.vehicle(c.d.one("short", "twin-boom", "quad-x"))
    quick, slow = ("state-space", "simulink"), ("jsbsim", "px4-jsbsim", "ardupilot-jsbsim", "gazebo", "fmu")
    return ["export", model, "--to", c.d.one(*quick * 4, *slow), *c.options(*CONDITION, share=0.15), *TO]


def _design(c: Command) -> list[str]:
    vehicle = c.identified("short") if c.d.chance(0.3) else c.vehicle("short")
    shape = c.d.one("doublet", "3-2-1-1", "square", "multisine")
    words = ["design", vehicle, "--evaluations", c.d.one("1", "2", "8"), "--shape", shape, *TO]
    words += ["--duration", c.one("3", share=0.2)]
    words += c.options("--airspeed", "--altitude", "--slew", "--band", "--beat", share=0.1)
    limits = ("alpha=-5:5", "alpha=0:0", "V=1e308:2", "q=nan:1", "alpha=-1e308:1e308")
    for option, share, values in (
        ("--amplitude", 0.2, ("3", "elevator=1", "elevator=1e-9", *WORDS)), ("--within", 0.2, limits),
        ("--for", 0.3, ("pilot", "ardupilot", "px4", "crazyflie")), ("--shape", 0.2, ("2-1-1", "sweep")),
        ("--throw", 0.3, ("elevator=20", "elevator=1e-9", "elevator=-3", *WORDS)),
        ("--min-amplitude", 0.2, ("1", "elevator=0", "elevator=1e-300", *WORDS)),
    ):  # fmt: skip
        words += c.options(option, share=share, words=values)
    return words


@dataclass(frozen=True)
class Verb:
    """How command lines of a verb are drawn, how many in a plain run, and the files that must be written (patterns)."""

    draw: Callable[[Command], list[str]]
    count: int = 2
    written: tuple[str, ...] = ()


VERBS = {
    "info": Verb(lambda c: ["info", c.flight(*SHORT), *c.perhaps("--json")], 8),
    "look": Verb(lambda c: ["look", c.flight(*SHORT)], 8, ("look.html",)),
    "map": Verb(lambda c: ["map", c.flight(*SHORT), "-o", "m.toml"], 2, ("m.toml",)),
    "maneuvers": Verb(_maneuvers, 3, ("out/windows.toml", "out/windows.html")),
    "compatibility": Verb(  # of a short flight: all twelve pieces of a longer one take 8 s
        lambda c: ["compatibility", c.flight(*SHORT, most=3), *c.options("--window", share=0.15, words=SPANS), *TO],
        2, ("out/compatibility.html", "out/compatibility.json", "out/flight.nc"),
    ),
    "identify": Verb(
        _identify,
        6,
        tuple(f"out/{name}" for name in ("result.json", "report.html", "vehicle.toml", "flight.nc", *ARCHIVES)),
    ),
    "validate": Verb(
        lambda c: [
            "validate", c.identified("short", 0.5), c.flight("short", most=3), "--maneuver", c.one("2:4", SPANS, 0.15), *TO
        ],
        2, ("out/validation.html", "out/validation.json"),
    ),
    "agreement": Verb(_agreement),
    "polar": Verb(_polar, 2, ("out/polar.html", "out/polar.json")),
    "rotors": Verb(_rotors),
    "structure": Verb(_structure, 2, ("out/structure.html", "out/structure.csv", "out/vehicle.toml")),
    "vehicle new": Verb(_vehicle_new, 3, ("v.toml",)),
    "simulate": Verb(_simulate, 3, ("simulated.*",)),
    "trim": Verb(_trim),
    "linearize": Verb(_linearize),
    "derivatives": Verb(_derivatives, 2, ("written.*",)),
    "frequency": Verb(_frequency, 2, ("written.html",)),
    "propagate": Verb(_propagate, 2, ("written.html",)),
    "export": Verb(_export, 2, ("out/*",)),
    "design": Verb(_design, 2, ("out/design.html", "out/design.json", "out/maneuver*.toml")),
}  # fmt: skip  #: verb -> its hostile command lines


@st.composite
def commands(draw, verb: str) -> tuple[list[str], dict[str, bytes]]:
    """Draw a hostile command of a verb: its words and files."""
    command = Command(hostile.Choices(draw))
    return VERBS[verb].draw(command), command.files


def sound_command(verb: str, seed: int | str) -> tuple[list[str], dict[str, bytes]]:
    """Return a command of a verb of which nothing is hostile."""
    command = Command(hostile.SoundChoices(seed))
    return VERBS[verb].draw(command), command.files


def run_quietly(words: list[str], files: Mapping[str, bytes], folder: Path) -> tuple[int, str, str]:
    """Run a command line in a folder of files, in this process; return its code and what it printed on both streams."""
    lay_out(folder, files)
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = main(words)
    return code, out.getvalue(), errors.getvalue()


def try_command(
    folder: Path, words: list[str], files: Mapping[str, bytes], written: tuple[str, ...] = ()
) -> str:
    """Run a command and look at what it promises; an error of ours is raised as one."""
    code, out, errors = run_quietly(words, files, folder)
    complaints = [line for line in errors.splitlines() if line.startswith(ERROR)]
    odd = next((c for c in out + errors if not (c.isprintable() or c in "\n\t")), "")
    promise(not odd, f"prints {odd!r}")
    if "Traceback" in errors:
        place = (PLACE.findall(errors) or [("", "")])[-1]
        lines = errors.rstrip().splitlines()[:-1]  # the last says that this is a bug
        error = next((line for line in reversed(lines) if line), "")
        promise(False, f"{error[:160]} at {':'.join(place)}")
    if code == USER_ERROR and len(complaints) == 1:
        raise StoopError(complaints[0].removeprefix(ERROR))
    promise(not code and not complaints, f"ends with {code}, and prints {errors[-200:]!r}")
    if words[-1] == "--json":
        strict_json(out, "what was printed")
    check_outputs(written, folder)
    return READ


@cache
def prepare(verb: str, sound: int) -> None:
    """Make what is sound, and compile equations by some sound commands, once before this process is copied."""
    for name in hostile.MANEUVERS:
        hostile.record(name)
    for name in ("short", "hover"):
        identified(name)
    for seed in range(sound):
        with TemporaryDirectory(prefix="stoop-") as place:
            run_quietly(*sound_command(verb, f"tame {verb} {seed}"), Path(place))
