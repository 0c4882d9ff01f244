"""The folder of a project without a browser: edits of vehicle files and mappings, what is opened, and who may ask for it."""

import os
import signal
import time
from pathlib import Path

import pytest
from core.strategy.test_strategy import switched
from tornado import httputil

from app.conftest import RECORDED
from stoop.base.units import UNITS
from stoop.base.variables import VARIABLES
from stoop.errors import LogError, StoopError, VehicleError
from stoop.logs.read import read_unmapped
from stoop.strategy import DECISIONS, Strategy
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import parse_vehicle
from stoop_app import columns, numbers, places, server
from stoop_app.columns import edited, rows_of, units_of
from stoop_app.folder import ChangedError, Project, version
from stoop_app.steps import COMMAND, LOCK, PROCESS, Step
from stoop_app.uploads import safe_name
from stoop_draft.log_columns import columns_of
from stoop_draft.mapping_draft import draft
from stoop_plan.input_design.windows_file import Entry

VTAIL = (Path(__file__).parents[2] / "examples" / "vtail.toml").read_text("utf-8")


def parameter(text: str, name: str):
    return next(p for p in parse_vehicle(text, "v").parameters if p.name == name)


def test_each_number_can_be_edited_and_nothing_else_changes() -> None:
    for text in (VTAIL, builtin_text("quad-x"), builtin_text("twin-boom")):
        before = {row.name: row for row in numbers.rows_of(parse_vehicle(text, "v"))}
        assert all(row.help for row in before.values())
        names = [*before][::5]
        changes = {name: {"free": not before[name].free, "prior": 0.25} for name in names}
        changed = numbers.edited(text, changes)
        for row in numbers.rows_of(parse_vehicle(changed, "v")):
            old = before[row.name]
            assert (row.value, row.unit, row.group) == (old.value, old.unit, old.group)
            assert row.free == (old.free != (row.name in names)), row.name
            assert row.prior == (0.25 if row.name in names else old.prior)
        comments = [line for line in text.splitlines() if line.startswith("#")]
        assert [line for line in changed.splitlines() if line.startswith("#")] == comments


def test_fields_of_a_number() -> None:
    text = numbers.edited(VTAIL, {"CLalpha": {"value": 5.5, "low": 2.0, "high": 9.0}, "Cmq": {"prior": None}})
    lift = parameter(text, "CLalpha")
    assert (lift.value, lift.lower, lift.prior) == (5.5, 2.0, 1.0), "fields that were not edited stay"
    assert parameter(text, "Cmq").prior is None
    text = numbers.edited(text, {"environment.gravity": {"value": 9.81}, "CLalpha": {"low": None}})
    assert parameter(text, "environment.gravity").value == 9.81
    assert parameter(text, "CLalpha").lower <= -1e30
    lift = ({"low": 7.0, "high": 6.0}, {"value": "x"})
    for wrong in (*({"CLalpha": fields} for fields in lift), {"none": {"value": 1.0}}):
        with pytest.raises(VehicleError):
            numbers.edited(VTAIL, wrong)
    for name in ("mass.mass", "Cmalpharudder"):  # also where the file lacks it
        assert parameter(numbers.freed(VTAIL, name), name).free
    with pytest.raises(VehicleError, match="no number"):
        numbers.freed(VTAIL, "nothing")


def test_names_of_sent_files() -> None:
    names = {
        "a.ulg": "a.ulg", "../b.ulg": "b.ulg", "c\\d.csv.gz": "d.csv.gz", "..": "log", "": "log", ".x": "x",
        "é\x00<i>.bin": "___i_.bin", "x" * 300: "x" * 120,
    }  # fmt: skip
    assert {name: safe_name(name) for name in names} == names


