"""Hostile numbers through complete commands of the command line.

A command ends with code 0 and outputs that are whole and keep their promises, or with code 2 and one line of ours that says
what is wrong; never with a traceback, a warning of a library, or characters that steer a terminal.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final

from stoop.cli.main import USER_ERROR, main
from stoop.errors import StoopError
from stoop_studies.robustness import hostile_numbers as hostile
from stoop_studies.robustness.small_runs import OUT, TO
from stoop_studies.robustness.trials import (
    READ,
    Bounds,
    BrokenPromiseError,
    Case,
    Cases,
    Tried,
    lay_out,
    try_all,
)
from stoop_studies.robustness.verb_outputs import check_outputs, strict_json

COMPILING: Final = 7  #: s, of equations that no command has had before
FITTING: Final = 30  #: s, of the longest: two quick fits by filter error take 17 s of an old server
BOUNDS: Final = Bounds(seconds=FITTING + COMPILING, wall=300.0, memory=2**29)
SHORT: Final = ("short", "twin-boom", "quad-x")  #: flights of a few seconds
TAME: Final = 8  #: sound commands of a verb, at most, which load what it needs before this process is copied
METHODS: Final = (
    "equation-error",
    "output-error",
    "multiple-shooting",
    "frequency-domain",
    "filter-error",
)
CHEAP: Final = ("--generations", "2", "--budget", "60")
SPANS: Final = (
    "1:3", "0:0.5", "0:6", "-1:2", "2:0", "nan:nan", "0:inf", "-1e308:1e308", "0:1e-9", "flight@0:2", "0:2#a",
    "1e5:100002", "0:100",
)  # fmt: skip
WORDS: Final = (
    "0", "1", "-1", "1e-9", "1e9", "1e-300", "1e300", "1e308", "1e999", "nan", "-inf", "5e-324", "0.1", "", "a", "1e5", "200",
)  # fmt: skip
ERROR: Final = "stoop: error: "
PLACE: Final = re.compile(r'File "[^"]*?([^/"]+\.py)", line (\d+)')


@dataclass(frozen=True)
class Choices:
    """Random choices of one command, and the hostile files that it is given; ``tame``: nothing is hostile."""

    rng: Random
    files: dict[str, bytes]  #: path below the folder of the case -> content
    tame: bool = False

    def flight(self, *names: str, stem: str = "flight", most: int = 4) -> tuple[str, str]:
        """Draw a flight of one of some vehicles; return its first edit, and its path."""
        edit, found = hostile.hostile_record(self.rng, self.rng.choice(names), 0 if self.tame else most)
        files = hostile.as_files(self.rng, found, stem, 0.0 if self.tame else 0.01)
        self.files.update(files)
        return edit, next(iter(files))

    def text(self, name: str, text: str) -> str:
        """Add a file; return its path."""
        self.files[name] = text.encode()
        return name

    def vehicle(self, name: str, most: int = 3) -> tuple[str, str]:
        """Draw a vehicle file; return its first edit, and its path."""
        if self.tame or not most:
            return "sound", self.text("vehicle.toml", hostile.vehicle(name).text)
        edit, text = hostile.hostile_vehicle(self.rng, name, most)
        return edit, self.text("vehicle.toml", text)

    def identified(self, name: str, hostile_share: float = 1.0) -> tuple[str, str]:
        """Draw an identification with hostile numbers in its result or vehicle; return its first edit, and its folder."""
        edit, files = "sound", dict(identified(name))
        if not self.tame and self.rng.random() < hostile_share:
            document = json.loads(files["result.json"])
            edit = hostile.hostile_numbers(self.rng, document, 4)
            files["result.json"] = json.dumps(document).encode()
            if self.rng.random() < 0.5:
                own, text = hostile.hostile_vehicle(self.rng, name, 2)
                edit, files["vehicle.toml"] = own if edit == "sound" else edit, text.encode()
        self.files.update({f"result/{file}": content for file, content in files.items()})
        return edit, "result"

    def options(self, *names: str, share: float = 0.3, words: tuple[str, ...] = WORDS) -> list[str]:
        """Draw some options with hostile values."""
        drawn = [f"{name}={self.rng.choice(words)}" for name in names if self.rng.random() < share]
        return [] if self.tame else drawn

    def one(self, usual: str, words: tuple[str, ...] = WORDS, share: float = 0.5) -> str:
        """Draw the usual word, or a hostile one."""
        return self.rng.choice(words) if not self.tame and self.rng.random() < share else usual


Command = tuple[str, list[str]]  #: first edit, and the words of a command line


@cache
def identified(name: str) -> Mapping[str, bytes]:
    """Return the files of a sound identification by equation error."""
    files = hostile.as_files(Random(0), hostile.record(name), "flight", 0.0)  # noqa: S311  no secret
    files["vehicle.toml"] = hostile.vehicle(name).text.encode()
    words = [
        "identify",
        next(iter(files)),
        "--vehicle",
        "vehicle.toml",
        "--maneuver",
        "0:2",
        "--method",
        "equation-error",
    ]
    with TemporaryDirectory(prefix="stoop-") as place:
        run_quietly([*words, *CHEAP, *TO], files, Path(place))
        return {file.name: file.read_bytes() for file in Path(place, OUT).iterdir()}


def _info(draw: Choices) -> Command:
    edit, path = draw.flight(*SHORT)
    return edit, ["info", path, *(["--json"] if draw.rng.random() < 0.5 else [])]


def _map(draw: Choices) -> Command:
    edit, path = draw.flight(*SHORT)
    return edit, ["map", path, "-o", "m.toml"]


def _maneuvers(draw: Choices) -> Command:
    name = draw.rng.choice(("long", "long", "long hover"))
    edit, path = draw.flight(name, most=3)
    words = ["maneuvers", path, *TO]
    if draw.rng.random() < 0.3 and name == "long":
        own, vehicle = draw.vehicle("short", 1)
        return (own if edit == "sound" else edit), [*words, "--vehicle", vehicle]
    return edit, words


def _compatibility(draw: Choices) -> Command:
    edit, path = draw.flight(*SHORT, most=3)  # all twelve pieces of a longer one take 8 s
    return edit, ["compatibility", path, *draw.options("--window", share=0.15, words=SPANS), *TO]


def _identify(draw: Choices) -> Command:
    name = draw.rng.choice(("short", "short", "hover"))
    edit, path = draw.flight(name, most=2)
    own, vehicle = draw.vehicle(name, draw.rng.choice((0, 0, 0, 1, 2)))
    if draw.rng.random() < 0.02:
        vehicle = draw.text("vehicle.toml", hostile.vehicle("many").text)
    method = draw.rng.choice(METHODS[:1] * 4 + METHODS)
    words = [
        "identify",
        path,
        "--vehicle",
        vehicle,
        "--maneuver",
        draw.one("0:2", SPANS, 0.15),
        "--method",
        method,
        *CHEAP,
        *TO,
    ]
    words += draw.options("--validate", share=0.3, words=("2:3.9", "2:3.9", "3:3.9", *SPANS))
    words += draw.options("--target-cost", share=0.05)
    if draw.rng.random() < 0.03 and not draw.tame:
        row = ",".join(draw.rng.choice(WORDS) for _ in hostile.vehicle(name).outputs)
        words += ["--noise", draw.text("noise.csv", row + "\n")]
    return (own if edit == "sound" else edit), words


def _validate(draw: Choices) -> Command:
    edit, path = draw.flight("short", most=3)
    own, result = draw.identified("short", 0.5)
    words = ["validate", result, path, "--maneuver", draw.one("2:4", SPANS, 0.15), *TO]
    return (own if edit == "sound" else edit), words


def _agreement(draw: Choices) -> Command:
    edit, first = draw.identified("short")
    other = json.loads(identified("short")["result.json"])
    if not draw.tame:
        hostile.hostile_numbers(draw.rng, other, 2)
    for maneuver in other["maneuvers"]:
        maneuver["flight"] = "other"
    draw.text("other/vehicle.toml", hostile.vehicle("short").text)
    draw.text("other/result.json", json.dumps(other))
    return edit, ["agreement", first, "other"]


def _polar(draw: Choices) -> Command:
    edit, path = draw.flight("glide", most=3)
    words = ["polar", path, "--mass", draw.one("190", share=0.2), "--area", draw.one("2.9", share=0.2)]
    words += draw.options("--window", share=0.1, words=SPANS) + draw.options("--disc", share=0.2)
    return edit, [*words, *TO]


def _rotors(draw: Choices) -> Command:
    edit, path = draw.flight("long hover", most=2)
    healthy = [
        draw.flight("long hover", stem=f"healthy{i}", most=1)[1] for i in range(draw.rng.choice((1, 2, 3)))
    ]
    own, vehicle = draw.vehicle("quad-x", draw.rng.choice((0, 1)))
    words = [
        "rotors",
        path,
        "--healthy",
        *healthy,
        "--vehicle",
        vehicle,
        *draw.options("--chance", share=0.1),
    ]
    return (own if edit == "sound" else edit), words


def _structure(draw: Choices) -> Command:
    edit, path = draw.flight("long", "twin-boom", most=2)
    own, vehicle = draw.vehicle("twin-boom", draw.rng.choice((0, 1)))
    words = ["structure", vehicle, path, "--maneuver", draw.one("0:5.9", SPANS, 0.1), *TO]
    words += draw.options("--band", share=0.15, words=("0.1:2", "0:1e-9", "0:9999", "nan:1", "1:1"))
    words += (
        ["--candidates", "Cm: alpha, q, elevator, alpha^2, alpha*elevator"] if draw.rng.random() < 0.5 else []
    )
    return (own if edit == "sound" else edit), words


def _vehicle_new(draw: Choices) -> Command:
    from stoop.vehicle_draft.request import TEMPLATES

    edit, words = "sound", ["vehicle", "new"]
    if draw.rng.random() < 0.7:
        edit, path = draw.flight(*SHORT)
        words.append(path)
    usual = {"--mass": "3", "--span": "2", "--chord": "0.2", "--area": "0.4"}
    for option, size in usual.items():
        words += [option, draw.one(size, share=0.2)] if draw.tame or draw.rng.random() < 0.8 else []
    words += draw.options("--template", share=0.8, words=TEMPLATES) or ["--template", "conventional"]
    words += draw.options("--name", share=0.2, words=hostile.NAMES)
    return edit, [*words, "-o", "v.toml"]


def _simulate(draw: Choices) -> Command:
    name = draw.rng.choice(tuple(hostile.MANEUVERS))
    edit, text = hostile.hostile_maneuver(draw.rng, name, 0 if draw.tame else draw.rng.choice((0, 1, 2)))
    own, vehicle = draw.vehicle(name, draw.rng.choice((0, 1, 3)))
    ending = draw.rng.choice((".nc", ".nc", ".nc", ".csv", ".ulg", ".bin"))
    words = ["simulate", vehicle, "--maneuver", draw.text("maneuver.toml", text), "-o", f"simulated{ending}"]
    words += ["--no-noise"] if draw.rng.random() < 0.3 else []
    return (own if edit == "sound" else edit), words


CONDITION: Final = ("--airspeed", "--altitude", "--climb-angle")


def _trim(draw: Choices) -> Command:
    edit, vehicle = draw.vehicle(draw.rng.choice(("twin-boom", "short", "quad-x")))
    words = ["trim", vehicle, *draw.options(*CONDITION, "--density", "--heading", share=0.15)]
    if not draw.tame and draw.rng.random() < 0.1:
        words += ["--velocity", *draw.rng.choices(WORDS, k=3)]
    return edit, [*words, *(["--json"] if draw.rng.random() < 0.5 else [])]


def _linearize(draw: Choices) -> Command:
    edit, vehicle = draw.vehicle(draw.rng.choice(("twin-boom", "short", "quad-x")))
    words = ["linearize", vehicle, *draw.options(*CONDITION, "--density", share=0.15)]
    return edit, [*words, *(["--json", "linear.json"] if draw.rng.random() < 0.5 else [])]


def _derivatives(draw: Choices) -> Command:
    edit, model = draw.vehicle(draw.rng.choice(("twin-boom", "twin-boom", "short")), 2)
    words = ["derivatives", model, *draw.options(*CONDITION, share=0.15)]
    words += ["--axes", draw.rng.choice(("body", "stability"))]
    words += ["--dimensional"] if draw.rng.random() < 0.5 else []
    return edit, [*words, "-o", draw.rng.choice(("written.csv", "written.json"))]


def _frequency(draw: Choices) -> Command:
    edit, path = draw.flight("long", "long hover", *SHORT, most=3)
    words = ["frequency", path, *draw.options("--maneuver", share=0.15, words=SPANS)]
    words += draw.options("--band", share=0.2, words=("1:20", "0:1e-9", "5:1", "nan:1", "1:9999"))
    words += draw.options("--input", "--channel", share=0.1, words=("elevator", "q", "V", "", "a"))
    if draw.rng.random() < 0.4:
        own, model = draw.identified("short") if draw.rng.random() < 0.5 else draw.vehicle("short")
        edit, words = own if edit == "sound" else edit, [*words, "--vehicle", model]
    return edit, [*words, "-o", "written.html"]


def _propagate(draw: Choices) -> Command:
    edit, result = draw.identified(draw.rng.choice(("short", "hover")))
    words = ["propagate", result, "--draws", draw.one("100", share=0.15)]
    words += draw.options("--airspeed", share=0.2, words=("18:30", "0:1e-9", "5:1", "nan:1", "1:9999"))
    words += draw.options("--altitude", "--seed", share=0.1)
    words += draw.options(
        "--expression", share=0.3, words=("a=CLalpha/CD0", "a=1/0", "a=CLalpha**1e9", "=", "a=(", "a=b")
    )
    return edit, [*words, "-o", "written.html"]


def _export(draw: Choices) -> Command:
    name = draw.rng.choice(("short", "twin-boom", "quad-x"))
    edit, model = draw.identified("short") if draw.rng.random() < 0.4 else draw.vehicle(name)
    quick, slow = ("state-space", "simulink"), ("jsbsim", "px4-jsbsim", "ardupilot-jsbsim", "gazebo", "fmu")
    tool = draw.rng.choice(quick * 4 + slow)
    return edit, ["export", model, "--to", tool, *draw.options(*CONDITION, share=0.15), *TO]


def _design(draw: Choices) -> Command:
    edit, vehicle = draw.identified("short") if draw.rng.random() < 0.3 else draw.vehicle("short")
    shape = draw.rng.choice(("doublet", "3-2-1-1", "square", "multisine"))
    words = ["design", vehicle, "--evaluations", draw.rng.choice(("1", "2", "8")), "--shape", shape, *TO]
    words += ["--duration", draw.one("3", share=0.2)]
    words += draw.options("--airspeed", "--altitude", "--slew", "--band", share=0.1)
    words += draw.options("--amplitude", share=0.2, words=("3", "elevator=1", "elevator=1e-9", *WORDS))
    words += draw.options(
        "--within", share=0.2, words=("alpha=-5:5", "alpha=0:0", "V=1e308:2", "q=nan:1", "alpha=-1e308:1e308")
    )
    words += draw.options("--for", share=0.3, words=("pilot", "ardupilot", "px4", "crazyflie"))
    words += draw.options("--throw", share=0.3, words=("elevator=20", "elevator=1e-9", "elevator=-3", *WORDS))
    words += draw.options("--min-amplitude", share=0.2, words=("1", "elevator=0", "elevator=1e-300", *WORDS))
    words += draw.options("--shape", share=0.2, words=("2-1-1", "sweep"))
    words += draw.options("--beat", share=0.1)
    return edit, words


@dataclass(frozen=True)
class Verb:
    """How command lines of a verb are drawn, how many in one slice of the campaign, and what must stand in the output."""

    draw: Callable[[Choices], Command]
    count: int
    written: tuple[str, ...] = ()  #: files; those with a * are patterns


VERBS: Final[Mapping[str, Verb]] = {
    "info": Verb(_info, 40),
    "map": Verb(_map, 10, ("m.toml",)),
    "maneuvers": Verb(_maneuvers, 15, ("out/windows.toml", "out/windows.html")),
    "compatibility": Verb(
        _compatibility, 10, ("out/compatibility.html", "out/compatibility.json", "out/flight.nc")
    ),
    "identify": Verb(
        _identify, 30, ("out/result.json", "out/report.html", "out/vehicle.toml", "out/flight.nc")
    ),
    "validate": Verb(_validate, 8, ("out/validation.html", "out/validation.json")),
    "agreement": Verb(_agreement, 8),
    "polar": Verb(_polar, 10, ("out/polar.html", "out/polar.json")),
    "rotors": Verb(_rotors, 8),
    "structure": Verb(_structure, 8, ("out/structure.html", "out/structure.csv", "out/vehicle.toml")),
    "vehicle new": Verb(_vehicle_new, 15, ("v.toml",)),
    "simulate": Verb(_simulate, 15, ("simulated.*",)),
    "trim": Verb(_trim, 10),
    "linearize": Verb(_linearize, 8),
    "derivatives": Verb(_derivatives, 8, ("written.*",)),
    "frequency": Verb(_frequency, 8, ("written.html",)),
    "propagate": Verb(_propagate, 8, ("written.html",)),
    "export": Verb(_export, 10, ("out/*",)),
    "design": Verb(_design, 8, ("out/design.html", "out/design.json", "out/maneuver.toml")),
}  #: verb -> its hostile command lines


def run_quietly(words: list[str], files: Mapping[str, bytes], folder: Path) -> tuple[int, str, str]:
    """Run a command line in a folder of files, in this process; return its code and what it printed on both streams."""
    lay_out(folder, files)
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = main(words)
    return code, out.getvalue(), errors.getvalue()


def verb_cases(name: str, seed: int) -> Cases:
    """Return the hostile commands of a verb."""

    def case(number: int) -> Case:
        files: dict[str, bytes] = {}
        edit, words = VERBS[name].draw(Choices(Random(f"{name} {seed} {number}"), files))  # noqa: S311  no secret
        return Case(number, name, edit, lambda folder: try_command(VERBS[name], words, files, folder))

    return case


def try_command(verb: Verb, words: list[str], files: Mapping[str, bytes], folder: Path) -> str:
    """Run a command and look at what it promises; an error of ours is raised as one."""
    code, out, errors = run_quietly(words, files, folder)
    complaints = [line for line in errors.splitlines() if line.startswith(ERROR)]
    odd = next((c for c in out + errors if not (c.isprintable() or c in "\n\t")), "")
    if odd:
        raise BrokenPromiseError(f"prints {odd!r}")
    if "Traceback" in errors:
        place = (PLACE.findall(errors) or [("", "")])[-1]
        lines = errors.rstrip().splitlines()[:-1]  # the last says that this is a bug
        error = next((line for line in reversed(lines) if line), "")
        raise BrokenPromiseError(f"{error[:160]} at {':'.join(place)}")
    if code == USER_ERROR and len(complaints) == 1:
        raise StoopError(complaints[0].removeprefix(ERROR))
    if code or complaints:
        raise BrokenPromiseError(f"ends with {code}, and prints {errors[-200:]!r}")
    if words[-1] == "--json":
        strict_json(out, "what was printed")
    check_outputs(verb.written, folder)
    return READ


@cache
def prepare(name: str, tame: int) -> None:
    """Make what is sound, and compile equations by some sound commands, once before this process is copied."""
    for vehicle in hostile.MANEUVERS:
        hostile.record(vehicle)
    identified("short")
    for number in range(tame):
        files: dict[str, bytes] = {}
        _, words = VERBS[name].draw(Choices(Random(f"tame {name} {number}"), files, tame=True))  # noqa: S311  no secret
        with TemporaryDirectory(prefix="stoop-") as place:
            run_quietly(words, files, Path(place))


def try_verbs(name: str, seed: int, count: int) -> Iterator[Tried]:
    """Try the first hostile commands of a verb."""
    prepare(name, min(TAME, count))
    return try_all(verb_cases(name, seed), range(count), BOUNDS)
