"""The store: one SQLite file with the results of a campaign, safe against interruption.

One process writes, and holds the lock of the file as long as it works; the lock ends with the process, however it
ends. Each task is one transaction with ``synchronous=FULL``: after a kill or a power cut it is there whole, or not at all.
Every row has a checksum. A file that is not fit is refused and left as it is.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final

from stoop.errors import OutputError
from stoop.parallel.plan import Json, Plan, Run, from_text, to_text
from stoop.parallel.worker import differences

SCHEMA: Final = "stoop-campaign/1"
APPLICATION: Final = 0x73746F6F  #: "stoo", where SQLite keeps the name of a file's owner
MAX_BYTES: Final = 2**27  #: of one result
_PATIENCE = 2.0  #: s to wait for a lock: that of a driver just killed is about to go
_TABLES: Final = (
    "CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL, checksum TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE runs (key TEXT PRIMARY KEY, identity TEXT NOT NULL, result TEXT NOT NULL, checksum TEXT NOT NULL) "
    "WITHOUT ROWID",
    f"PRAGMA application_id = {APPLICATION}",
)
_SAFE = "what is done is safe"
_DAMAGED = "damaged; restore a copy, or name another file to start anew"
_FOREIGN = "is no store of a campaign, or a damaged one; it is left as it is: name another file"
_KEPT = "is no store of a campaign, and is not removed; move it away, or choose another folder"
_BUSY = "in use by another process (the same command, started twice?); wait until it ends, or stop it"
_MESSAGES: Final = {
    "SQLITE_BUSY": _BUSY,
    "SQLITE_LOCKED": _BUSY,
    "SQLITE_FULL": f"the disk is full; {_SAFE}: free space and start the same command again",
    "SQLITE_IOERR": f"cannot be read or written (full disk, quota, or a failing one); {_SAFE}: correct that and start the same "
    "command again",
    "SQLITE_NOTADB": _FOREIGN,
    "SQLITE_CORRUPT": _DAMAGED,
    "SQLITE_ERROR": _DAMAGED,  # our statements are sound: a table or a column is not there
    "SQLITE_READONLY": "cannot be written; make it writable, or choose another folder",
    "SQLITE_CANTOPEN": "cannot be opened for writing; make its folder writable, or choose another",
}  #: beginning of SQLite's name of an error -> message


class Store:
    """An open store; see :func:`open_store`."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection, self._path = connection, path
        self.identities: dict[str, str] = {}
        for key, identity, result in self._rows():
            _read(result, path)
            self.identities[key] = identity

    def _rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield key, identity and result of each run, whose checksum is verified."""
        for row in self._connection.execute("SELECT key, identity, result, checksum FROM runs"):
            if _seal(*row[:3]) != row[3]:
                raise OutputError(f"{self._path}: run {row[0]} does not fit its checksum: {_DAMAGED}")
            yield row[:3]

    def missing(self, runs: Sequence[Run]) -> list[Run]:
        """Return the runs that are not here; OutputError for one that is, but with other arguments."""
        for run in runs:
            if self.identities.get(run.key, run.identity) != run.identity:
                problem = "was made with other arguments; name another file to start anew"
                raise OutputError(f"{self._path}: run {run.key} {problem}")
        return [run for run in runs if run.key not in self.identities]

    def add(self, runs: Sequence[Run], results: Sequence[str]) -> None:
        """Commit the results of some runs, all or none; those that are here already stay.

        OutputError when the file cannot be written; everything before is safe.
        """
        parts = [(run.key, run.identity, result) for run, result in zip(runs, results, strict=True)]
        rows = [(*part, _seal(*part)) for part in parts]
        with _explained(self._path), self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            self._connection.executemany("INSERT OR IGNORE INTO runs VALUES (?, ?, ?, ?)", rows)
        self.identities.update({run.key: run.identity for run in runs})

    def results(self, runs: Sequence[Run]) -> dict[str, str]:
        """Return the canonical text of each run's result, sorted by key."""
        wanted = {run.key for run in runs}
        with _explained(self._path):
            return {key: result for key, _, result in sorted(self._rows()) if key in wanted}


def _read(text: str, path: Path) -> Json:
    """Return the value of a text in a store: a checksum that fits does not make it JSON."""
    try:
        return from_text(text)
    except (ValueError, TypeError, RecursionError):
        raise OutputError(f"{path}: holds something else than JSON: {_DAMAGED}") from None


def _seal(*parts: str) -> str:
    return hashlib.sha256("\0".join(map(str, parts)).encode("utf-8", "surrogatepass")).hexdigest()