def test_a_vehicle_is_not_replaced_unseen(tmp_path: Path) -> None:
    project = Project(tmp_path / "p")
    assert project.lacking == "Open a log first"
    with pytest.raises(StoopError, match="no such log"):
        project.open_log("none.ulg")
    project.take_vehicle(VTAIL)
    mine = version(project.vehicle)
    project.save_vehicle(numbers.edited(VTAIL, {"CL0": {"value": 0.4}}), mine)
    with pytest.raises(ChangedError, match="Your edits are kept"):
        project.save_vehicle(VTAIL, mine)
    project.take_vehicle(builtin_text("quad-x"))
    assert parameter((project.root / "vehicle-1.toml").read_text("utf-8"), "CL0").value == 0.4
    project.save_windows([Entry(flight="f", start=a, stop=a + 1.0) for a in (5.0, 1.0)])
    assert [w.start for w in project.windows] == [1.0, 5.0]


@pytest.mark.usefixtures("nothing_starts")
def test_a_log_outside_the_folder_is_read_only_when_the_person_has_opened_it(tmp_path: Path) -> None:
    (root := tmp_path / "p").mkdir()
    (tmp_path / "other.csv").write_text("time_s,p\n0,1\n1,2\n")
    (root / "app.toml").write_text('log = "../other.csv"\n')
    for act in (Project.read_log, Project.list_columns, Project.propose_windows):
        with pytest.raises(StoopError, match="you have not opened it"):
            act(Project(root))
    Project(root).open_log(tmp_path / "other.csv")
    assert Project(root).source[0] == str(tmp_path / "other.csv")
    (root / "-o").write_text("time_s,p\n0,1\n")
    Project(root).open_log("-o")
    assert Project(root).source[0] == "./-o", "no option of the command"
    assert Project(root).readings[-1].command.split()[2] == "./-o"


@pytest.mark.skipif(os.name != "posix", reason="locks and groups of processes as POSIX has them")
@pytest.mark.usefixtures("nothing_starts")
def test_a_process_of_others_is_never_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    (run := tmp_path / "runs" / "001").mkdir(parents=True)
    for file, text in ((COMMAND, "stoop identify log.csv"), (PROCESS, "4242\n")):
        (run / file).write_text(text)
    killed: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "killpg", lambda *words: killed.append(words))
    found = Step(run)
    with (run / LOCK).open("wb") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        assert found.running
        found.stop()
        assert killed == []
        places.remember("process", found.folder, "4343")  # as `start` does
        places._session.clear()  # another server
        found.stop()
    assert killed == [(4343, signal.SIGINT)]


def row_of(rows: list[columns.Row], column: str) -> columns.Row:
    return next(row for row in rows if row.column == column)


def test_every_column_has_a_row_and_edits_are_written_into_their_lines(table: Path) -> None:
    text, listed = draft(table).text, [*columns_of(read_unmapped(table))]
    rows = rows_of(text, listed)
    assert {row.column for row in rows} == {"time_s", *RECORDED}
    for column, (variable, unit) in RECORDED.items():
        row, unknown = row_of(rows, column), column in ("stick", "wheel")
        expected = ("", "", columns.UNKNOWN) if unknown else (variable, unit, row.doubt)
        assert (row.variable, row.unit if not unknown else "", row.doubt) == expected, column
    assert row_of(rows, "time_s").doubt == columns.CLOCK
    assert row_of(rows, "h_ft").values.count(",") == 2
    stick, p, q, h = (row_of(rows, name) for name in ("stick", "gyro_x", "gyro_y", "h_ft"))
    for changes, error, match in (
        ([(stick, {"variable": "elevator"})], StoopError,
         "stick: choose the unit in which it was recorded, one of rad, mrad, deg"),
        ([(stick, {"variable": "p", "unit": "deg/s"})], StoopError, "p is read from two columns"),
        ([(stick, {"variable": "elevator", "unit": "kt"})], LogError, "is an angle"),
        ([(row, {"variable": ""}) for row in rows if row.line], LogError, "it names no variable"),
    ):  # fmt: skip
        with pytest.raises(error, match=match):
            edited(text, changes)
    elevator = {"variable": "elevator", "unit": "deg", "scale": -2.0}
    changed = edited(text, [(stick, elevator), (p, {"scale": -1.0, "offset": 0.5}), (h, {"variable": ""})])
    after = rows_of(changed, listed)
    found = row_of(after, "stick")
    assert (found.variable, found.unit, found.scale) == ("elevator", "deg", -2.0)
    rate = row_of(after, "gyro_x")
    assert (rate.scale, rate.offset, row_of(after, "h_ft").variable) == (-1.0, 0.5, "")
    kept = [line for line in text.splitlines() if not line.startswith(("p =", "altitude ="))]
    assert [line for line in changed.splitlines() if line in kept] == kept
    back = edited(changed, [(rate, {"scale": 1.0}), (found, {"unit": "rad"})])
    assert row_of(rows_of(back, listed), "gyro_x").scale == 1.0
    found = row_of(rows_of(back, listed), "stick")
    assert (found.unit, found.scale) == ("rad", -2.0)
    swapped = edited(text, [(p, {"variable": "q"}), (q, {"variable": "p"})])
    assert row_of(rows_of(swapped, listed), "gyro_x").variable == "q"


