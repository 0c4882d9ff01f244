"""From log to model in five steps: the pages' own commands, on logs that they make, print what the pages show."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.pages import DOCS, ROOT
from stoop.cli.main import main
from stoop.flight import load
from stoop.flight.mapping import read_flight_mapping

LOG_PAGES = ("px4", "px4-fixed-wing", "ardupilot", "crazyflie", "betaflight", "other-logs")
NAMED = re.compile(r"# (\S+\.(?:toml|parm|config))\n")
ROUNDING = 0.03  #: other processors round otherwise
STEPS = ("0. A log", "1. Look", "2. Write down", "3. Choose", "4. Identify", "5. Judge")


def fences(page: Path) -> Iterator[tuple[str, str]]:
    """Yield language and content of each fenced block, in order."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"^```(\w+)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        yield found[1], found[2]


@pytest.mark.parametrize("name", LOG_PAGES)
def test_the_page_does_what_it_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    printed = ""
    for language, block in fences(DOCS / f"{name}.md"):
        if language in ("toml", "ini") and (file := NAMED.match(block)):
            Path(file[1]).write_text(block, encoding="utf-8")
        elif language == "console":
            for line in block.replace("\\\n", " ").splitlines():
                assert main(shlex.split(line.removeprefix("$ "))[1:]) == 0, line
            printed = capsys.readouterr().out
        elif language == "text" and printed:
            unlike = missing(block, printed)
            assert not unlike, f"{name}: not printed: {unlike}\n{printed}"
            printed = ""
    if name != "other-logs":
        log = next(file for file in tmp_path.glob("flight.*") if file.suffix != ".toml")
        assert {"motor_1", "elevator"} & set(map(str, load(log).data))


def missing(block: str, printed: str) -> list[str]:
    """Return the lines of a block that were not printed, in this order, but for the rounding of numbers."""
    lines = iter(printed.splitlines())
    return [
        shown
        for shown in block.splitlines()
        if shown.strip() not in ("", "...") and not any(alike(shown, line) for line in lines)
    ]


def alike(shown: str, line: str) -> bool:
    a, b = shown.split(), line.split()
    return len(a) == len(b) and all(map(same, a, b))


def same(shown: str, word: str) -> bool:
    try:
        a, b = float(shown), float(word)
    except ValueError:
        return shown == word
    return a == pytest.approx(b, rel=ROUNDING, abs=1e-12) or abs(a - b) < 0.011


@pytest.mark.parametrize("name", LOG_PAGES)
def test_five_steps(name: str) -> None:
    headings = re.findall(r"^## (.*)$", (DOCS / f"{name}.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert all(h.startswith(step) for h, step in zip(headings, STEPS, strict=False))


@pytest.mark.parametrize("name", LOG_PAGES)
def test_mappings_of_the_pages(name: str, tmp_path: Path) -> None:
    for _, block in (f for f in fences(DOCS / f"{name}.md") if f[0] == "toml"):
        if "duration" not in block and "[mass]" not in block:
            (tmp_path / "m.toml").write_text(block, encoding="utf-8")
            assert read_flight_mapping(tmp_path / "m.toml").groups


def test_mappings_beside_the_practice_flights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What ardupilot.md shows is what is written."""
    monkeypatch.chdir(tmp_path)
    plane, hop, *_ = (b for kind, b in fences(DOCS / "ardupilot.md") if kind == "toml" and NAMED.match(b))
    shown = [b for kind, b in fences(DOCS / "ardupilot.md") if b.startswith("extends")]
    for vehicle, maneuver, mapping in zip(("twin-boom", "quad-x"), (plane, hop), shown, strict=True):
        Path("m.toml").write_text(maneuver, encoding="utf-8")
        assert main(["simulate", vehicle, "--maneuver", "m.toml", "-o", f"{vehicle}.bin"]) == 0
        assert Path(f"{vehicle}.bin.toml").read_text(encoding="utf-8") == mapping


def test_a_turn_tells_wind_from_pitot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What px4-fixed-wing.md says of the flight without its turn."""
    monkeypatch.chdir(tmp_path)
    page = DOCS / "px4-fixed-wing.md"
    practice, mapping = (b for kind, b in fences(page) if kind == "toml")
    straight = practice.partition("[[input]] # into a turn")[0].replace("110.0", "80.0")
    Path("straight.toml").write_text(straight, encoding="utf-8")
    vehicle = str(ROOT / "examples" / "vtail.toml")
    assert main(["simulate", vehicle, "--maneuver", "straight.toml", "-o", "flight.ulg"]) == 0
    Path("flight.ulg.toml").write_text(mapping, encoding="utf-8")
    air = load(Path("flight.ulg")).air
    said = re.search(
        r"gives\s+([\d.]+) ± ([\d.]+) and (-[\d.]+) ± ([\d.]+) m/s and a pitot error of ([\d.]+) ± ([\d.]+)",
        page.read_text(encoding="utf-8"),
    )
    assert air is not None
    assert said is not None
    north, _, east, _, pitot, _ = map(float, said.groups())
    assert (air.wind_n, air.wind_e) == pytest.approx((north, east), abs=0.06)
    assert air.pitot_offset == pytest.approx(pitot, abs=0.06)
