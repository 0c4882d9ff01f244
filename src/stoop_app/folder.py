"""The project's folder: ordinary files of stoop, and the steps that made them. What the app shows is read from here."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import tomlkit

from stoop.extend.errors import LogError, OutputError, StoopError
from stoop.extend.files import toml, write_file
from stoop.extend.flights import FlightMapping, flight_name
from stoop.extend.recordings import kind as log_kind
from stoop.extend.recordings import mapping_beside
from stoop.extend.vehicles import parse_vehicle
from stoop_app import steps
from stoop_app.places import bytes_of, document_of, inside, recalled, remember, resolved, text_of
from stoop_app.steps import Step
from stoop_plan.input_design.windows_file import Entry, read_windows, written
from stoop_tune.control_laws.parameters import ENDINGS

FILE: Final = "app.toml"  #: names the log
VEHICLE, WINDOWS, MAPPING = "vehicle.toml", "windows.toml", "mapping.toml"
LOOK = "look.html"  #: page of the flight, beside what was read
BEFORE = "before.toml"  #: of corrections: the mapping as it was
#: of a run: the vehicle from which it begins, and how far it is
START, PROGRESS = "start.toml", "progress.json"
STORES: Final = "stores"  #: of fleets, a folder for each
#: of logs of a fleet; tables in the same folder are those of parts and flights
FLEET_LOGS: Final = (".ulg", ".bin", ".log", ".usd", ".bbl", ".bfl", ".bag", ".mcap", ".nc")
OWN_FORMAT: Final = "netcdf"  #: of flights of stoop, which need no mapping
KEPT: Final = re.compile(r"(windows|mapping)-[0-9]{1,9}\.toml")  #: copies of files, beside them
FIT: Final = "stoop identify LOG --vehicle vehicle.toml --maneuver windows.toml -o DIR"


class ChangedError(StoopError):
    """A file was changed by another page since it was read."""


class Project:
    """One log, one vehicle, windows, and the steps."""

    def __init__(self, root: Path) -> None:
        """Take a folder, made if it is not there; raises `OutputError` if it cannot be written."""
        self.root = root.absolute()
        if self.root.exists() and not self.root.is_dir():
            raise OutputError(f"{root}: is a file; name a folder")
        with contextlib.suppress(OSError):
            self.root.mkdir(parents=True, exist_ok=True)
        if not os.access(self.root, os.W_OK):
            raise OutputError(f"{root}: cannot be written; name another folder with --folder")

    # The log.

    @property
    def log(self) -> str:
        """The log as the commands name it; empty where none was chosen."""
        return self._logs()[0]

    @property
    def former(self) -> list[str]:
        """Other logs that were used in this folder, the last one first."""
        return [*reversed(self._logs()[1])]

    def open_log(self, path: str | Path, draft: bool = False) -> None:
        """Take a log, and read it, or draft its mapping, unless that was done; each log has windows and a mapping of its own.

        Raises `StoopError`: there is no such file.
        """
        place = self._located(path)
        target = resolved(place)
        if not target.exists():
            raise StoopError(f"{place}: there is no such log; check the path")
        if not target.is_relative_to(self.root.resolve()):
            remember("log", target)
        name = str(place.relative_to(self.root)) if place.is_relative_to(self.root) else str(place)
        name = f"./{name}" if name.startswith("-") else name  # no option of a command
        known = name in self.former
        self._turn_to(name)
        if draft or self.needs_mapping:
            self.list_columns()
        elif not (known and self.info):
            self.read_log()

    def _located(self, path: str | Path) -> Path:
        """Return where a log, or a folder of logs, is."""
        try:
            return Path(self.root, Path(path).expanduser()).absolute()
        except RuntimeError:  # a user whom nobody knows
            raise StoopError(f"{path}: there is no such log; check the path") from None

    def _logs(self) -> tuple[str, dict[str, dict[str, str]]]:
        """Return the log, and of each former one where its windows and mapping are kept."""
        found = toml.parse_source(text_of(self.root, FILE), FILE, OutputError)
        log, former = found.get("log", ""), found.get("former", {})
        names = [log, *former] if isinstance(former, dict) else [None]
        if not all(isinstance(n, str) and not n.startswith("-") and "\0" not in n for n in names):
            raise OutputError(f"{FILE}: a log in it is no path; mend or remove {FILE}")
        for kept in former.values():
            pairs = kept.items() if isinstance(kept, dict) else [("", "")]
            if not all(
                isinstance(k, str) and KEPT.fullmatch(k) and f in (WINDOWS, MAPPING) for f, k in pairs
            ):
                raise OutputError(
                    f"{FILE}: [former] names a file other than copies of {WINDOWS} and {MAPPING}; mend or remove {FILE}"
                )
        return log, former

    def _place(self, name: str) -> Path:
        """Return a place in the folder; raises `OutputError` where it leads outside."""
        return inside(self.root, name)

    def _check_places(self) -> None:
        """Raise `OutputError` where a file that the app or its commands read leads outside the folder."""
        for name in (FILE, VEHICLE, WINDOWS, MAPPING):
            self._place(name)

    @property
    def log_file(self) -> Path:
        """Path of the log; raises `OutputError`: it lies outside the folder, and the person has not opened it."""
        path = self.root / self.log
        target = resolved(path)
        if not target.is_relative_to(self.root.resolve()) and recalled("log", target) is None:
            raise OutputError(
                f"{path}: lies outside this folder, and you have not opened it; open it by its path first"
            )
        return path

    def _turn_to(self, name: str, keep: bool = True) -> None:
        """Put a log in the place of the present one, which is kept among the former ones with its windows and mapping."""
        log, former = self._logs()
        if log and log != name:
            held = [file for file in (WINDOWS, MAPPING) if self._place(file).exists()]
            copies = {file: self._keep_copy(file) for file in held}
            former |= {log: copies} if keep else {}
            for file in held:
                (self.root / file).unlink()
        for file, kept in former.pop(name, {}).items():
            with contextlib.suppress(FileNotFoundError):
                self._place(kept).replace(self._place(file))
        lead = "# what stoop app shows in this folder\n"
        write_file(self._place(FILE), lead + tomlkit.dumps({"log": name, "former": former}))

    @property
    def needs_mapping(self) -> bool:
        """Whether the columns of the log have no known meaning, and nobody has given it."""
        path = self.log_file
        if self._place(MAPPING).exists() or mapping_beside(path).is_file() or path.is_dir():
            return False
        with contextlib.suppress(OSError):
            return log_kind(path) not in (*FlightMapping.READY, OWN_FORMAT)
        return False

    @property
    def source(self) -> list[str]:
        """The words by which a command reads the log."""
        own = ["--mapping", MAPPING] if self._place(MAPPING).exists() else []
        _ = self.log_file  # refuses one that the person has not opened
        return [self.log, *own]

    @property
    def readings(self) -> list[Step]:
        """The steps that read a log or draft its mapping, the oldest first."""
        found = [*self.steps("map"), *self.steps("info")]
        return sorted(found, key=lambda s: modified(s.file(steps.COMMAND)))

    @property
    def reading(self) -> Step | None:
        """The last step that read the present log; else the one that drafts its mapping."""
        log = self.log
        own = [s for s in reversed(self.readings) if log_of(s) == log]
        return next((s for s in own if s.kind == "info"), next(iter(own), None))

    @property
    def flight(self) -> Step | None:
        """The step that has read the present log; None where its last reading has not ended well."""
        step = self.reading
        return step if step is not None and (step.kind, step.state) == ("info", "done") else None

    @property
    def refused(self) -> Step | None:
        """The last reading, where it is of another log and failed: that log was not taken."""
        step = next(reversed(self.readings), None)
        return step if step is not None and log_of(step) != self.log and step.state == "failed" else None

    def list_columns(self) -> Step:
        """List the columns of the log, and draft its mapping."""
        log = str(self.source[0])
        return self.start("map", lambda at: ["map", log, "--json", "-o", f"{at}/{MAPPING}"])

    @property
    def listing(self) -> Step | None:
        """The last step that lists the columns of the present log."""
        own = [s for s in self.steps("map") if log_of(s) == self.log and "--json" in s.words]
        return next(reversed(own), None)

    @property
    def mapping(self) -> str:
        """Text of the mapping by which the log is read: the folder's, or the one beside the log; empty where it needs none."""
        beside = mapping_beside(self.log_file)
        own = text_of(self.root, MAPPING)
        return own if own or not beside.is_file() else toml.read_source(beside, "mapping", LogError)

    def save_mapping(self, text: str, before: str) -> None:
        """Keep a mapping, and read the log by it; raises as `save_vehicle`."""
        if self.mapping:
            _check_unchanged(MAPPING, self.mapping, before)
        self.take_mapping(text)

    def take_mapping(self, text: str) -> None:
        """Keep a mapping, and read the log by it."""
        write_file(self._place(MAPPING), text)
        self.read_log()

    def correct_mapping(self) -> Step:
        """Apply to the mapping what its checks advise."""
        text, log = self.mapping, str(self.source[0])
        if not self._place(MAPPING).exists():
            write_file(self._place(MAPPING), text)
        words = ["map", log, "--apply", MAPPING, "--json", "-o"]
        return self.start("corrections", lambda at: [*words, f"{at}/{MAPPING}"], {BEFORE: text})

    @property
    def corrections(self) -> Step | None:
        """The last corrections of the mapping of the present log."""
        return next((s for s in reversed(self.steps("corrections")) if log_of(s) == self.log), None)

    def read_log(self) -> Step:
        """Read the log; the step keeps a copy of the mapping."""
        words, text = ["info", *self.source, "--json", "--save"], self.mapping
        inputs = {MAPPING: text} if text else {}
        return self.start("info", lambda at: [*words, f"{at}/flight.nc", "-o", f"{at}/{LOOK}"], inputs)

    def _follow_mapping(self) -> None:
        """Take corrections that are done, unless the mapping was changed since; read the log by a mapping that was changed."""
        read, step = self.reading, self.corrections
        if read is None or read.running:
            return
        text = self.mapping
        done = step is not None and step.state == "done" and step.text(BEFORE) == text != step.text(MAPPING)
        if step is not None and done and modified(self._place(MAPPING)) <= modified(step.file(steps.COMMAND)):
            self.take_mapping(step.text(MAPPING))  # the file was not written since they began
        elif read.kind == "info" and read.text(MAPPING) != text:
            self.read_log()

    @property
    def info(self) -> dict[str, Any]:
        """What `stoop info` found in the log; empty where it has not."""
        step = self.flight
        return {} if step is None else document_of(step.folder, steps.OUTPUT)

    @property
    def flight_name(self) -> str:
        """Name of the flight in windows."""
        return flight_name(Path(self.log))

    # The vehicle.

    @property
    def vehicle(self) -> str:
        """Text of the vehicle file; empty where there is none."""
        return text_of(self.root, VEHICLE)

    def save_vehicle(self, text: str, before: str | None) -> None:
        """Keep a vehicle.

        Raises
        ------
        ChangedError
            The file is not the one from which the change began, ``before`` its `version`; None replaces any.
        OutputError
            It cannot be written.
        """
        if before is not None:
            _check_unchanged(VEHICLE, self.vehicle, before)
        write_file(self._place(VEHICLE), text)

    def take_vehicle(self, text: str) -> None:
        """Use another vehicle; the one that was there is kept under another name."""
        self._keep_copy(VEHICLE)
        write_file(self._place(VEHICLE), text)

    # The parameters of an autopilot.

    def take_parameters(self, name: str, content: bytes) -> None:
        """Keep a file of parameters; one of that name is kept under another."""
        if Path(name).suffix.lower() not in ENDINGS:
            raise StoopError(f"{name}: a file of parameters ends in {', '.join(sorted(ENDINGS))}")
        self._keep_copy(name)
        write_file(self._place(name), content)

    # The windows.

    @property
    def windows(self) -> tuple[Entry, ...]:
        """The windows; raises `StoopError` for a file that was edited and cannot be read."""
        place = self._place(WINDOWS)
        return read_windows(place) if place.exists() else ()

    def save_windows(self, entries: Sequence[Entry]) -> None:
        """Keep windows, in the order of time."""
        ordered = sorted(entries, key=lambda e: (e.flight, e.start))
        write_file(self._place(WINDOWS), written(ordered, FIT))

    def propose_windows(self) -> Step:
        """Select windows by their information for the vehicle."""
        words = ["maneuvers", *self.source, "--vehicle", VEHICLE, "-o"]
        return self.start("maneuvers", lambda at: [*words, at])

    def take_proposal(self, step: Step) -> None:
        """Use proposed windows; those that were there are kept under another name."""
        self._keep_copy(WINDOWS)
        write_file(self._place(WINDOWS), step.text(WINDOWS))

    def tend(self) -> None:
        """Use the first proposal of windows where nobody has chosen any, follow the mapping, leave a log that cannot be read."""
        self._check_places()
        own = [s.state for s in self.readings if log_of(s) == self.log]
        unread = own[-1:] == ["failed"] and "done" not in own
        if unread and self.former and not self._place(MAPPING).exists():
            self._turn_to(self.former[0], keep=False)
        self._follow_mapping()
        step = self.latest("maneuvers")
        if step is not None and not self._place(WINDOWS).exists() and step.state == "done":
            self.take_proposal(step)

    # The fleet.

    def open(self, path: Path) -> bool:
        """Look for changes in a folder of logs, or take a log; return whether it is such a folder. Raises as both do."""
        is_fleet = bool(fleet_logs(self._located(path)))
        if is_fleet:
            self.open_fleet(path)
        else:
            self.open_log(path)
        return is_fleet

    def open_fleet(self, path: Path) -> Step:
        """Look for changes in a folder of logs, with the tables of parts and flights in it; raises `StoopError`: it has none."""
        logs = fleet_logs(place := self._located(path))
        if not logs:
            raise StoopError(f"{place}: is no folder of logs ({', '.join(FLEET_LOGS)}); check the path")
        found = [word for table in ("parts", "flights") if (own := place / f"{table}.csv").is_file()
                 for word in (f"--{table}", str(own))]  # fmt: skip
        vehicle = ["--vehicle", VEHICLE] if self.vehicle else []
        self._place(STORES)
        words = ["fleet", *map(str, logs), *found, *vehicle, "-o", store_of(place)]
        return self.start("fleets", lambda at: words)

    # The runs.

    @property
    def lacking(self) -> str:
        """What a fit lacks, in words; empty where it can be run."""
        try:
            if not self.log:
                return "Open a log first"
            if not self.info:
                return "The log is not read yet"
            if not self.vehicle:
                return "Choose a vehicle first"
            parse_vehicle(self.vehicle, VEHICLE)
            fitted = any(e.accept and e.use == "fit" for e in self.windows)
        except StoopError as error:
            return str(error)
        return "" if fitted else "Choose a window to fit first"

    def identify(self, options: Sequence[str] = ()) -> Step:
        """Start a fit with the vehicle and the windows as they are now, of which the run keeps copies."""
        inputs = {START: self.vehicle, WINDOWS: written([e for e in self.windows if e.accept], FIT)}

        def words(at: str) -> list[str]:
            files = ["--vehicle", f"{at}/{START}", "--maneuver", f"{at}/{WINDOWS}"]
            return ["identify", *self.source, *files, *options, "-o", at, "--progress", f"{at}/{PROGRESS}"]

        return self.start("runs", words, inputs)

    def start(self, kind: str, words: Any, inputs: dict[str, str] | None = None) -> Step:
        """Start a step, see `steps.start`; refused where a file that commands read leads outside the folder."""
        self._check_places()
        return steps.start(self.root, kind, words, inputs)

    def steps(self, kind: str) -> list[Step]:
        """Return the steps of a kind, the oldest first."""
        return steps.steps(self.root, kind)

    def latest(self, kind: str) -> Step | None:
        """Return the last step of a kind."""
        return next(reversed(self.steps(kind)), None)

    @property
    def signature(self) -> tuple[Any, ...]:
        """What changes whenever the page has something else to show, except within a running step."""
        own = (FILE, VEHICLE, WINDOWS, MAPPING)
        times = tuple(modified(self.root / name) for name in own)
        return times, tuple((s.name, s.state) for kind in steps.PRODUCTS for s in self.steps(kind))

    def _keep_copy(self, name: str) -> str:
        """Keep a file, if there is one, under another name before it is replaced; return that name."""
        stem, ending = Path(name).stem, Path(name).suffix
        names = (f"{stem}-{n}{ending}" for n in itertools.count(1))
        kept = next(other for other in names if not os.path.lexists(self.root / other))
        if self._place(name).exists():
            write_file(self.root / kept, bytes_of(self.root, name))
        return kept


