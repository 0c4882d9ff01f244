"""`stoop identify` and its neighbors as a user meets them, on logs as an autopilot writes them, too."""

import json
import re
import shlex
import signal
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.command_line import Cli, Done

import stoop
from stoop.cli.main import main
from stoop.cli.options import with_free
from stoop.errors import IdentificationError, StoopError
from stoop.flight import Flight, save_flight
from stoop.optimize import State
from stoop.results.result import read_result
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow.checkpoint import Checkpoint
from stoop.workflow.fit_result import fitted_model
from stoop.workflow.fitted_model import FittedModel
from stoop_plan.log_bytes import ulog_dropout

TWIN_BOOM = builtin_text("twin-boom")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("identify")
    save_flight(flight, folder / "sim.nc")
    text = TWIN_BOOM.replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    (folder / "v.toml").write_text(text)
    for name, variance in (("one", 0.04), ("two", 0.08)):
        (folder / f"{name}.csv").write_text(f"{variance},1e-4,1e-5,1e-4,0.01,0.04\n")
    return folder


def identify(place: Path, words: str, out: str = "out") -> list[str]:
    return f"identify {place / 'sim.nc'} --vehicle {place / 'v.toml'} -o {place / out} {words}".split()


def result(place: Path, out: str) -> dict[str, Any]:
    return dict(json.loads((place / out / "result.json").read_text()))


def test_identifies_and_tells(place: Path, done: Done) -> None:
    said = done(identify(place, "--maneuver 0:20 --validate 20:28", "whole"))
    lines, document = said.splitlines(), result(place, "whole")
    assert len(lines) <= 45
    assert lines[0] == f"verdict: {read_result(place / 'whole' / 'result.json').verdict.headline}"
    assert all(name in said for name in document["parameters"])
    (ahead,) = [line for line in lines if line.startswith("- sim 20:28: ")]
    assert "better than a first-order lag in" in ahead
    assert lines[-1] == f"report: {place / 'whole' / 'report.html'}"
    assert document["parameters"]["CLalpha"]["estimate"] == pytest.approx(4.78, rel=0.05)
    assert not (place / "whole" / "search.npz").exists()


def test_options_windows_and_files_reach_the_result(place: Path, done: Done) -> None:
    words = "--maneuver -0.5:20 --fix CLV --fix CDV --free mass.mass --budget 400 --generations 1 --verbose"
    said = done(identify(place, f"{words} --noise {place / 'one.csv'}", "freed"))
    document = result(place, "freed")
    assert "mass.mass" in document["parameters"]
    assert "CLV" not in document["parameters"]
    assert document["inputs"].keys() == {"sim.nc", "v.toml", "one.csv"}
    told = "sim -0.5:20: trimmed to the record, 0.00 to 20.00 s"
    assert told in " ".join(said.split())
    assert told in document["warnings"]


def test_numbers_that_are_freed(aircraft: Vehicle, capsys: pytest.CaptureFixture[str]) -> None:
    controls = "[controls.aileron]\nlag = 0.05\n[controls.elevator]\nlag = 0.05\n[controls.rudder]\n"
    whole = parse_vehicle(TWIN_BOOM + controls, "v.toml")
    assert with_free(whole, ["controls.aileron.lag"], [])
    with pytest.raises(IdentificationError, match=r"--free controls\.aileron\.lag: the equations of v\.toml"):
        with_free(whole.reduced("longitudinal"), ["controls.aileron.lag"], [])
    with pytest.raises(IdentificationError, match="leave it out"):
        with_free(aircraft, ["Clp"], [])
    plane = load_vehicle("twin-boom")
    late = with_free(plane, ["controls.aileron.lag", "sensors.V.scale"], [])
    lag, scale = (late.parameters[late.rows[n]] for n in ("controls.aileron.lag", "sensors.V.scale"))
    assert (lag.free, lag.value, lag.prior) == (True, 0.05, 0.03)
    assert (scale.free, scale.value, scale.lower, scale.upper) == (True, 1.0, 0.5, 1.5)
    assert "added: [controls.aileron] lag = {value = 0.05, prior = 0.03}" in capsys.readouterr().err
    both = with_free(plane, ["controls.delay"], [])
    assert both.rows["controls.rudder.delay"] == both.rows["controls.elevator.delay"]
    unknown = {"nonsense": "no number is called 'nonsense'", "controls.aileron.rate_limit": "write"}
    for name, words in unknown.items():
        with pytest.raises(StoopError, match=words):
            with_free(plane, [name], [])


