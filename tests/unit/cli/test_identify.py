"""`stoop identify` and `stoop demo` as a user meets them."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from stoop.cli.main import main
from stoop.cli.options import with_free
from stoop.cli.progress import Watch
from stoop.errors import IdentificationError, StoopError
from stoop.flight import Flight, save
from stoop.optimize import State
from stoop.results.result import read_result
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.checkpoint import Checkpoint
from stoop.workflow.fit_result import fitted_model
from stoop.workflow.fitted_model import FittedModel

VEHICLE = Path(__file__).parents[3] / "src" / "stoop" / "data" / "twin_boom.toml"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("identify")
    save(flight, folder / "sim.nc")
    text = VEHICLE.read_text().replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    (folder / "v.toml").write_text(text)
    return folder


def identify(place: Path, *words: str, out: str = "out") -> list[str]:
    return [
        "identify",
        str(place / "sim.nc"),
        "--vehicle",
        str(place / "v.toml"),
        "-o",
        str(place / out),
        *words,
    ]


def test_identifies_and_tells(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(identify(place, "--maneuver", "0:20", "--validate", "20:28", out="whole")) == 0
    said = capsys.readouterr().out
    lines = said.splitlines()
    document = json.loads((place / "whole" / "result.json").read_text())
    assert len(lines) <= 45
    assert lines[0] == f"verdict: {read_result(place / 'whole' / 'result.json').verdict.headline}"
    assert all(name in said for name in document["parameters"])
    (ahead,) = [line for line in lines if line.startswith("- sim 20:28: ")]
    assert "better than a first-order lag in" in ahead
    assert lines[-1] == f"report: {place / 'whole' / 'report.html'}"
    assert document["parameters"]["CLalpha"]["estimate"] == pytest.approx(4.78, rel=0.05)
    assert not (place / "whole" / "search.npz").exists()


def test_a_window_slightly_beyond_the_record_is_trimmed_and_told(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(identify(place, "--maneuver", "-0.5:20", "--generations", "1", "--verbose", out="beyond")) == 0
    )
    told = "sim -0.5:20: trimmed to the record, 0.00 to 20.00 s"
    assert told in " ".join(capsys.readouterr().out.split())
    assert told in json.loads((place / "beyond" / "result.json").read_text())["warnings"]


def test_a_window_far_beyond_the_record_is_an_error_with_the_line_to_write(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for window, written in (("-5:20", "0:20"), ("20:60", "20:30"), ("-9:90", "0:30")):
        assert main(identify(place, "--maneuver", window, out="far")) == 2
        error = capsys.readouterr().err
        assert (
            f"beyond the record, which runs from 0.00 to 30.00 s on the log's own clock; write {written} for"
            in error
        )
    assert not (place / "far" / "result.json").exists()


def test_free_and_fix(place: Path) -> None:
    words = ["--maneuver", "0:28", "--fix", "CLV", "--fix", "CDV", "--free", "mass.mass", "--budget", "400"]
    assert main(identify(place, *words, out="freed")) == 0
    names = json.loads((place / "freed" / "result.json").read_text())["parameters"]
    assert "mass.mass" in names
    assert "CLV" not in names


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (["--maneuver", "100:200"], "outside the record"),
        (["--maneuver", "5:2"], "start must come before"),
        (["--maneuver", "x"], "START:STOP"),
        (["--maneuver", "0:20", "--free", "CLalfa"], "did you mean CLalpha"),
        (["--maneuver", "0:20", "--free", "CLq", "--fix", "CLq"], "keep one"),
        (["--maneuver", "0:20", "--optimizer", "magic"], "ps-gde-lm"),
        (["--maneuver", "0:20", "--noise", "/nonexistent"], "/nonexistent: no such file; check the name"),
        (["--maneuver", "0:20", "10:25"], "overlaps the fitted sim@0:20"),
        (["--maneuver", "-5:-1"], "outside the record, which runs from 0.00 to 30.00 s"),
        (
            ["--maneuver", "0:20", "--validate", "19:28"],
            "nothing may be fitted in a window that is predicted",
        ),
        (["--maneuver", "0:20", "--free", "Clp"], "--free Clp: the equations of"),
        (["--maneuver", "0:20", "--fix", "sensors.p.bias"], "--fix sensors.p.bias: the equations of"),
        (["--maneuver", "0:20", "--target-cost", "nan"], "--target-cost: 'nan' is not a number"),
        (["--maneuver", "0:20", "--target-cost", "inf"], "--target-cost: 'inf' is not a number"),
        (["--maneuver", "0:20", "--generations", "0"], "--generations: '0' is not a whole number from 1 to"),
        (["--maneuver", "0:20", "--budget", "-1"], "positive"),
        (["--maneuver", "0:20", "--budget", "inf"], "--budget: 'inf' is not a positive number"),
        (["--maneuver", "0:20", "--seed", "x"], "whole number"),
        (["--maneuver", "0:20", "--resume"], "no interrupted search"),
        ([], "--maneuver"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    place: Path, words: list[str], advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(identify(place, *words, out="bad")) == 2
    error = capsys.readouterr().err
    assert advice in error
    assert error.count("\n") == 1
    assert not (place / "bad").exists()


@pytest.mark.parametrize("missing", ["sim.nc", "v.toml"])
def test_missing_files(place: Path, tmp_path: Path, missing: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = identify(place, "--maneuver", "0:20", out="missing")
    words = [w.replace(str(place / missing), str(tmp_path / missing)) for w in words]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert missing in error
    assert error.count("\n") == 1


def test_missing_channel_names_what_is_there(
    place: Path, tmp_path: Path, aircraft: Vehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    controls = "\n[controls.elevator]\nmix = { pwm_3 = 0.001 }\n[controls.aileron]\n[controls.rudder]\n"
    text = (place / "v.toml").read_text() + controls
    (tmp_path / "v.toml").write_text(text)
    words = [
        "identify",
        str(place / "sim.nc"),
        "--vehicle",
        str(tmp_path / "v.toml"),
        "--maneuver",
        "0:20",
        "-o",
        str(tmp_path / "o"),
    ]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "pwm_3" in error
    assert "elevator" in error


def test_a_result_is_not_overwritten_unasked(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "old").mkdir()
    (place / "old" / "result.json").write_text("mine")
    assert main(identify(place, "--maneuver", "0:20", out="old")) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (place / "old" / "result.json").read_text() == "mine"


@pytest.mark.parametrize("name", ["vehicle.toml", "flight.nc"])
@pytest.mark.parametrize("extra", [[], ["--overwrite"], ["--resume"]])
def test_an_input_is_never_written_over(
    name: str,
    extra: list[str],
    place: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    flight, vehicle = ("flight.nc", "v.toml") if name == "flight.nc" else ("sim.nc", "vehicle.toml")
    Path(flight).write_bytes((place / "sim.nc").read_bytes())
    Path(vehicle).write_bytes((place / "v.toml").read_bytes())
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert main(["identify", flight, "--vehicle", vehicle, "--maneuver", "0:20", "-o", ".", *extra]) == 2
    error = capsys.readouterr().err
    assert f"{name}: is read by this run" in error
    assert error.count("\n") == 1
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_tied_number_is_named_by_its_target(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    controls = """
[controls.aileron]
lag = 0.05
[controls.elevator]
lag = "=controls.aileron.lag"
[controls.rudder]
"""
    (tmp_path / "v.toml").write_text(VEHICLE.read_text() + controls)
    words = identify(place, "--maneuver", "0:20", "--fix", "controls.elevator.lag")
    words[words.index("--vehicle") + 1] = str(tmp_path / "v.toml")
    assert main(words) == 2
    assert (
        "--fix controls.elevator.lag: tied to controls.aileron.lag; name that one" in capsys.readouterr().err
    )


def test_a_control_that_the_equations_drop_is_not_freed(aircraft: Vehicle) -> None:
    controls = "[controls.aileron]\nlag = 0.05\n[controls.elevator]\nlag = 0.05\n[controls.rudder]\n"
    whole = parse_vehicle(VEHICLE.read_text() + controls, "v.toml")
    assert with_free(whole, ["controls.aileron.lag"], [])
    with pytest.raises(IdentificationError, match=r"--free controls\.aileron\.lag: the equations of v\.toml"):
        with_free(whole.reduced("longitudinal"), ["controls.aileron.lag"], [])
    with pytest.raises(IdentificationError, match="leave it out"):
        with_free(aircraft, ["Clp"], [])


def test_a_number_that_the_file_lacks_is_added_with_its_usual_value(
    capsys: pytest.CaptureFixture[str],
) -> None:
    plane = resolve_vehicle("twin-boom")
    late = with_free(plane, ["controls.aileron.lag", "sensors.V.scale"], [])
    lag, scale = (late.parameters[late.rows[n]] for n in ("controls.aileron.lag", "sensors.V.scale"))
    assert (lag.free, lag.value, lag.prior) == (True, 0.05, 0.03)
    assert (scale.free, scale.value, scale.lower, scale.upper) == (True, 1.0, 0.5, 1.5)
    err = capsys.readouterr().err
    assert "added: [controls.aileron] lag = {value = 0.05, prior = 0.03}" in err
    both = with_free(plane, ["controls.delay"], [])
    assert both.rows["controls.rudder.delay"] == both.rows["controls.elevator.delay"]
    for name, words in (
        ("nonsense", "no number is called 'nonsense'"),
        ("controls.aileron.rate_limit", "write"),
    ):
        with pytest.raises(StoopError, match=words):
            with_free(plane, [name], [])


def test_the_result_names_every_file_that_was_read(place: Path) -> None:
    (place / "q.csv").write_text("0.04,1e-4,1e-5,1e-4,0.01,0.04\n")
    words = ["--maneuver", "0:20", "--noise", str(place / "q.csv"), "--budget", "200"]
    assert main(identify(place, *words, out="read")) == 0
    inputs = json.loads((place / "read" / "result.json").read_text())["inputs"]
    assert inputs.keys() == {"sim.nc", "v.toml", "q.csv"}


SHORT = ["--maneuver", "0:20", "--optimizer", "de-rand-1-bin"]


def test_a_search_that_ran_out_can_go_on_and_only_the_same(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / "one.csv").write_text("0.04,1e-4,1e-5,1e-4,0.01,0.04\n")
    (place / "two.csv").write_text("0.08,1e-4,1e-5,1e-4,0.01,0.04\n")
    first = [*SHORT, "--noise", str(place / "one.csv"), "--generations", "3"]
    assert main(identify(place, *first, out="ran-out")) == 0
    assert (place / "ran-out" / "search.npz").exists()
    before = json.loads((place / "ran-out" / "result.json").read_text())
    assert before["status"] == "generations"
    other = [*SHORT, "--noise", str(place / "two.csv"), "--resume"]
    assert main(identify(place, *other, out="ran-out")) == 2
    assert "the interrupted search is another one" in capsys.readouterr().err
    assert main(identify(place, *first[:-1], "5", "--resume", out="ran-out")) == 0
    after = json.loads((place / "ran-out" / "result.json").read_text())
    assert after["trajectories"] > before["trajectories"]


def test_a_folder_that_goes_away_ends_no_search(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = Checkpoint.keep

    def removed(self: Checkpoint, state: State) -> None:
        shutil.rmtree(place / "gone", ignore_errors=True)
        keep(self, state)

    monkeypatch.setattr("stoop.workflow.checkpoint.INTERVAL", 0.0)
    monkeypatch.setattr(Checkpoint, "keep", removed)
    assert main(identify(place, *SHORT, "--generations", "4", out="gone")) == 0
    assert capsys.readouterr().err.count("the search goes on") == 1
    assert (place / "gone" / "result.json").exists()
    assert (place / "gone" / "search.npz").exists()


def pressing(times: int) -> Callable[..., FittedModel]:
    """Return a step after the search during which Ctrl-C is pressed so many times."""

    def assembled(*arguments: Any) -> FittedModel:
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
        return fitted_model(*arguments)

    return assembled


def test_ctrl_c_after_the_search_waits_for_the_result(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stoop.workflow.identification.finish", pressing(1))
    assert main(identify(place, "--maneuver", "0:20", out="late")) == 130
    assert json.loads((place / "late" / "result.json").read_text())["status"] == "converged"
    assert not (place / "late" / "search.npz").exists()


def test_ctrl_c_twice_stops_and_the_search_is_still_there(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("stoop.workflow.identification.finish", pressing(2))
        assert main(identify(place, "--maneuver", "0:20", out="twice")) == 130
    assert [p.name for p in (place / "twice").iterdir()] == ["search.npz"]
    assert main(identify(place, "--maneuver", "0:20", "--resume", out="twice")) == 0
    assert not (place / "twice" / "search.npz").exists()


def test_speed_is_of_this_run_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = iter([100.0, 110.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    watch = Watch()
    watch.count_from(5000.0)
    state = SimpleNamespace(generation=7)
    watch.see(
        SimpleNamespace(state=state, trajectories=5200.0, cost=1.0, event=SimpleNamespace(kind="refinement"))
    )  # type: ignore[arg-type]
    assert "5200 trajectories  20/s" in capsys.readouterr().err


def test_ctrl_c_keeps_the_best_and_resume_goes_on(place: Path) -> None:
    """A long search by a slow optimizer, interrupted as a user would, then resumed to its end."""
    words = identify(
        place, "--maneuver", "0:28", "--optimizer", "de-rand-1-bin", "--budget", "60000", out="long"
    )
    command = [sys.executable, "-m", "stoop", *words]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, "STOOP_THREADS": "1"}
    )
    while not (place / "long" / "search.npz").exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate()
    assert process.returncode == 130, error
    first = json.loads((place / "long" / "result.json").read_text())
    assert first["status"] == "interrupted"
    longer = [*words, "--generations", "60", "--resume"]
    assert main(longer) == 0
    assert json.loads((place / "long" / "result.json").read_text())["status"] != "interrupted"


def test_demo_prints_truth_beside_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "-o", str(tmp_path / "demo")]) == 0
    said = capsys.readouterr().out
    assert "truth" in said
    page = (tmp_path / "demo" / "report.html").read_text()
    assert "://" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL).replace(
        "http://www.w3.org", ""
    )
    assert "3-2-1-1" in said


def test_demo_replaces_an_earlier_demo_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "vehicle.toml").write_text("mine")
    assert main(["demo", "-o", str(tmp_path)]) == 2
    assert "vehicle.toml: exists already; add --overwrite" in capsys.readouterr().err
    assert (tmp_path / "vehicle.toml").read_text() == "mine"
    assert main(["demo", "-o", str(tmp_path), "--overwrite"]) == 0
    assert main(["demo", "-o", str(tmp_path)]) == 0


def test_demo_seed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--seed", "-1"]) == 2
    assert "--seed: '-1' is not a whole number" in capsys.readouterr().err
