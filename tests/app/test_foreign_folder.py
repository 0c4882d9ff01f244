"""A project's folder that came from someone else: nothing outside it changes, and each bad file is one line on the page."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from stoop.errors import StoopError
from stoop_app.fit_view import FitView
from stoop_app.folder import MAPPING, WINDOWS, Project
from stoop_app.page import Page
from stoop_app.steps import COMMAND

OF_PANEL = ("ignore::PendingDeprecationWarning", "ignore::DeprecationWarning")
pytestmark = [pytest.mark.usefixtures("nothing_starts"), pytest.mark.filterwarnings(*OF_PANEL)]


def snapshot(folder: Path, without: Path) -> dict[Path, object]:
    files = [p for p in folder.rglob("*") if not p.is_relative_to(without)]
    return {p: p.readlink() if p.is_symlink() else p.read_bytes() if p.is_file() else None for p in files}


def surroundings(tmp: Path) -> Path:
    root = tmp / "around" / "project"
    root.mkdir(parents=True)
    (root.parent / "victim.txt").write_text("precious")
    (root.parent / "other.csv").write_text("time_s,p\n0,1\n1,2\n")
    (root.parent / "windows-1.toml").write_text("precious")
    (root / "log.csv").write_text("time_s,p\n0,1\n1,2\n")
    return root


def use(root: Path) -> str:
    said = []
    for what in (
        Page, *(lambda project, log=log: project.open_log(log) for log in ("log.csv", root.parent / "other.csv", "log.csv")),
        lambda project: project.take_vehicle("name = 'x'"), Project.read_log, Project.propose_windows,
        lambda project: project.lacking,
    ):  # fmt: skip
        with contextlib.suppress(StoopError):
            if isinstance(found := what(Project(root)), Page):
                for title in found.views:
                    found.go(title)
                    found._refresh(title)
                    found.tick()
                    said += [str(pane.object) for pane in found.views[title].body if hasattr(pane, "object")]
                said.append(found.trouble.object)
    return "\n".join(said)


HOSTILE = {
    "key with ..": '[former."log.csv"]\n"../victim.txt" = "bait.txt"\n',
    "absolute key": '[former."log.csv"]\n"{around}/victim.txt" = "bait.txt"\n',
    "key that makes a file": '[former."log.csv"]\n"../new.txt" = "bait.txt"\n',
    "kept name ..": '[former."log.csv"]\n"windows.toml" = ".."\n',
    "kept path": '[former."log.csv"]\n"windows.toml" = "../windows-1.toml"\n', "a list": 'former = ["log.csv"]\n',
    "a number": "former = 3\n", "a table of numbers": '[former]\n"log.csv" = 3\n',
    "a log that is a table": "log = {a = 1}\n", "an option": 'log = "--save=../victim.txt"\n',
    "a NUL": 'log = "a\\u0000b"\n', "a long log": 'log = "{long}"\n', "nested": "former = " + "[" * 2000 + "]" * 2000,
    "not TOML": 'log = "', "bytes": b"log = '\xff\xfe'",
}  # fmt: skip


def test_a_hostile_app_toml_changes_nothing_outside_the_folder(tmp_path: Path) -> None:
    for i, (kind, text) in enumerate(HOSTILE.items()):
        root = surroundings(tmp_path / str(i))
        (root / "bait.txt").write_text("bait")
        if isinstance(text, str):
            text = text.replace("{around}", str(root.parent)).replace("{long}", "x" * 5000).encode()
        (root / "app.toml").write_bytes(text)
        before = snapshot(root.parent, root)
        said = use(root)
        assert snapshot(root.parent, root) == before, kind
        assert "app.toml" in said or "no file can have this path" in said, kind
        assert "this is a bug" not in said
        assert "Traceback" not in said


def link(root: Path, name: str) -> None:
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).symlink_to(root.parent / "victim.txt")


def step(root: Path, name: str, command: str, files: dict[str, bytes | str]) -> None:
    (root / name).mkdir(parents=True)
    for file, content in {COMMAND: command, **files}.items():
        (root / name / file).write_bytes(content if isinstance(content, bytes) else content.encode())


FLIGHT = {"flight.nc": b"CDF\x01junk", "output.txt": "{}"}
READ = "stoop info log.csv --json\n"
OTHER_INFO = '{"rate": "x", "channels": 3, "faults": 1}'
FOLDERS: dict[str, Callable[[Path], object]] = {
    **{f"{name} is a link to a file outside": lambda root, name=name: link(root, name)
       for name in ("commands.sh", "vehicle.toml", WINDOWS, MAPPING, "app.toml")},
    **{f"{name} is a link to a folder outside": lambda root, name=name: (root / name).symlink_to(root.parent)
       for name in ("info", "map", "runs", "maneuvers", "logs", "comparisons")},
    **{f"{kind}, in {at}": lambda root, at=at, command=command, files=files: step(root, at, command, files)
       for kind, at, command, files in (
            ("an open quote", "info/001", "stoop info 'log.csv\n", FLIGHT),
            ("a command of bytes", "info/001", "", {COMMAND: b"\xff\x00\xfe", **FLIGHT}),
            ("a name of digits", f"info/{'9' * 250}", READ, FLIGHT),
            ("digits of another script", "info/٣٣٣", READ, FLIGHT),
            ("output of bytes", "info/001", READ, {**FLIGHT, "output.txt": b"\xff"}),
            ("output nested", "info/001", READ, {**FLIGHT, "output.txt": "[" * 99_999}),
            ("output of another type", "info/001", READ, {**FLIGHT, "output.txt": "[1]"}),
            ("info of other types", "info/001", READ, {**FLIGHT, "output.txt": OTHER_INFO}),
            ("a proposal of bytes", "maneuvers/001", "stoop", {WINDOWS: b"\xff"}),
            ("a result of another type", "runs/001", "stoop", {"result.json": "[]"}),
       )},
    "a link to a device": lambda root: (root / "vehicle.toml").symlink_to("/dev/zero"),
    "a link to itself": lambda root: (root / "vehicle.toml").symlink_to("vehicle.toml"),
    "a pipe": lambda root: os.mkfifo(root / "vehicle.toml"),
    "app.toml is a folder": lambda root: (root / "app.toml").mkdir(),
    "a huge vehicle": lambda root: ((root / "vehicle.toml").touch(), os.truncate(root / "vehicle.toml", 1 << 40)),
    "a vehicle of bytes": lambda root: (root / "vehicle.toml").write_bytes(b"\xff\xfe\x00"),
    "windows of bytes": lambda root: (root / WINDOWS).write_bytes(b"\xff\xfe\x00"),
    "windows nested": lambda root: (root / WINDOWS).write_text("a = " + "[" * 5000),
    "a product that is a folder": lambda root: (root / "maneuvers/001/windows.toml").mkdir(parents=True),
    "a design of another type": lambda root: (
        step(root, "designs/001", "stoop", {"design.html": "", "design.json": '{"notices": [3]}'}),
        (root / "vehicle.toml").write_text("x = 1"),
    ),
    "a lock that is a pipe": lambda root: (step(root, "info/001", READ, FLIGHT), os.mkfifo(root / "info/001/lock")),
    "files deep in each other": lambda root: (
        step(root, "exports/001", "stoop", {}), (root / "exports/001" / "/".join("d" * 900)).mkdir(parents=True),
    ),
}  # fmt: skip


def test_a_file_of_any_content_is_one_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for i, (kind, make) in enumerate(FOLDERS.items()):
        root = surroundings(tmp_path / str(i))
        if "app.toml" not in kind:
            (root / "app.toml").write_text('log = "log.csv"\n')
        make(root)
        before = snapshot(root.parent, root)
        said = use(root)
        assert snapshot(root.parent, root) == before, kind
        assert "this is a bug" not in said, kind
        assert not caplog.records, kind
        if kind in [f"{name} is a link to a file outside" for name in ("vehicle.toml", WINDOWS, MAPPING)]:
            assert "leads outside the folder" in said, kind


def test_a_progress_file_of_any_type_is_one_line(tmp_path: Path) -> None:
    root = surroundings(tmp_path)
    step(root, "runs/001", "stoop identify log.csv", {})
    view = FitView(Project(root), lambda _: None)
    view._chosen, view._detail = "runs/001", ("runs/001", "running")
    empty = '{"work": "x", "costs": '
    for i, text in enumerate(("[1]", '{"work": 3}', f"{empty}3}}", f'{empty}[], "curves": [3]}}')):
        (root / "runs/001/progress.json").write_text(text)
        os.utime(root / "runs/001/progress.json", ns=(i + 1, i + 1))
        with pytest.raises(StoopError, match="is not as stoop writes it"):
            view.tick()