SHORT = "--maneuver 0:6 --optimizer de-rand-1-bin"


@pytest.mark.usefixtures("blank_page")
def test_ctrl_c_keeps_the_best_and_resume_goes_on(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep, kept = Checkpoint.keep, []

    def pressed(self: Checkpoint, state: State) -> None:
        keep(self, state)
        kept.append(state)
        if len(kept) == 2:
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patched:
        patched.setattr("stoop.workflow.checkpoint.INTERVAL", 0.0)
        patched.setattr(Checkpoint, "keep", pressed)
        assert main(identify(place, f"{SHORT} --generations 4", "long")) == 130
    first = result(place, "long")
    assert first["status"] == "interrupted"
    assert first["parameters"]
    assert main(identify(place, f"{SHORT} --generations 4 --seed 9 --resume", "long")) == 2, "another search"
    assert main(identify(place, f"{SHORT} --generations 4 --resume", "long")) == 0
    assert result(place, "long")["status"] == "generations"


def pressing(times: int) -> Callable[..., FittedModel]:
    """Return a step after the search during which Ctrl-C is pressed so many times."""

    def assembled(*arguments: Any) -> FittedModel:
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
        return fitted_model(*arguments)

    return assembled


@pytest.mark.usefixtures("blank_page")
def test_ctrl_c_after_the_search_waits_and_twice_stops(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("stoop.workflow.identification.finish", pressing(1))
        assert main(identify(place, "--maneuver 0:20", "late")) == 130
        assert result(place, "late")["status"] == "converged"
        assert not (place / "late" / "search.npz").exists()
        patched.setattr("stoop.workflow.identification.finish", pressing(2))
        assert main(identify(place, f"{SHORT} --generations 2", "twice")) == 130
        assert [p.name for p in (place / "twice").iterdir()] == ["search.npz"]
    assert main(identify(place, f"{SHORT} --generations 3 --resume", "twice")) == 0
    assert (place / "twice" / "result.json").exists()


def test_demo(demo: tuple[Path, str], tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, said = demo
    assert "truth" in said
    assert "3-2-1-1" in said
    page = re.sub(r"<script.*?</script>", "", (folder / "report.html").read_text(), flags=re.DOTALL)
    assert "://" not in page.replace("http://www.w3.org", "")
    model = stoop.load(folder)
    monkeypatch.setattr("stoop.workflow.demo.identify_demo", lambda seed: (model, {"CLalpha": 4.78}))
    (tmp_path / "vehicle.toml").write_text("mine")
    code, _, err = cli(["demo", "-o", tmp_path])
    assert code == 2
    assert "vehicle.toml: exists already; add --overwrite" in err
    assert (tmp_path / "vehicle.toml").read_text() == "mine"
    assert main(["demo", "-o", str(tmp_path), "--overwrite"]) == 0
    assert main(["demo", "-o", str(tmp_path)]) == 0


def test_tables_page_and_json(fitted: Path, tmp_path: Path, done: Done) -> None:
    page = tmp_path / "page.html"
    given = f"propagate {fitted} --draws 200 --expression ratio=Cmalpha/CLalpha -o {page}"
    printed = done(given)
    for words in ("200 draws from", "static margin", "short period, damping", "ratio", "chord"):
        assert words in printed
    html = page.read_text(encoding="utf-8")
    assert "What the uncertainty means" in html
    assert "Cmalpha/CLalpha" in html
    assert main(given.split()) == 2, "the page is not written over"
    found = json.loads(done(f"propagate {fitted} --draws 300 --airspeed 33:38 --json"))
    assert found["format"] == "stoop-propagation/1"
    margin = next(f for f in found["figures"] if f["name"] == "static margin")
    assert margin["ci95_lower"] < 2.12 / 4.78 < margin["ci95_upper"]
    assert found["curves"][0]["airspeed"][0] == 33.0


QUAD = builtin_text("quad-x")
GUST = "{ intensity = 0.3, length = 50.0 }\n"
GUSTS = f"\n[turbulence]\nairspeed = 5.0\nu = {GUST}v = {GUST}w = {GUST}"
SHAPE = '[[input]]\ncontrol = "{}"\nshape = "{}"\nstart = {}\nstep = {}\namplitude = {}\n'
INPUTS = (
    ("roll", "3-2-1-1", 2.0, 0.15, 15.0), ("pitch", "3-2-1-1", 5.0, 0.15, 15.0), ("yaw", "3-2-1-1", 8.0, 0.3, 1.0),
    ("roll", "doublet", 12.0, 0.3, 12.0),
)  # fmt: skip
HEADER = 16  #: bytes of a ULog before its messages
LOST = (0.76, 0.79)  #: shares of the log between which a busy card lost data


def lose_data(log: Path) -> None:
    """Take messages of data out of a ULog, as a logger does whose card is busy, and say so in it."""
    content = log.read_bytes()
    at, kept, lost = HEADER, [content[:HEADER]], 0
    while at < len(content):
        end = at + 3 + struct.unpack_from("<H", content, at)[0]
        if content[at + 2 : at + 3] == b"D" and LOST[0] <= at / len(content) < LOST[1]:
            lost += 1
        else:
            kept.append(content[at:end])
        at = end
    assert lost > 10
    log.write_bytes(b"".join([*kept, ulog_dropout(400)]))


def hover_thrust(vehicle: Path) -> float:
    command = max(np.roots([6.0, 2.5, -1.5 * 9.80665 / 4.0]).real)
    model = load_vehicle(vehicle)
    return float(model.value("rotors.T1") * command + model.value("rotors.T2") * command**2)


def test_from_a_log_to_a_model_that_predicts_another(here: Path, done: Done) -> None:
    Path("truth.toml").write_text(QUAD + GUSTS)
    inputs = "".join(SHAPE.format(*one) for one in INPUTS)
    Path("m.toml").write_text(f"duration = 15.0\nrate = 100.0\nwind = [2.0, 1.0, 0.0]\n{inputs}")
    for name, seed in (("log", 1), ("other", 2)):
        done(f"simulate truth.toml --maneuver m.toml --seed {seed} -o {name}.ulg")
        lose_data(Path(f"{name}.ulg"))
    assert "the logger reports 1 dropouts, 0.40 s in all" in " ".join(done("info log.ulg --verbose").split())
    done("map log.ulg -o mapping.toml")
    said = done("info log.ulg --mapping mapping.toml").splitlines()
    (line,) = (line for line in said if line.startswith("next: "))
    wrong = QUAD.replace("T1 = 2.5", "T1 = 1.5").replace("torque_ratio = 0.016", "torque_ratio = 0.022")
    Path("V.toml").write_text(wrong)
    assert hover_thrust(Path("V.toml")) < 0.9 * hover_thrust(Path("truth.toml"))
    command = [*shlex.split(line)[2:], "--method", "equation-error"]
    folder = command[command.index("-o") + 1]
    done(command)
    found = Path(folder) / "vehicle.toml"
    assert hover_thrust(found) == pytest.approx(hover_thrust(Path("truth.toml")), rel=0.02)
    assert load_vehicle(found).value("rotors.torque_ratio") == pytest.approx(0.016, rel=0.1)
    told = done(f"validate {folder} other.ulg -o check").splitlines()
    ahead = next(line.split() for line in told if line.startswith("better than a first-order lag in "))
    better, compared = int(ahead[6]), int(ahead[8])
    assert compared >= 4
    assert better > 0.5 * compared, ahead
    assert Path("check/validation.html").read_text().count("Content-Security-Policy") == 1
    assert json.loads(Path("check/validation.json").read_text())["schema"] == "stoop-validation/1"
    assert main(["validate", folder, "other.ulg", "-o", "check"]) == 2
