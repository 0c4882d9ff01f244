"""Views, drawings and steps without a browser; the progress of a fit and the comparison of two."""

import errno
import json
import math
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.conftest import ended
from stoop.base import files
from stoop.base.verbs import plain, verbs
from stoop.cli.main import main
from stoop.cli.progress_file import ProgressFile
from stoop.errors import StoopError
from stoop.estimate.iterates import watched
from stoop.logs.read import read_unmapped
from stoop.report.series import Series
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import builtin_text, load_vehicle
from stoop.workflow.demo import MANEUVER, NAME, misled
from stoop.workflow.identification import finish, search
from stoop_app import parts, steps
from stoop_app.columns import edited, rows_of
from stoop_app.comparison import Compared, comparison_sheet
from stoop_app.fit_view import FitView
from stoop_app.fleet_view import FleetView
from stoop_app.folder import BEFORE, MAPPING, ChangedError, Project, fleet_logs, store_of, version
from stoop_app.plots import drawn_costs, drawn_curves, thinned
from stoop_app.progress_curves import read_curves
from stoop_app.use_view import LIMITS, TARGET
from stoop_app.windows_view import WindowsView
from stoop_draft.log_columns import columns_of
from stoop_fleet.store import PAGE
from stoop_plan.input_design.windows_file import Entry

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of Panel


def test_no_peak_is_lost_where_samples_are_left_out() -> None:
    time, values = np.arange(200_000) * 0.01, np.zeros(200_000)
    values[123_456], values[77_777], values[50_000:60_000] = 5.0, -3.0, np.nan
    spans = ((0.0, float(time[-1])), (1234.0, 1235.0))
    shown, near = (thinned(time, [Series("p", time, values)], *at) for at in spans)
    assert (np.nanmax(shown["p"]), np.nanmin(shown["p"]), np.nanmax(near["p"])) == (5.0, -3.0, 5.0)
    assert (len(shown["time"]) < 5000, len(near["time"]) < 110) == (True, True)
    assert np.isnan(shown["p"]).any()
    assert np.all(np.diff(shown["time"]) > 0.0)


def test_what_is_shown_is_escaped_and_curves_have_gaps() -> None:
    nasty = "<script>alert(1)</script>\x1b[31m"
    piece = {"time": [0.0, 1.0], "channels": {nasty: {"measured": [1.0, None], "simulated": [2.0, 3.0]}}}
    simple = [make(nasty) for make in (parts.error, parts.note, parts.soft, parts.escaped, parts.printed)]
    framed = [parts.framed(f'"{nasty}', nasty).object, parts.opened(f'"{nasty}', nasty)]
    tables = [parts.table((nasty,), [(nasty,)]), parts.bullets([nasty])]
    for text in (*simple, *framed, *tables, drawn_curves([piece])):
        assert "<script" not in text
        assert "\x1b" not in text
    assert drawn_costs([[0.0, 100.0], [1.0, 10.0]]).count("<path") == 1
    assert drawn_curves([]) == '<div class="curves"></div>'
    q = {"measured": [1.0, None, 2.0], "simulated": [2.0, 3.0, 1.0]}
    drawn = drawn_curves([{"time": [0.0, 1.0, 2.0], "channels": {"q": q}}])
    assert (drawn.count("M"), drawn.count("L")) == (3, 2), "no line across a gap"


def test_fields_show_the_table_of_verbs_and_give_words_of_a_command_or_none() -> None:
    assert parts.spoken("give --min-amplitude, it; a--b -- c") == "give min amplitude, it; a--b -- c"
    for option in (*verbs()["vehicle new"].options, *LIMITS, TARGET):
        made = parts.field(option)
        assert "--" not in f"{made.label} {made.description} {getattr(made, 'placeholder', '')}"
    design, export = verbs()["design"].option, verbs()["export"].option
    duration, amplitude = parts.field(design("duration")), design("amplitude")
    assert (duration.label, duration.value) == ("duration, s", None)
    assert duration.description == plain(design("duration").meaning)
    assert duration.placeholder.startswith("20; ")
    assert parts.field(design("slew")).value == 60.0
    assert parts.field(export("target"), "export to").options["Simulink"] == "simulink"
    for option, value, words in (
        (design("duration"), None, []), (design("duration"), 12.5, ["--duration", "12.5"]),
        (amplitude, "3 rudder=5", ["--amplitude", "3", "rudder=5"]), (amplitude, "-3e-1", ["--amplitude", "-3e-1"]),
    ):  # fmt: skip
        assert parts.given(option, value) == words
    for smuggled in ("3 --overwrite", "3 -o /elsewhere", "--"):
        with pytest.raises(StoopError, match="is no value of it"):
            parts.given(amplitude, smuggled)


