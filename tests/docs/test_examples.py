"""The Python and the commands of the pages run, and print what the pages show but for rounding."""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import stoop
from docs.pages import DOCS, LOG_PAGES, ROOT, blocks, commands, fences, run_python, table
from stoop.cli.main import main, one_verb
from stoop.flight import load_flight, save_flight
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import load_vehicle

NAMED = re.compile(r"# (\S+\.(?:toml|parm|config))\n")
NUMBER = re.compile(r"[-+]?\d+\.\d+")
#: page -> a pattern in what its first Python block prints
PRINTED = {
    "derivatives": r"^\['elevator', 'aileron', 'rudder'\] 10\npitch rate 0\.\d+ rad/s$", "design": "Cmelevator",
    "export": r"\d+\.\d m/s after 30 s$", "fmi": r"3\d\.\d m/s after 1\d\d\d m",
    "optimizers": r"paper-W\+noise target",
}  # fmt: skip


def alike(shown: str, printed: str) -> bool:
    a, b = shown.split(), printed.split()
    return len(a) == len(b) and all(map(same, a, b))


def same(shown: str, word: str) -> bool:
    try:
        a, b = float(shown), float(word)
    except ValueError:
        return shown == word
    return (
        a == pytest.approx(b, rel=0.03, abs=1e-12) or abs(a - b) < 0.011
    )  # other processors round otherwise


@pytest.mark.parametrize("page", PRINTED)
def test_python_of_a_page_runs(page: str, tmp_path: Path) -> None:
    printed = run_python(DOCS / f"{page}.md", tmp_path)
    assert re.search(PRINTED[page], printed.strip(), re.MULTILINE), printed
    for apart in re.findall(r"within (\S+) of each channel", printed):
        assert float(apart) < 1e-3


