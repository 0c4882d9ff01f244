"""`stoop identify` and `stoop demo` as a user meets them; what they refuse stands in test_bad_input."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from unit.cli.conftest import Cli, Done

import stoop
from stoop.cli.main import main
from stoop.cli.options import with_free
from stoop.errors import IdentificationError, StoopError
from stoop.flight import Flight, save
from stoop.optimize import State
from stoop.results.result import read_result
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, resolve_vehicle
from stoop.workflow.checkpoint import Checkpoint
from stoop.workflow.fit_result import fitted_model
from stoop.workflow.fitted_model import FittedModel

TWIN_BOOM = builtin_text("twin-boom")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("identify")
    save(flight, folder / "sim.nc")
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
    plane = resolve_vehicle("twin-boom")
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


@pytest.fixture
def blank_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stoop.report.identification.render", lambda model: "<html></html>")


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
    words = "--maneuver 0:20"
    with monkeypatch.context() as patched:
        patched.setattr("stoop.workflow.identification.finish", pressing(1))
        assert main(identify(place, words, "late")) == 130
        assert result(place, "late")["status"] == "converged"
        assert not (place / "late" / "search.npz").exists()
        patched.setattr("stoop.workflow.identification.finish", pressing(2))
        assert main(identify(place, f"{SHORT} --generations 2", "twice")) == 130
        assert [p.name for p in (place / "twice").iterdir()] == ["search.npz"]
    assert main(identify(place, f"{SHORT} --generations 3 --resume", "twice")) == 0
    assert (place / "twice" / "result.json").exists()


def test_demo(demo: tuple[Path, str], tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """It prints the truth beside the estimates, and replaces an earlier one and nothing else."""
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
    for words in (
        "200 draws from the covariance",
        "static margin",
        "short period, damping",
        "ratio",
        "chord",
    ):
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
