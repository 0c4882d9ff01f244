"""Edits of a vehicle file, curves without lost peaks, steps, and the progress of a fit, without a browser."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.app import numbers, parts, steps
from stoop.app.folder import ChangedError, Project, version
from stoop.app.plots import drawn_costs, drawn_curves, thinned
from stoop.app.uploads import safe_name
from stoop.app.use_view import LIMITS, TARGET
from stoop.app.windows_view import WindowsView
from stoop.base.verbs import plain, verbs
from stoop.errors import StoopError, VehicleError
from stoop.estimate.iterates import watched
from stoop.input_design.windows_file import Entry
from stoop.report.comparison import Compared, comparison_sheet
from stoop.report.series import Series
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import BUILT_IN, builtin_text, resolve_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow.demo import MANEUVER, NAME, misled
from stoop.workflow.identification import finish, search
from stoop.workflow.progress import ProgressFile, read_curves

VTAIL = (Path(__file__).parents[2] / "examples" / "vtail.toml").read_text("utf-8")


def parameter(text: str, name: str):
    return next(p for p in parse_vehicle(text, "v").parameters if p.name == name)


@pytest.mark.parametrize("text", [VTAIL, *map(builtin_text, BUILT_IN)])
def test_each_number_can_be_edited_and_nothing_else_changes(text: str) -> None:
    before = {row.name: row for row in numbers.rows_of(parse_vehicle(text, "v"))}
    assert all(row.help for row in before.values())
    names = [*before][::5]
    changed = numbers.edited(text, {name: {"free": not before[name].free, "prior": 0.25} for name in names})
    after = {row.name: row for row in numbers.rows_of(parse_vehicle(changed, "v"))}
    for name, row in after.items():
        old = before[name]
        assert (row.value, row.unit, row.group) == (old.value, old.unit, old.group)
        assert row.free == (old.free != (name in names)), name
        assert row.prior == (0.25 if name in names else old.prior)
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert [line for line in changed.splitlines() if line.startswith("#")] == comments


def test_fields_of_a_number() -> None:
    text = numbers.edited(VTAIL, {"CLalpha": {"value": 5.5, "low": 2.0, "high": 9.0}, "Cmq": {"prior": None}})
    assert (parameter(text, "CLalpha").value, parameter(text, "CLalpha").lower) == (5.5, 2.0)
    assert parameter(text, "CLalpha").prior == 1.0, "fields that were not edited stay"
    assert parameter(text, "Cmq").prior is None
    text = numbers.edited(text, {"environment.gravity": {"value": 9.81}, "CLalpha": {"low": None}})
    assert parameter(text, "environment.gravity").value == 9.81
    assert parameter(text, "CLalpha").lower <= -1e30
    for edits in (
        {"CLalpha": {"low": 7.0, "high": 6.0}},
        {"CLalpha": {"value": "x"}},
        {"none": {"value": 1.0}},
    ):
        with pytest.raises(VehicleError):
            numbers.edited(VTAIL, edits)


def test_a_number_is_freed_also_where_the_file_lacks_it() -> None:
    assert parameter(numbers.freed(VTAIL, "mass.mass"), "mass.mass").free
    text = numbers.freed(VTAIL, "Cmalpharudder")
    assert parameter(text, "Cmalpharudder").free
    with pytest.raises(VehicleError, match="no number"):
        numbers.freed(VTAIL, "nothing")


def test_no_peak_is_lost_where_samples_are_left_out() -> None:
    time = np.arange(200_000) * 0.01
    values = np.zeros(time.size)
    values[123_456], values[77_777] = 5.0, -3.0
    values[50_000:60_000] = np.nan
    shown = thinned(time, [Series("p", time, values)], 0.0, float(time[-1]))
    assert len(shown["time"]) < 5000
    assert (np.nanmax(shown["p"]), np.nanmin(shown["p"])) == (5.0, -3.0)
    assert np.isnan(shown["p"]).any()
    assert np.all(np.diff(shown["time"]) > 0.0)
    near = thinned(time, [Series("p", time, values)], 1234.0, 1235.0)
    assert len(near["time"]) < 110
    assert np.nanmax(near["p"]) == 5.0


def test_what_is_shown_is_escaped() -> None:
    nasty = "<script>alert(1)</script>\x1b[31m"
    piece = {"time": [0.0, 1.0], "channels": {nasty: {"measured": [1.0, None], "simulated": [2.0, 3.0]}}}
    simple = [make(nasty) for make in (parts.error, parts.note, parts.soft, parts.escaped, parts.printed)]
    others = [
        parts.table((nasty,), [(nasty,)]),
        parts.bullets([nasty]),
        parts.framed(f'"{nasty}', nasty).object,
        parts.opened(f'"{nasty}', nasty),
    ]
    for text in (*simple, *others, drawn_curves([piece])):
        assert "<script" not in text
        assert "\x1b" not in text
    assert drawn_costs([[0.0, 100.0], [1.0, 10.0]]).count("<path") == 1
    assert drawn_curves([]) == '<div class="curves"></div>'


def test_names_of_sent_files() -> None:
    assert [safe_name(n) for n in ("a.ulg", "../b.ulg", "c\\d.csv.gz", "..", "", ".x", "é\x00<i>.bin", "x" * 300)] == [
        "a.ulg", "b.ulg", "d.csv.gz", "log", "log", "x", "___i_.bin", "x" * 120,
    ]  # fmt: skip


def test_a_vehicle_is_not_replaced_unseen(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    project.take_vehicle(VTAIL)
    mine = version(project.vehicle)
    project.save_vehicle(numbers.edited(VTAIL, {"CL0": {"value": 0.4}}), mine)
    with pytest.raises(ChangedError, match="Your edits are kept"):
        project.save_vehicle(VTAIL, mine)
    project.take_vehicle(builtin_text("quad-x"))
    assert parameter((project.root / "vehicle-1.toml").read_text("utf-8"), "CL0").value == 0.4


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
    failed = project.start("drafts", lambda at: ["vehicle", "none", "-o", f"{at}/vehicle.toml"])
    while failed.running:
        time.sleep(0.02)
    assert failed.state == "failed"
    assert "no such built-in vehicle" in failed.error
    assert [s.name for s in project.steps("drafts")] == ["drafts/001", "drafts/002"]
    assert (tmp_path / "p" / "commands.sh").read_text().count("stoop vehicle") == 2


def test_a_log_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match="no such log"):
        Project(tmp_path / "p").open_log("none.ulg")


def settled(project: Project) -> None:
    while any(step.running for step in project.readings):
        time.sleep(0.05)
    project.tend()


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


def test_what_a_fit_lacks(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    assert project.lacking == "Open a log first"


def test_progress_and_comparison_of_fits(tmp_path: Path) -> None:
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, NAME), 0, name=NAME)
    file = tmp_path / "progress.json"
    progress = ProgressFile(file)
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
    piece = found["curves"][0]
    q = piece["channels"]["q"]
    assert len(piece["time"]) == len(q["simulated"]) <= 200
    assert q["measured"][0] == pytest.approx(float(flight.data["q"][0]), rel=1e-4)
    assert read_curves(file) == ()

    # The curves of the result are kept, and drawn beside those of another.
    job = finish(done)
    progress.keep(job.traces)
    (trace,), (kept,) = job.traces, read_curves(file)
    assert set(kept.channels) == set(trace.channels)
    np.testing.assert_allclose(kept.channels["q"].simulated, trace.channels["q"].simulated, rtol=1e-4)
    values = {p.name: p.value for p in vehicle.parameters}
    lacking = {n: v for n, v in job.result.parameters.items() if n not in ("CLalpha", "Cmq")}
    a = Compared("runs/001", job.result, values, (kept,))
    b = Compared(
        "runs/002",
        replace(job.result, parameters=lacking),
        {"CLalpha": 4.5} | dict.fromkeys(lacking, 1.0),
        (kept,),
    )
    assert "±" in a.cell("CLalpha")
    assert (b.cell("CLalpha"), b.cell("Cmq")) == ("fixed at 4.5", "absent")
    estimates, goodness, curves = comparison_sheet(a, b).sections
    rows = {row[0]: row for row in estimates.parts[-1].rows}
    assert rows["CLalpha"][3] == "–"
    assert float(rows["Cmalpha"][3]) == 0.0
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
    progress = ProgressFile(tmp_path / "none" / "progress.json")
    progress.turn_to("a folder that went away ends no fit")


def test_a_fit_stopped_while_bounds_are_widened_keeps_what_it_has() -> None:
    from dataclasses import dataclass, field
    from types import SimpleNamespace
    from typing import Any, cast

    from stoop.optimize import Outcome
    from stoop.strategy import Strategy, bounds
    from stoop.strategy.decision import Fitted, Setup
    from stoop.strategy.run import setup_of

    vehicle = parse_vehicle(builtin_text("quad-x"), "quad-x")
    name = next(p.name for p in vehicle.parameters if p.free and p.name.startswith("body_drag"))
    upper = parameter(vehicle.text, name).upper
    ended = Outcome(np.zeros(1), 1.0, 1.0, 1, "converged", "", np.empty((0, 2)), None, "x")

    @dataclass(frozen=True)
    class Found:
        outcome: Outcome = ended
        trajectories: float = 1.0
        notices: tuple[Any, ...] = ()
        unknowns: tuple[Any, ...] = field(
            default=(SimpleNamespace(name=name, estimate=upper, fixed="bound"),)
        )
        start: dict[str, float] = field(default_factory=lambda: {name: upper})

    calls = []

    def fitter(setup: Setup) -> Fitted:
        calls.append(1)
        if len(calls) > 1:
            raise KeyboardInterrupt
        return Fitted(setup, cast("Any", Found()))

    found = bounds.widen(setup_of(Strategy.default(), vehicle, {}, []), fitter).estimate
    assert len(calls) == 2
    assert found.outcome.status == "interrupted"
    assert found.outcome.advice == f"stopped by the user while {bounds.DOING}"


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of Panel
def test_a_window_that_was_changed_elsewhere_is_not_replaced(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    first, other = (Entry(flight="f", start=1.0, stop=stop) for stop in (2.0, 3.0))
    project.save_windows([other])
    view = WindowsView(project, lambda title: None)
    view._change(first, stop=2.5)
    assert "This window was changed in another tab or editor" in view.said.object
    assert project.windows == (other,)
    view._change(other, stop=2.5)
    assert [w.stop for w in project.windows] == [2.5]


def test_messages_name_things_and_not_options() -> None:
    assert parts.spoken("check --vehicle, the channels in it") == "check vehicle, the channels in it"
    assert parts.spoken("give --min-amplitude; a--b -- c") == "give min amplitude; a--b -- c"
    for option in (*verbs()["vehicle new"].options, *LIMITS, TARGET):
        made = parts.field(option)
        assert "--" not in f"{made.label} {made.description} {getattr(made, 'placeholder', '')}"


def test_windows_are_kept_in_the_order_of_time(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    project.save_windows(
        [Entry(flight="f", start=5.0, stop=6.0), Entry(flight="f", start=1.0, stop=2.0, use="validate")]
    )
    assert [w.start for w in project.windows] == [1.0, 5.0]


def test_a_field_shows_what_the_table_of_verbs_says_of_its_option() -> None:
    design, export = verbs()["design"], verbs()["export"]
    duration = parts.field(design.option("duration"))
    assert (duration.label, duration.value) == ("duration, s", None)
    assert duration.description == plain(design.option("duration").meaning)
    assert duration.placeholder == "20; by hand 40, sweeps of multirotors 60"
    assert parts.field(design.option("slew")).value == 60.0
    assert parts.field(export.option("target"), "export to").options["Simulink"] == "simulink"


def test_a_field_gives_the_words_of_a_command_or_none() -> None:
    design = verbs()["design"]
    assert parts.given(design.option("duration"), None) == []
    assert parts.given(design.option("duration"), 12.5) == ["--duration", "12.5"]
    assert parts.given(design.option("amplitude"), "3 rudder=5") == ["--amplitude", "3", "rudder=5"]
    assert parts.given(design.option("amplitude"), "-3e-1") == ["--amplitude", "-3e-1"]
    for smuggled in ("3 --overwrite", "3 -o /elsewhere", "--"):
        with pytest.raises(StoopError, match="is no value of it"):
            parts.given(design.option("amplitude"), smuggled)