def test_a_full_disk_and_a_window_changed_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = Project(tmp_path)
    project.take_vehicle(builtin_text("quad-x"))
    first, other = (Entry(flight="f", start=1.0, stop=stop) for stop in (2.0, 3.0))
    project.save_windows([other])
    windows = WindowsView(project, lambda _: None)
    windows._change(first, stop=2.5)
    assert "This window was changed in another tab or editor" in windows.said.object
    assert project.windows == (other,)
    windows._change(other, stop=2.5)
    assert [w.stop for w in project.windows] == [2.5]
    before = project.vehicle

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files, "_write_through", full)
    view = FitView(project, lambda _: None)
    view.act(lambda: project.save_vehicle("other", None))()
    assert "No space left on device" in view.said.object
    assert project.vehicle == before


def test_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["app", "--folder", str(tmp_path / "file"), "--no-browser"]) == 2
    assert "is a file" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "panel", None)
    assert main(["app", "--folder", str(tmp_path)]) == 2
    missing = "app: the package panel is not installed; pip install '.[app]' in a clone of stoop"
    assert capsys.readouterr().err == f"stoop: error: {missing}\n"


def test_a_step_is_a_process_whose_state_any_server_knows(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    (tmp_path / "p" / "json.py").write_text("raise SystemExit(7)")  # not imported
    step = project.start("drafts", lambda at: ["vehicle", "quad-x", "-o", f"{at}/vehicle.toml"])
    assert step.command == "stoop vehicle quad-x -o drafts/001/vehicle.toml"
    child = steps._children.pop(step.folder)  # as another server sees it
    assert step.running
    assert child.wait() == 0
    assert not step.running
    assert (step.state, step.error) == ("done", "")
    failed = ended(project.start("drafts", lambda at: ["vehicle", "none", "-o", f"{at}/vehicle.toml"]))
    assert failed.state == "failed"
    assert "no such built-in vehicle" in failed.error
    assert [s.name for s in project.steps("drafts")] == ["drafts/001", "drafts/002"]
    assert (tmp_path / "p" / "commands.sh").read_text().count("stoop vehicle") == 2


def settled(project: Project) -> None:
    """Do what the page does until nothing more happens."""
    before = running = None
    while running is not False or project.signature != before:
        running = any(s.running for kind in ("map", "info", "corrections") for s in project.steps(kind))
        before = project.signature
        project.tend()
        time.sleep(0.02)


def test_a_log_that_cannot_be_read_leaves_the_present_one_in_place(quadrotor: Path, tmp_path: Path) -> None:
    project = Project(quadrotor)
    good, windows = project.log, project.windows
    assert project.lacking == ""
    bad, other = tmp_path / "bad.ulg", tmp_path / "other.ulg"
    bad.write_bytes(b"junk" * 100)
    other.write_bytes(Path(good).read_bytes())
    project.open_log(bad)
    assert project.lacking
    settled(project)
    assert (project.log, project.windows, project.lacking) == (good, windows, "")
    assert project.refused is not None
    assert "its first bytes are wrong" in project.refused.error
    assert project.former == [], "what cannot be read is not offered"
    # another log has windows of its own; the former one comes back with its own, and is not read again
    project.open_log(other)
    settled(project)
    assert (project.log, project.windows, project.former) == (str(other), (), [good])
    assert project.lacking == "Choose a window to fit first"
    project.save_windows([Entry(flight="other", start=1.0, stop=2.0)])
    count = len(project.readings)
    project.open_log(good)
    assert (project.log, project.windows, project.former) == (good, windows, [str(other)])
    assert (len(project.readings), project.lacking, project.refused) == (count, "", None)
    project.open_log(other)
    assert [w.flight for w in project.windows] == ["other"]


def test_corrections_are_taken_once_and_a_changed_mapping_is_read(table: Path, tmp_path: Path) -> None:
    project = Project(tmp_path / "project")
    project.open_log(table)
    settled(project)
    listed = [*columns_of(read_unmapped(table))]

    def pitch_rate(mapping: str) -> Any:
        return next(row for row in rows_of(mapping, listed) if row.column == "gyro_y")

    assert project.listing is not None
    text = project.listing.text(MAPPING)
    wrong = edited(text, [(pitch_rate(text), {"scale": -1.0})])
    project.save_mapping(wrong, version(text))
    settled(project)
    assert project.info["channels"]
    project.correct_mapping()
    settled(project)
    corrected = project.mapping
    assert pitch_rate(corrected).scale == 1.0
    assert project.corrections is not None
    assert project.flight is not None
    assert project.corrections.text(BEFORE) == wrong
    assert project.flight.text(MAPPING) == corrected, "the log is read by it"
    project.take_mapping(wrong)  # undone
    settled(project)
    assert project.mapping == wrong, "what was undone is not done again"
    place, readings = project.root / MAPPING, len(project.steps("info"))
    place.write_text(corrected, "utf-8")  # in an editor
    settled(project)
    assert len(project.steps("info")) == readings + 1
    assert project.flight.text(MAPPING) == corrected
    with pytest.raises(ChangedError, match="Your edits are kept"):
        project.save_mapping(text, version(wrong))
    place.write_text("no mapping", "utf-8")
    settled(project)
    assert project.reading is not None
    assert project.reading.state == "failed"
    assert project.lacking == "The log is not read yet"


def test_a_folder_of_logs_is_read_and_its_page_is_shown(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text("duration = 8.0\nrate = 50.0\n")
    (tmp_path / "fleet.toml").write_text("vehicles = 2\nflights = 2\n")
    logs, project = tmp_path / "logs", Project(tmp_path / "project")
    words = ["--fleet", tmp_path / "fleet.toml", "--maneuver", tmp_path / "m.toml", "-o", logs]
    assert main(["simulate", "quad-x", *map(str, words)]) == 0
    view = FleetView(project, lambda _: None)

    def shown() -> str:
        view.refresh()
        return "".join(str(getattr(one, "object", "")) for one in view.body)

    assert "No vehicle is chosen yet" in shown()
    (bag := tmp_path / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.mcap"):
        (bag / name).write_text("")
    for place in (tmp_path / "none", logs / "V1-001.ulg", bag, tmp_path):
        assert fleet_logs(place) == []
        with pytest.raises(StoopError, match="is no folder of logs"):
            project.open_fleet(place)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "a.ulg").write_bytes(b"")
    assert ended(project.open_fleet(tmp_path / "broken")).state == "failed"
    assert "no log gave a figure" in shown()
    project.save_vehicle(builtin_text("quad-x"), None)
    step = project.open_fleet(logs)
    assert step.words[2:] == [
        *(str(logs / f"V{v}-00{i}.ulg") for v in (1, 2) for i in (1, 2)),
        "--parts", str(logs / "parts.csv"), "--vehicle", "vehicle.toml", "-o", store_of(logs),
    ]  # fmt: skip
    assert ended(step).state == "done"
    assert (project.root / store_of(logs) / PAGE).exists()
    page = shown()
    assert "2 vehicles, 4 flights" in page
    assert f"{store_of(logs)}/{PAGE}" in page
    assert store_of(logs) != store_of(tmp_path / "other" / "logs"), "of folders of one name"


def test_progress_and_comparison_of_fits(tmp_path: Path) -> None:
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, NAME), 0, name=NAME)
    progress = ProgressFile(file := tmp_path / "progress.json")
    progress.turn_to("searching")
    assert json.loads(file.read_text("utf-8"))["work"] == "searching"
    with watched(progress.see):
        progress._written = -math.inf  # a moment later
        done = search(misled(vehicle, 0), flight, ["0:30"])
    found = json.loads(file.read_text("utf-8"))
    assert found["format"] == "stoop-progress/1"
    assert set(found["parameters"]) == set(done.estimate.estimates)
    assert found["parameters"]["CLalpha"]["unit"] == "1/rad"
    assert math.isfinite(found["cost"])
    q = found["curves"][0]["channels"]["q"]
    assert len(found["curves"][0]["time"]) == len(q["simulated"]) <= 200
    assert q["measured"][0] == pytest.approx(float(flight.data["q"][0]), rel=1e-4)
    assert read_curves(file) == ()
    # The curves of the result are kept, and drawn beside those of another.
    job = finish(done)
    progress.keep(job.traces)
    (trace,), (kept,) = job.traces, read_curves(file)
    assert set(kept.channels) == set(trace.channels)
    np.testing.assert_allclose(kept.channels["q"].simulated, trace.channels["q"].simulated, rtol=1e-4)
    lacking = {n: v for n, v in job.result.parameters.items() if n not in ("CLalpha", "Cmq")}
    others = {"CLalpha": 4.5} | dict.fromkeys(lacking, 1.0)
    a = Compared("runs/001", job.result, {p.name: p.value for p in vehicle.parameters}, (kept,))
    b = Compared("runs/002", replace(job.result, parameters=lacking), others, (kept,))
    assert "±" in a.cell("CLalpha")
    assert (b.cell("CLalpha"), b.cell("Cmq")) == ("fixed at 4.5", "absent")
    estimates, goodness, curves = comparison_sheet(a, b).sections
    apart = {row[0]: row[3] for row in estimates.parts[-1].rows}
    assert (apart["CLalpha"], float(apart["Cmalpha"])) == ("–", 0.0)
    assert len(goodness.parts[-1].rows) == 2
    panel = next(p for p in curves.parts[-1].panels if p.name == "q")
    assert [one.name for one in panel.strips[0].series] == ["measured", "A", "B"]
    assert len(comparison_sheet(a, replace(b, traces=())).sections[-1].parts) == 1, "curves were not kept"
    assert goodness.parts[0].text.startswith("No window is predicted by both")

    def predicting(run: Compared, theil: float) -> Compared:
        (one,) = run.result.maneuvers
        held_back = replace(one, role="validation", channels={"q": replace(one.channels["q"], theil=theil)})
        return replace(run, result=replace(run.result, maneuvers=(held_back,)))

    better = comparison_sheet(predicting(a, 0.2), predicting(b, 0.1)).sections[1].parts[0].text
    assert better == "Of 1 channel that both predict, B is nearer to the flight in 1, A in 0."
    ProgressFile(tmp_path / "none" / "progress.json").turn_to("a folder that went away ends no fit")