def test_the_campaign_of_the_page_goes_on_from_its_store(tmp_path: Path) -> None:
    page = DOCS / "campaigns.md"
    (tmp_path / "gusts.py").write_text(blocks(page, "python")[0], encoding="utf-8")
    for _ in range(2):
        command = [sys.executable, "gusts.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert f"it prints `{done.stdout.strip()}`" in page.read_text(encoding="utf-8")
    assert (tmp_path / "gusts.sqlite").exists()


@pytest.mark.parametrize("page", ["use-the-result", "fleet-statistics"])
def test_python_of_a_page_prints_what_is_shown(page: str, tmp_path: Path) -> None:
    printed, shown = run_python(DOCS / f"{page}.md", tmp_path), blocks(DOCS / f"{page}.md", "text")[0]
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    expected = [float(x) for x in NUMBER.findall(shown)]
    assert [float(x) for x in NUMBER.findall(printed)] == pytest.approx(expected, rel=0.02)


def test_python_of_the_page_of_flight_files(tmp_path: Path) -> None:
    flight = simulate_flight(load_vehicle("twin-boom"), parse_maneuver("duration = 2.0", "two seconds"))
    save_flight(flight, tmp_path / "flight.nc")
    assert "simulated flight" in run_python(DOCS / "flight-files.md", tmp_path)
    assert (tmp_path / "copy.nc").exists()


@pytest.mark.parametrize("page", ["rotorpy", "gazebo", "learning-simulators"])
def test_models_fly_in_a_simulator_of_others_as_the_page_says(page: str, tmp_path: Path) -> None:
    found = re.findall(r"within (\S+) of each channel", run_python(DOCS / f"{page}.md", tmp_path))
    assert found
    assert max(map(float, found)) < 1e-3


def test_the_page_of_fleets(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = DOCS / "fleet.md"
    run_python(page, here)
    assert main(blocks(page, "text")[0].splitlines()[1].split()[1:]) == 3
    printed, shown = capsys.readouterr().out, blocks(page, "text")[1]
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    assert run_python(page, here, 2).startswith("drone-3 thrust -0.04")
    for query in (3, 4, 5):  # in pandas, Polars and DuckDB
        vehicles = re.findall(r"^.*?(drone-\d)", run_python(page, here, query), re.MULTILINE)
        assert len(set(vehicles)) == 8, query
        assert vehicles[0] == "drone-3", query


def test_the_made_up_fleet(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Through whole logs: no alarm where nothing changed; a weak rotor is the first alarm, with its part and size."""
    (made,) = blocks(DOCS / "fleet.md", "toml")
    text = next(text for text in blocks(DOCS / "fleet.md", "text") if text.startswith("stoop simulate"))
    simulate, fleet = (line.split() for line in text.splitlines())
    for content, code in ((made.partition("[[change]]")[0], 0), (made, 3)):
        Path("fleet.toml").write_text(content)
        assert main([*simulate[1:], "--overwrite"]) == 0
        logs = sorted(map(str, Path("logs").glob("*.ulg")))
        assert main(["fleet", *logs, *fleet[3:], "--workers", "2"]) == code
    alarms = stoop.open_fleet("store").alarms
    assert {alarm.vehicle for alarm in alarms} == {"V2"}
    (first,) = [alarm for alarm in alarms if alarm.figure == "share.m1"]
    assert first.since.startswith("V2-006 ")
    assert first.causes[0].what == "m1: m1-2-2 for m1-2-1"
    # of four rotors, one gives 3 % less thrust at the same command
    share = (1.0 / 0.97) / ((1.0 / 0.97 + 3.0) / 4.0) - 1.0
    assert abs(first.size - share) < 3.0 * first.std_error


def test_frequency_page_runs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = DOCS / "frequency.md"
    Path("sweep.toml").write_text(blocks(page, "toml")[0], encoding="utf-8")
    for command in commands(page):
        capsys.readouterr()
        assert main(one_verb(command.split()[1:])) == 0
    printed = capsys.readouterr().out
    for system, parameter, *both in table(page, "4. Compare", "system").rows:
        for source, cell in zip(("flight", "model"), both, strict=True):
            line = re.search(rf"^{system}, \S+ +{source} +{parameter} +(.*\))", printed, re.MULTILINE)
            assert line is not None, (system, source)
            found, shown = (re.findall(r"[\d.]+", text) for text in (line[1], cell))
            assert [float(x) for x in found] == pytest.approx([float(x) for x in shown], rel=0.05)
    assert "<svg" in Path("frequency.html").read_text(encoding="utf-8")
    assert run_python(page, here) == blocks(page, "text")[0]


def missing(block: str, printed: str) -> Iterator[str]:
    """Yield the lines of a block that were not printed, in this order, but for the rounding of numbers."""
    lines = iter(printed.splitlines())
    for shown in block.splitlines():
        if shown.strip() not in ("", "...") and not any(alike(shown, line) for line in lines):
            yield shown


@pytest.mark.parametrize("name", LOG_PAGES)
def test_the_page_of_a_log_does_as_it_says(name: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From log to model in five steps: the page's own commands, on a log that they make, print what it shows."""
    (here / "examples").symlink_to(ROOT / "examples")
    printed = ""
    for language, block in fences(DOCS / f"{name}.md"):
        if language in ("toml", "ini") and (file := NAMED.match(block)):
            Path(file[1]).write_text(block, encoding="utf-8")
        elif language == "console":
            for line in block.replace("\\\n", " ").splitlines():
                assert main(shlex.split(line.removeprefix("$ "))[1:]) == 0, line
            printed = capsys.readouterr().out
        elif language == "text" and printed:
            assert list(missing(block, printed)) == [], f"{name}:\n{printed}"
            printed = ""
    if name != "other-logs":
        log = next(file for file in here.glob("flight.*") if file.suffix != ".toml")
        assert {"motor_1", "elevator"} & set(map(str, load_flight(log).data))


def test_readme_runs_on_a_real_flight(tmp_path: Path, shared_data: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "flight2").symlink_to(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    assert "CLalpha" in run_python(ROOT / "README.md", tmp_path)
    written = set(table(ROOT / "README.md", "A real flight", "file").column("file"))
    assert written == {p.name for p in (tmp_path / "result").iterdir()}
    result = stoop.load(tmp_path / "result").result
    for name, *numbers, _ in table(DOCS / "vtail.md", "4. Judge", "parameter").rows:
        p = result.parameters[name]
        for number, value in zip(numbers, (p.estimate, p.ci95_lower, p.ci95_upper), strict=True):
            assert value == pytest.approx(float(number), abs=0.2 * p.std_error + 0.006 * abs(value)), name
    for maneuver, channel, model, lag in table(DOCS / "vtail.md", "4. Judge", "maneuver").rows:
        start = float(maneuver.rpartition(" ")[2].partition(":")[0])
        figures = next(m for m in result.maneuvers if m.start == start).channels[channel.split()[0]]
        assert (figures.theil, figures.baseline_theil) == pytest.approx((float(model), float(lag)), abs=0.02)
