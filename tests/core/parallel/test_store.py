"""A store takes what is its own, refuses everything else in one line, and destroys nothing."""

import os
import re
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from stoop.errors import OutputError, StoopError
from stoop.parallel import CampaignError, Plan, Run
from stoop.parallel import store as room
from stoop.parallel.store import Store, forget, open_store

HERE = {"numpy": "2.1", "processor": "zen"}
PLAN = Plan("p", {"seed": 1}, tuple(Run(f"{i:03d}", "m:f", {"i": i}) for i in range(100)))


def fill(path: Path, count: int = 50) -> bytes:
    with open_store(path, PLAN, HERE) as store:
        store.add(PLAN.runs[:count], [f'"{i} {"x" * 200}"' for i in range(count)])
    return path.read_bytes()


def look(path: Path, plan: Plan = PLAN, environment: dict[str, str] | None = None) -> dict[str, str]:
    with open_store(path, plan, environment or HERE) as store:
        return store.results(plan.runs)


def change(path: Path, statement: str, *values: str) -> None:
    with closing(sqlite3.connect(path)) as other, other:
        other.execute(statement, values)


def refused(path: Path, what: str, plan: Plan = PLAN, environment: dict[str, str] | None = None) -> None:
    """Expect one line that begins with the path, and the file as it was."""
    before = path.read_bytes()
    with pytest.raises(StoopError, match=f"^{re.escape(str(path))}: .*{what}") as caught:
        look(path, plan, environment)
    assert "\n" not in "".join(map(str, caught.value.args))
    assert path.read_bytes() == before


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new folder" / "runs.sqlite"


def interrupt(connection: sqlite3.Connection) -> None:
    with connection:
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("INSERT INTO runs VALUES ('003', '', '', '')")
        raise KeyboardInterrupt


def test_what_is_committed_is_there_and_nothing_else(path: Path) -> None:
    fill(path, 3)
    with open_store(path, PLAN, HERE) as store:
        assert [run.key for run in store.missing(PLAN.runs[:5])] == ["003", "004"]
        with pytest.raises(KeyboardInterrupt):
            interrupt(store._connection)
        assert list(store.results(PLAN.runs)) == ["000", "001", "002"]
        store.add(PLAN.runs[2:4], ['"again"', '"new"'])
        assert store.results(PLAN.runs[2:])["002"].startswith('"2 x')
        with pytest.raises(OutputError, match="run 003 was made with other arguments"):
            store.missing([Run("003", "m:f", {"i": 99})])
    assert list(path.parent.iterdir()) == [path], "one file"


def test_another_plan_setting_or_environment(path: Path) -> None:
    fill(path)
    refused(path, "holds the runs of p, not of q", Plan("q", {"seed": 1}, ()))
    refused(path, r"other settings \(seed: 1, now 2\)", Plan("p", {"seed": 2}, ()))
    refused(path, r"other settings \(pr: absent, now 0.9\)", Plan("p", {"seed": 1, "pr": 0.9}, ()))
    refused(path, r"another environment \(numpy 2.2 here, 2.1 there\)", PLAN, {**HERE, "numpy": "2.2"})
    skylake = {**HERE, "processor": "skylake"}
    refused(path, r"another environment \(processor .*name another file", PLAN, skylake)
    with pytest.raises(CampaignError, match="plan p: settings"):
        look(path, Plan("p", {"a": (1, 2)}, ()))  # type: ignore[dict-item]
    assert look(path, PLAN, {**HERE, "cma": "4.0"}), "installed since, it counts from then on"
    assert look(path, PLAN, HERE)
    refused(path, "cma 4.1 here, 4.0 there", PLAN, {**HERE, "cma": "4.1"})


def test_another_version_of_the_schema(path: Path) -> None:
    """Which may keep other things."""
    fill(path)
    later = "stoop-campaign/2"
    seal = room._seal("schema", later)
    change(path, "UPDATE meta SET value = ?, checksum = ? WHERE name = 'schema'", later, seal)
    for more in ("DELETE FROM meta WHERE name <> 'schema'", "DROP TABLE runs"):
        refused(path, f"a store of another version \\({later}, not {room.SCHEMA}\\); name another file")
        change(path, more)
    refused(path, f"a store of another version \\({later}, not {room.SCHEMA}\\); name another file")


