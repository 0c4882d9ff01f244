"""Every file that users get is written beside its place, put on the disk (fsync) and then moved there (os.replace)."""

import builtins
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import pytest
from robustness.small_runs import files_of_a_flight
from robustness.trials import lay_out

import stoop
from stoop.base.files import SCRATCH, write_files
from stoop.cli.main import main
from stoop.optimize.state import save_state

SOURCE = Path(stoop.__file__).parents[1]
ALLOWED = {
    "base/files.py", "base/streams.py",  # the writer; the null device
    "base/cache.py", "kernels/generated.py", "kernels/kernel.py", "logs/compiled.py",  # into a folder that is moved when whole
    "logs/guard.py", "stoop_analysis/posterior.py", "results/labelled.py", "stoop_export/fmu.py",  # into a temporary folder
    "stoop_app/steps.py", "stoop_app/uploads.py",  # output of a running process, what grows; parts, then one move
}  # fmt: skip  #: modules that may write a file by themselves
WRITES = re.compile(
    r"\b(write_text|write_bytes|to_netcdf|copytree|copyfile|copy2|NamedTemporaryFile|mkstemp|touch)\("
    r"|open\(.*(['\"](?:[wax]b?\+?|r?b?\+b?)['\"]|O_W|O_RDWR)"
)


def test_no_other_module_writes_files() -> None:
    own = [path for path in SOURCE.glob("stoop*/**/*.py") if "stoop_studies" not in path.parts]
    modules = {path.relative_to(SOURCE).as_posix().removeprefix("stoop/"): path for path in own}
    assert {name for name, path in modules.items() if WRITES.search(path.read_text("utf-8"))} == ALLOWED


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch, root: Path) -> Iterator[None]:
    synced: dict[int, int] = {}
    opened, os_open, fsync, replace = io.open, os.open, os.fsync, os.replace

    def in_place(path: Any, writing: bool) -> None:
        if writing and not isinstance(path, int) and Path(os.fsdecode(path)).absolute().is_relative_to(root):
            assert SCRATCH in str(path), f"{path} is written in its place"

    def watched_open(path: object, mode: str = "r", *more: object, **named: object) -> object:
        in_place(path, bool({*mode} & {*"wax+"}))
        return opened(path, mode, *more, **named)  # type: ignore[call-overload]

    def watched_os_open(path: str, flags: int, *more: Any, **named: Any) -> int:
        in_place(path, bool(flags & (os.O_WRONLY | os.O_RDWR)))
        return os_open(path, flags, *more, **named)

    def watched_fsync(handle: int) -> None:
        fsync(handle)
        synced[os.fstat(handle).st_ino] = os.fstat(handle).st_size

    def watched_replace(source: Path, target: Path, **named: object) -> None:
        state = Path(source).stat()
        assert synced.get(state.st_ino) == state.st_size, f"{target} was moved before it was on the disk"
        replace(source, target, **named)  # type: ignore[arg-type]
        moved.add(Path(target).absolute())

    moved: set[Path] = set()
    for place, name, function in (
        (builtins, "open", watched_open), (io, "open", watched_open), (os, "open", watched_os_open),
        (os, "fsync", watched_fsync), (os, "replace", watched_replace),
    ):  # fmt: skip
        monkeypatch.setattr(place, name, function)
    before = {path for path in root.rglob("*") if path.is_file()}
    yield
    new = {path for path in root.rglob("*") if path.is_file()} - before
    assert new, "nothing was written"
    assert new <= moved


def test_what_is_written_in_its_place_is_seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="in its place"), watched(monkeypatch, tmp_path):
        (tmp_path / "a").write_text("x")
    monkeypatch.undo()
    monkeypatch.setattr("stoop.base.files._write_through", lambda path, content: path.write_bytes(content))
    with pytest.raises(AssertionError, match="before it was on the disk"), watched(monkeypatch, tmp_path):
        write_files(tmp_path, {"a": "x"})


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    lay_out(folder, files_of_a_flight())
    for name in ("sim.nc", "t.csv"):
        words = [str(folder / "v.toml"), "--maneuver", str(folder / "m.toml"), "-o", str(folder / name)]
        assert main(["simulate", *words]) == 0
    return folder


VERBS = [
    *(f"simulate v.toml --maneuver m.toml -o out/flight.{e}" for e in ("nc", "csv", "mat", "ulg", "bin", "usd")),
    "export twin-boom --to state-space -o out", "linearize v.toml --json out/linear.json", "map t.csv -o out/map.toml",
    "vehicle quad-x -o out/v.toml", "vehicle new --template glider --mass 2.1 --span 2.5 --area 0.4 -o out/n.toml",
    "info sim.nc --save out/i.nc",
]  # fmt: skip


@pytest.mark.parametrize("words", VERBS)
def test_what_a_verb_writes_is_whole_or_not_there(
    words: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    for path in inputs.iterdir():
        (tmp_path / path.name).symlink_to(path)
    with watched(monkeypatch, tmp_path):
        monkeypatch.chdir(tmp_path)
        assert main(words.split()) == 0


def test_what_a_result_writes_is_whole_or_not_there(lacking: Any, tmp_path: Path, monkeypatch: Any) -> None:
    with watched(monkeypatch, tmp_path):
        lacking.result.save(tmp_path / "result.json")
        save_state(tmp_path / "state.npz", lacking.estimate.outcome.state)


def test_an_uploaded_log_is_on_the_disk_before_it_is_moved(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    uploads = pytest.importorskip("stoop_app.uploads")
    upload = object.__new__(uploads.Upload)
    part = NamedTemporaryFile(dir=tmp_path, delete=False)  # noqa: SIM115
    answer: dict[str, Any] = {"set_header": lambda *_: None, "finish": lambda _: None}
    vars(upload).update(answer, folder=tmp_path, into="", name="a.ulg", file=part)
    part.write(b"log")
    with watched(monkeypatch, tmp_path):
        upload.post()
    assert (tmp_path / "a.ulg").read_bytes() == b"log"