@contextmanager
def open_store(path: Path, plan: Plan, environment: Mapping[str, str]) -> Iterator[Store]:
    """Open the store of a plan, or make it; nobody else can until it is closed.

    `environment` is that of :func:`stoop.parallel.environment`, with the sources of the work functions.

    Raises
    ------
    OutputError
        Of another plan, other settings or another environment; in use; damaged; no store at all; or the folder cannot be
        written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = f"its folder cannot be made ({error.strerror or error}); choose another"
        raise OutputError(f"{path}: {problem}") from None
    if _is_truncated(path):
        raise OutputError(f"{path}: {_FOREIGN}")
    with (
        _explained(path),
        closing(sqlite3.connect(path.resolve(), timeout=_PATIENCE, isolation_level=None)) as connection,
    ):
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BYTES)
        connection.execute("PRAGMA synchronous = FULL")
        # the lock stays from one transaction to the next
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        with connection:  # committed, or rolled back
            connection.execute("BEGIN EXCLUSIVE")
            if _is_foreign(connection):
                raise OutputError(f"{path}: {_FOREIGN}")
            kinds = {kind for (kind,) in connection.execute("SELECT type FROM sqlite_master")}
            if kinds & {"view", "trigger"}:  # a store has none: a view may be without end, a trigger delete
                raise OutputError(f"{path}: {_DAMAGED}")
            meta = {
                "schema": SCHEMA,
                "plan": plan.name,
                "settings": to_text(dict(plan.settings), f"plan {plan.name}: settings"),
                "environment": to_text(dict(environment), "environment"),
            }
            if not kinds:
                for statement in _TABLES:
                    connection.execute(statement)
                _write_meta(connection, meta)
            elif connection.execute("PRAGMA integrity_check").fetchall() != [("ok",)]:
                raise OutputError(f"{path}: {_DAMAGED}")
            else:
                _check_meta(connection, path, meta, environment)
            store = Store(connection, path)
        yield store


def forget(path: Path) -> None:
    """Remove a store of a campaign that nobody uses; nothing where there is none.

    OutputError when it is another program's file, in use, damaged, or cannot be removed; it is left as it is.
    """
    file = path.resolve()
    if not file.exists():
        return
    if not file.is_file() or _is_truncated(file):
        raise OutputError(f"{path}: {_KEPT}")
    with (
        _explained(path, "cannot be removed: "),
        closing(sqlite3.connect(file, timeout=0.0, isolation_level=None)) as connection,
    ):
        connection.execute("BEGIN EXCLUSIVE")
        if _is_foreign(connection):
            raise OutputError(f"{path}: {_KEPT}")
        try:  # while nobody else can begin to write; there is nothing to commit
            file.unlink()
            file.with_name(f"{file.name}-journal").unlink(missing_ok=True)
        except OSError as error:
            problem = f"cannot be removed ({error.strerror or error}); choose another folder"
            raise OutputError(f"{path}: {problem}") from None


def _is_foreign(connection: sqlite3.Connection) -> bool:
    """Return whether a file is another program's; one without tables and owner is a store that was never begun."""
    (owner,) = connection.execute("PRAGMA application_id").fetchone()
    (count,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    return bool(owner != APPLICATION and (owner or count))


def _is_truncated(path: Path) -> bool:
    """Return whether SQLite would take a file for an empty one and write over it: the shortest with content has 512 bytes.

    The file is not opened for this: closing it would drop the locks that this process may hold on it.
    """
    with suppress(OSError):
        short = path.is_file() and 0 < path.stat().st_size < 512
        return short and not path.with_name(f"{path.name}-journal").exists()
    return False


@contextmanager
def _explained(path: Path, failed: str = "") -> Iterator[None]:
    """Turn SQLite's errors into one line; `failed` begins it."""
    try:
        yield
    except UnicodeDecodeError as error:
        raise OutputError(f"{path}: {failed}{_DAMAGED}") from error
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "")
        message = next((m for start, m in _MESSAGES.items() if name.startswith(start)), f"{error}; {_SAFE}")
        raise OutputError(f"{path}: {failed}{message}") from error


def _write_meta(connection: sqlite3.Connection, meta: Mapping[str, str]) -> None:
    rows = [(name, value, _seal(name, value)) for name, value in meta.items()]
    connection.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?, ?)", rows)


def _check_meta(
    connection: sqlite3.Connection, path: Path, here: Mapping[str, str], environment: Mapping[str, str]
) -> None:
    """Refuse a store of another schema, plan, settings or environment; add libraries that have been installed since."""
    rows = connection.execute("SELECT name, value, checksum FROM meta").fetchall()
    there = {name: value for name, value, _ in rows}
    if any(_seal(name, value) != checksum for name, value, checksum in rows) or "schema" not in there:
        raise OutputError(f"{path}: {_DAMAGED}")
    if there["schema"] != SCHEMA:  # another one may have other entries
        raise OutputError(
            f"{path}: a store of another version ({_cut(there['schema'])}, not {SCHEMA}); name another file"
        )
    if set(there) != set(here):
        raise OutputError(f"{path}: {_DAMAGED}")
    if connection.execute("SELECT 1 FROM runs LIMIT 1").fetchone() is None:
        _write_meta(connection, here)  # nothing was done for the earlier plan
        return
    if there["plan"] != here["plan"]:
        raise OutputError(
            f"{path}: holds the runs of {there['plan']}, not of {here['plan']}; name another file"
        )
    values = [{k: _read(x[k], path) for k in ("settings", "environment")} for x in (here, there)]
    objects = [{k: v if isinstance(v, dict) else {} for k, v in x.items()} for x in values]
    if there["settings"] != here["settings"]:
        ours, theirs = ({k: to_text(v, k) for k, v in x["settings"].items()} for x in objects)
        name = min(n for n in {*ours, *theirs} if ours.get(n) != theirs.get(n))
        raise OutputError(
            f"{path}: made with other settings ({name}: {_cut(theirs.get(name))}, now {_cut(ours.get(name))}); "
            "give the same again, or begin a new store in another folder"
        )
    kept = {name: str(value) for name, value in objects[1]["environment"].items()}
    if unlike := differences(environment, kept):
        raise OutputError(
            f"{path}: made in another environment ({unlike}): the rest would not fit what is there to the last bit; "
            "name another file to start anew"
        )
    _write_meta(connection, {"environment": to_text({**kept, **environment}, "environment")})


def _cut(text: str | None) -> str:
    if text is None:
        return "absent"
    return text if len(text) <= 40 else f"{text[:40]}..."