def test_a_second_driver(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_PATIENCE", 0.01)
    fill(path)
    with open_store(path, PLAN, HERE):
        with pytest.raises(OutputError, match="in use by another process"):
            look(path)
        with pytest.raises(OutputError, match="cannot be removed: in use by another process"):
            forget(path)
    assert len(look(path)) == 50


def test_another_file(path: Path) -> None:
    path.parent.mkdir()
    head = b"SQLite format 3\0"
    for content in (b"x", b"key,value\n" * 500, head, head * 500, bytes(4096)):
        path.write_bytes(content)
        refused(path, "another file")
    path.write_bytes(b"")  # a store that was never begun
    assert look(path) == {}
    path.unlink()
    change(path, "CREATE TABLE runs (key TEXT)")
    refused(path, "is no store of a campaign")


def test_truncated_anywhere(path: Path) -> None:
    whole = fill(path)
    for length in [*range(1, len(whole), 1997), len(whole) - 1]:
        path.write_bytes(whole[:length])
        refused(path, "another file")


def test_a_flipped_byte_is_refused_or_does_no_harm(path: Path) -> None:
    """Bytes in free space and counters do no harm; every other one is noticed."""
    whole = fill(path, 20)
    sound, noticed = look(path), 0
    for position in range(0, len(whole), 211):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 0x55]) + whole[position + 1 :])
        try:
            assert look(path) == sound
        except OutputError:
            noticed += 1
    assert noticed > 10


def test_what_was_changed_is_refused(path: Path) -> None:
    settings = "UPDATE meta SET value = ?, checksum = ? WHERE name = 'settings'"
    result = "UPDATE runs SET result = ?, checksum = ? WHERE key = '001'"
    key = ("001", PLAN.runs[1].identity)
    for told, statement, *values in (
        ("run 007 does not fit its checksum", "UPDATE runs SET result = '1' WHERE key = '007'"),
        ("run 008 does not fit its checksum", "UPDATE runs SET checksum = '' WHERE key = '008'"),
        ("", "DELETE FROM meta WHERE name = 'plan'"),
        ("", "UPDATE meta SET value = '{}'"),
        ("", "DROP TABLE meta"),
        ("damaged; restore a copy", "DROP TABLE runs"),
        ("damaged; restore a copy", "ALTER TABLE runs RENAME COLUMN result TO found"),
        *(("holds something else than JSON: damaged", result, x, room._seal(*key, x)) for x in ("{", "", "[" * 100_000)),
        *(("holds something else than JSON: damaged", settings, x, room._seal("settings", x)) for x in ("{", "")),
    ):  # fmt: skip
        fill(path, 10)
        change(path, statement, *values)
        refused(path, told)
        path.unlink()


def test_a_store_with_no_runs_pins_nothing(path: Path) -> None:
    fill(path, 0)
    other = Plan("q", {"seed": 2}, PLAN.runs)
    assert look(path, other, {"numpy": "2.2"}) == {}
    with open_store(path, other, {"numpy": "2.2"}) as store:
        store.add(other.runs[:1], ["1"])
    refused(path, "holds the runs of q, not of p")
    refused(path, "numpy 2.1 here, 2.2 there", other)


def test_forgetting_a_store(path: Path) -> None:
    forget(path)
    fill(path)
    link = path.with_name("link.sqlite")
    link.symlink_to(path)
    forget(link)
    assert not path.exists()
    path.touch()
    forget(path)
    assert not path.exists()
    path.mkdir()
    with pytest.raises(OutputError, match="is no store"):
        forget(path)
    path.rmdir()


def test_forgetting_nothing_of_other_programs(path: Path) -> None:
    path.parent.mkdir()
    for content in (
        "x", "SQLite format 3\0", "SQLite format 3\0" * 99,
        ("CREATE TABLE thesis (chapter TEXT)", "INSERT INTO thesis VALUES ('one')"),
        ("PRAGMA application_id = 252006675", "CREATE TABLE maps (tile BLOB)"),
    ):  # fmt: skip
        if isinstance(content, str):
            path.write_text(content)
        else:
            for statement in content:
                change(path, statement)
        before = path.read_bytes()
        with pytest.raises(OutputError, match=f"^{re.escape(str(path))}: .*is no store of a campaign"):
            forget(path)
        assert path.read_bytes() == before
        path.unlink()


def test_a_place_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    for where in ("file/runs.sqlite", "folder", "/proc/runs.sqlite"):
        with pytest.raises(OutputError, match="choose another"):
            look(tmp_path / where)


def test_a_full_disk_costs_what_was_not_committed(path: Path) -> None:
    def add_all(store: Store) -> None:
        for run in PLAN.runs[50:]:
            store.add([run], [f'"{os.urandom(500).hex()}"'])
            added.append(run.key)

    fill(path)
    added: list[str] = []
    with open_store(path, PLAN, HERE) as store:
        (pages,) = store._connection.execute("PRAGMA page_count").fetchone()
        store._connection.execute(f"PRAGMA max_page_count = {pages + 2}")
        with pytest.raises(OutputError, match=r"what is done is safe: .* start the same command again"):
            add_all(store)
    assert added
    assert list(look(path)) == [f"{i:03d}" for i in range(50)] + added
    fill(path, 100)