def test_each_variable_offers_units_of_its_kind() -> None:
    for name, units in units_of().items():
        kind = "a time" if name.startswith("pwm_") else UNITS[VARIABLES[name].unit].kind
        assert {UNITS[unit].kind for unit in units} == {kind}, name
        assert columns.meaning(name).startswith(f"{name}: ")


def test_the_gate() -> None:
    gate = server.Gate(None, "secret", 5010)
    own = "http://127.0.0.1:5010"
    for path, host, origins, passes in (
        ("/secret/", "127.0.0.1:5010", [], True),
        ("/secret/ws?x=/y", "localhost:5010", ["http://localhost:5010"], True),
        ("/secret", "127.0.0.1:5010", [own], True),
        ("/secret/", "127.0.0.1:5011", [], False),
        ("/secret/", "127.0.0.1", [], False),
        ("/secret/", "evil.example:5010", [], False),
        ("/secret/", "", [], False),
        *(("/secret/", "127.0.0.1:5010", [origin], False)
          for origin in ("http://evil.example", "http://127.0.0.1:5011", "null", "https://127.0.0.1:5010")),
        ("/secret/", "127.0.0.1:5010", [own, "http://evil.example"], False),
        *((path, "127.0.0.1:5010", [], False)
          for path in ("/", "", "/ws", "/Secret/", "/secre/", "/x/secret/", "//secret/", "/?/secret/", "*")),
    ):  # fmt: skip
        headers = httputil.HTTPHeaders({"Host": host} if host else {})
        for origin in origins:
            headers.add("Origin", origin)
        assert (gate.refusal(path, headers) == "") == passes, (path, host, origins)


def test_odd_addresses_and_the_policy_of_files() -> None:
    for path in (
        "files/../../x", "files/%2e%2e/x", "files/..%2fx", "files//etc/passwd", "files/%2fetc/passwd",
        "files/./app.toml", "files/a%00b", "files/a%0ab", "files/%ff%fe", "files/" + "a" * 5000, "files/..%5c..%5cx",
        "upload//?name=x", "../upload?name=x", "upload?name=%ff%fe", "upload?name=x&into=%ff",
    ):  # fmt: skip
        assert server.odd(f"/secret/{path}"), path
    for path in ("", "files/a.html", "files/runs/001/report.html", "upload?name=a.ulg&into=x", "ws"):
        assert server.odd(f"/secret/{path}") == "", path
    sandbox, *others = server.FILE_POLICY.split("; ")
    assert sandbox.split() == ["sandbox", "allow-scripts", "allow-downloads"], "a page reaches not the app"
    assert {"connect-src 'none'", "form-action 'none'", "base-uri 'none'"} <= set(others)


def test_a_step_of_the_app_is_stopped_at_once(tmp_path: Path) -> None:
    from stoop_app.steps import start

    step = start(tmp_path, "designs", lambda name: ["design", "quad-x", "-o", f"{name}/design.toml"])
    step.stop()
    while step.running:
        time.sleep(0.05)
    assert step.error == "stopped before there was a result"


def test_the_app_writes_the_switches_that_give_the_checked_decisions() -> None:
    from stoop_app.fit_view import switches

    default = Strategy.default()
    for chosen in (default, Strategy.textbook(), default.without("bounds").including("extensions")):
        words = switches({one.name: one.name in chosen.names for one in DECISIONS})
        assert switched(" ".join(words)).names == chosen.names, words