def log_of(step: Step) -> str:
    """Return the log that a step reads."""
    return next(iter(step.words[2:]), "")


def fleet_logs(folder: Path) -> list[Path]:
    """Return the logs of a folder; none of one that is a log itself, such as a ROS bag."""
    if not folder.is_dir() or log_kind(folder) == "rosbag":
        return []
    return sorted(p for p in folder.iterdir() if p.name.lower().endswith(FLEET_LOGS))


def source_of(step: Step) -> Path:
    """Return the folder of the logs of a fleet."""
    return Path(log_of(step)).parent


def store_of(logs: Path) -> str:
    """Return where in the project's folder the store of a fleet is, by the folder of its logs."""
    return f"{STORES}/{logs.name}-{hashlib.sha256(str(logs).encode()).hexdigest()[:8]}"


def _check_unchanged(name: str, text: str, before: str) -> None:
    """Raise `ChangedError` where a file is not the one from which a change began, by its `version`."""
    if before != version(text):
        raise ChangedError(
            f"{name} was changed in another tab or editor since this form was filled. Your edits are kept in the form: discard "
            "them to see the other changes, or save again to put yours on top"
        )


def version(text: str) -> str:
    """Return a digest of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def modified(path: Path) -> int:
    """Return when a file was changed, ns; 0 where there is none."""
    with contextlib.suppress(OSError):
        return path.stat().st_mtime_ns
    return 0
