"""Files that belong together are written all or none; leftovers are swept; archives say no more than they hold."""

import io
import os
import shutil
import signal
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stoop.base import files
from stoop.base.files import read_bounded, recorded_inputs, scratch, write_file, write_files
from stoop.base.npz import read_arrays
from stoop.errors import OutputError


def contents(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_all_are_written_in_folders_of_their_own(tmp_path: Path) -> None:
    write_files(tmp_path, {"a.txt": "one", "deep/down/b.bin": b"two", "c.txt": "\udcff"})
    assert contents(tmp_path) == {"a.txt": "one", "deep/down/b.bin": "two", "c.txt": "?"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "c.txt", "deep"]


def test_none_is_replaced_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_files(tmp_path, {"0": "old", "1": "old", "beside": "old"})
    for full_at in range(3):

        def full(path: Path, content: bytes, full_at: int = full_at) -> None:
            path.write_bytes(content[:1])
            if path.name == str(full_at):
                raise OSError(28, "No space left on device")

        monkeypatch.setattr("stoop.base.files._write_through", full)
        with pytest.raises(OutputError, match=f"{full_at}: cannot be written .No space left on device"):
            write_files(tmp_path, {"0": "new", "1": "new", "2": "new"}, ["beside"])
        assert contents(tmp_path) == {"0": "old", "1": "old", "beside": "old"}
        assert len(list(tmp_path.iterdir())) == 3


def test_a_folder_in_the_way_is_seen_before_anything_is_replaced_or_removed(tmp_path: Path) -> None:
    write_file(tmp_path / "a", "old")
    (tmp_path / "b").mkdir()
    with pytest.raises(OutputError, match="b: this is a folder"):
        write_files(tmp_path, {"a": "new", "b": "new"})
    assert contents(tmp_path) == {"a": "old"}
    write_files(tmp_path, {"log": "new"}, ["a", "never there"])  # what is obsolete goes before the new come
    assert contents(tmp_path) == {"log": "new"}


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders")
def test_what_a_killed_process_left_is_swept_and_what_is_in_use_stays(tmp_path: Path) -> None:
    code = (
        "import os, signal, pathlib; from stoop.base.files import scratch\n"
        f"with scratch(pathlib.Path({str(tmp_path)!r})) as made:\n"
        "    (made / 'part').write_text('x'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    for _ in range(2):
        assert subprocess.run([sys.executable, "-c", code]).returncode == -signal.SIGKILL
        assert len(list(tmp_path.iterdir())) == 1, "the next one sweeps what the last one left"
    with scratch(tmp_path) as mine:
        with scratch(tmp_path) as other:
            assert set(tmp_path.iterdir()) == {mine, other}
        assert list(tmp_path.iterdir()) == [mine]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_another_process_took_for_a_dead_ones_is_made_again(tmp_path, monkeypatch):
    taken: list[Path] = []

    def lock(folder: Path, wait: bool = False) -> int | None:
        if not taken:
            taken.append(folder)
            shutil.rmtree(folder)
            return None
        return os.open(folder, os.O_RDONLY)

    monkeypatch.setattr("stoop.base.files._lock", lock)
    with scratch(tmp_path) as made:
        assert made.is_dir()
        assert made != taken[0]


def test_folders_of_others_stay(tmp_path: Path) -> None:
    for name in ("mine", ".stoop", ".stoop-cache", ".stoop-kernels"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("mine")
    (tmp_path / f"{files.SCRATCH}link").symlink_to(tmp_path / "mine")
    write_file(tmp_path / "a", "new")
    assert len(list(tmp_path.glob(".stoop*/file"))) >= 3
    assert (tmp_path / "mine" / "file").read_text() == "mine", "nothing is swept through a link"


def test_what_a_command_has_read_stays_until_it_ends(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    with recorded_inputs():
        assert read_bounded(tmp_path / "a", 4) == b"mine"
        for obsolete, new in (([], {"b": "new", "a": "new"}), (["a"], {"b": "new"})):
            with pytest.raises(OutputError, match="a: is read by this run"):
                write_files(tmp_path, new, obsolete)
        assert contents(tmp_path) == {"a": "mine"}
    write_files(tmp_path, {"a": "new"})
    assert contents(tmp_path) == {"a": "new"}


def test_what_appears_while_a_command_works_is_not_replaced(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    with recorded_inputs():
        files.check_target(target, overwrite=False)
        target.write_text("of another process")
        with pytest.raises(OutputError, match=r"out\.txt: appeared during this run"):
            write_file(target, "ours")
        assert target.read_text() == "of another process"
        target.unlink()
        for text in ("a progress", "a whole result"):
            write_file(target, text)
        assert target.read_text() == "a whole result"
    with recorded_inputs():
        files.check_target(target, overwrite=True)
        write_file(target, "asked for")


def test_a_number_of_a_file_that_is_gone_is_no_input(tmp_path: Path) -> None:
    """File systems give the number of a removed file to the next one: a command writes its own file again and again."""
    with recorded_inputs():
        for i in range(20):
            read = tmp_path / f"read-{i}"
            read.write_text("x")
            files.note_input(read)
            read.unlink()
            write_file(tmp_path / "own", str(i))
    assert contents(tmp_path) == {"own": "19"}


@pytest.mark.skipif(sys.platform == "win32", reason="no such devices")
@pytest.mark.parametrize("device", ["/dev/null", "/dev/full", "/dev/stdout", "/dev/tty"])
def test_a_device_is_never_replaced(device: str) -> None:
    with pytest.raises(OutputError, match="would be replaced"):
        files.check_target(Path(device), overwrite=True)


def test_what_is_read_is_counted_and_not_believed(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_bounded(tmp_path / "a", 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_bounded(tmp_path / "a", 4)
    if Path("/proc/cpuinfo").exists():  # states no size
        with pytest.raises(OSError, match="larger than 9 bytes"):
            read_bounded("/proc/cpuinfo", 9)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_no_more_is_unpacked_than_is_stated(method: int) -> None:
    """Of an archive whose member unfolds to more than it states: 128 bytes."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        archive.writestr("a.npy", bytes(10 * 2**20), compress_type=method)
    content, central = sink.getbuffer(), sink.getvalue().index(b"PK\x01\x02")
    for place in (22, central + 24):  # of the size, in both headers
        content[place : place + 4] = struct.pack("<I", 128)
    assert len(content) < 2**17
    tracemalloc.start()
    with pytest.raises((ValueError, zipfile.BadZipFile)):
        read_arrays(sink, 2**20)
    assert tracemalloc.get_traced_memory()[1] < 2**21
    tracemalloc.stop()


def test_a_header_that_is_no_python_is_a_value_error() -> None:
    cut = "{'descr': '<f8', 'fortran_order': False, 'shape': (3,"
    for head in (cut, "{[]: 1}", "-" * 50_000 + "1", "(" * 300):
        sink, text = io.BytesIO(), head.encode() + b"\n"
        with zipfile.ZipFile(sink, "w") as archive:
            head_bytes = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little")
            archive.writestr("a.npy", head_bytes + text + bytes(8))
        with pytest.raises(ValueError, match=r"header|Header"):
            read_arrays(sink, 2**20)


def test_arrays_at_the_bound_are_read() -> None:
    sink = io.BytesIO()
    np.savez_compressed(sink, a=np.zeros(2**10))
    size = sum(one.file_size for one in zipfile.ZipFile(sink).infolist())
    assert read_arrays(sink, size)["a"].size == 2**10
    with pytest.raises(ValueError, match="unfolds"):
        read_arrays(sink, size - 1)


CODE = """
import resource
import numpy as np
from stoop.base.memory import keep_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(10):
        arrays = [np.ones(600_000) for _ in range(4)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

apart = faults()
keep_freed_memory()
faults()
print(apart, faults())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc alone is told")
def test_arrays_that_are_made_again_take_no_fresh_pages() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True, text=True)
    apart, kept = map(int, done.stdout.split())
    assert apart > 10_000  # pages of 4 kB
    assert kept < 0.1 * apart
