"""A file that another process truncates or overwrites while it is read: an error of ours or a recording, never a signal."""

import mmap
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType

import pytest
from robustness.corpus import sound
from robustness.readers import OURS, READER, ask, prepare
from robustness.trials import BAD, READ, Child

from stoop import logs
from stoop.errors import LogError
from stoop.logs import dataflash

MOMENTS = 20
PACKAGE = str(Path(logs.__file__).parent)


@contextmanager
def stopwatch(at: int, act: Callable[[], object]) -> Iterator[list[str]]:
    """Gather calls and returns of functions while a log is read, those in C among them, and act once at one of them."""
    seen: list[str] = []

    def note(frame: FrameType, event: str, argument: object) -> None:
        if frame.f_code.co_filename.startswith(PACKAGE):
            seen.append(event)
            _ = len(seen) == at and act()

    sys.setprofile(note)
    try:
        yield seen
    finally:
        sys.setprofile(None)


def cut(path: Path) -> None:
    for file in path.iterdir() if path.is_dir() else [path]:
        os.truncate(file, 0)


def overwrite(path: Path) -> None:
    for file in path.iterdir() if path.is_dir() else [path]:
        with file.open("r+b") as handle:
            handle.write(b"\xa3\x95\x80\xff" * (file.stat().st_size // 4))


@pytest.mark.parametrize("form", [form for form in OURS if form != "mapping"])
def test_a_file_that_changes_at_any_moment(form: str, tmp_path: Path) -> None:
    prepare()
    log = sound(form)[0]
    with stopwatch(-1, dict) as whole:
        ask(*log.write(tmp_path), READER)

    def read(folder: Path, moment: int, act: Callable[[Path], None]) -> str:
        path, mapping = log.write(folder)
        with stopwatch(1 + moment * len(whole) // MOMENTS, lambda: act(path)):
            ask(path, mapping, READER)
        return READ

    with closing(Child(read)) as child:
        for act in (cut, overwrite):
            ended = [child(moment, act) for moment in range(MOMENTS)]
            assert [one for one in ended if one.outcome in BAD] == []
            assert READ in {one.outcome for one in ended}, "the last moments are too late to matter"


def test_the_copy_of_a_log_is_given_back_as_it_is_gathered(tmp_path: Path) -> None:
    """A log is read into memory once: pages that were gathered are zeros again, those after them are not."""
    path = tmp_path / "a.bin"
    path.write_bytes(b"\xa3" * (3 * mmap.PAGESIZE))
    content = dataflash._copy_private(path)
    path.write_bytes(b"")
    assert bytes(content) == b"\xa3" * (3 * mmap.PAGESIZE), "not what lies on the disk now"
    dataflash.release_pages(content, 2 * mmap.PAGESIZE + 5)
    assert bytes(content[: 2 * mmap.PAGESIZE]) == bytes(2 * mmap.PAGESIZE)
    assert bytes(content[2 * mmap.PAGESIZE :]) == b"\xa3" * mmap.PAGESIZE


def test_a_sparse_log_is_refused_before_it_takes_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(sound("dataflash")[0].files["a.bin"][:200])
    os.truncate(path, 2**40)
    with pytest.raises(LogError, match="larger than 4 GiB"):
        logs.read(path)
