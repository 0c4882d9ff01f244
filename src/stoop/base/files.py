"""The one writer of outputs and the one reader of small inputs.

An output is refused before the work begins, and written whole or not at all. It replaces nothing but a regular file, and none
that the running command has read.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Final

from stoop.errors import OutputError

SCRATCH: Final = ".stoop-unfinished-"  #: beginning of the names of hidden folders in which files are made
#: device and inode of each file that the running command reads -> its path; None outside of a command
_READ: ContextVar[dict[tuple[int, int], Path] | None] = ContextVar("_READ", default=None)
#: outputs of the running command that did not exist when it began, and may replace nothing; None outside of a command
_NEW: ContextVar[set[Path] | None] = ContextVar("_NEW", default=None)


@contextmanager
def recorded_inputs() -> Iterator[None]:
    """Record the files that are read meanwhile, and outputs yet to be made: no output replaces one of those, or what appeared."""
    read, new = _READ.set({}), _NEW.set(set())
    try:
        yield
    finally:
        _READ.reset(read)
        _NEW.reset(new)


def note_input(path: Path | str) -> None:
    """Record a file as read by the running command, if there is such a file."""
    if (known := _READ.get()) is not None:
        with suppress(OSError, ValueError):
            status = Path(path).stat()
            known[status.st_dev, status.st_ino] = Path(path)


def read_bounded(path: Path | str, max_bytes: int) -> bytes:
    """Return the content of a regular file, and record it as an input.

    What is read is counted, whatever size the system states; a device or a FIFO, which has no end, is not read.

    Raises
    ------
    OSError
        It cannot be opened, is no regular file, or holds more than `max_bytes`.
    """
    nonblocking = getattr(os, "O_NONBLOCK", 0)  # else a FIFO is waited for
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | nonblocking)) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "no regular file")
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"larger than {max_bytes} bytes")
    note_input(path)
    return content


def utf8_text(content: bytes) -> str:
    """Return the text of a file, without a byte-order mark, with the line ends of POSIX.

    Raises
    ------
    UnicodeError
        It is not UTF-8, or has zeros, as UTF-16 does; the message is advice.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise UnicodeError("not UTF-8 text; save it as UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


@contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """Make a hidden folder in another one, for files that are then moved out of it, and remove it at the end.

    Those of processes that were killed are removed first: a lock, which ends with its process, tells them from those in use.
    """
    for old in folder.glob(f"{SCRATCH}*"):
        if (lock := _lock(old)) is not None:
            shutil.rmtree(old, ignore_errors=True)
            os.close(lock)
    place, lock = _locked_folder(folder)
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _locked_folder(folder: Path) -> tuple[Path, int | None]:
    place = Path(tempfile.mkdtemp(prefix=SCRATCH, dir=folder))
    lock = _lock(place, wait=True)
    if place.exists():
        return place, lock
    if lock is not None:  # another process was faster, and took it for that of one that was killed
        os.close(lock)
    return _locked_folder(folder)


def _lock(folder: Path, wait: bool = False) -> int | None:
    """Return the open folder, locked; None if it is in use, no folder, or on a system or a disk without such locks."""
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except (ImportError, OSError):
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(handle)
        return None
    return handle


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Make a folder that several commands change, and let no other process in until the end of the block.

    Raises
    ------
    OutputError
        Another process is in there.
    """
    make_folder(folder)
    lock = _lock(folder)
    if lock is None and sys.platform != "win32":
        raise OutputError(f"{folder}: another command is writing there; start again when it has ended")
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def write_files(folder: Path, files: Mapping[str, bytes | str], obsolete: Iterable[str] = ()) -> None:
    """Write files that belong together: all are made before the first is moved into place.

    Parameters
    ----------
    folder : Path
        Made, with its parents, if it is not there.
    files : mapping of str to bytes or str
        Place in the folder to content, text as UTF-8; moved into place in this order.
    obsolete : iterable of str
        Older files that must not stand beside new ones; they are removed before the first is moved.

    Raises
    ------
    OutputError
        The folder cannot be made or is not writable, the disk is full, or a target is no regular file or was read by the running
        command; the files that were there stay, and none is left half-written.
    """
    make_folder(folder)
    _write(folder, files, obsolete)


def write_file(path: Path, content: bytes | str) -> None:
    """Write a file into a folder that exists, text as UTF-8; a reader sees the old or the whole new one. See `write_files`."""
    _write(Path(path).parent, {Path(path).name: content})


def _write(folder: Path, files: Mapping[str, bytes | str], obsolete: Iterable[str] = ()) -> None:
    target, new = folder.joinpath(*[*files][:1]), _NEW.get() or set()
    try:
        with scratch(folder) as made:
            for i, (place, content) in enumerate(files.items()):
                target = folder / place
                data = content if isinstance(content, bytes) else content.encode("utf-8", errors="replace")
                _write_through(made / str(i), data)
            for target in map(folder.joinpath, files):
                target.parent.mkdir(parents=True, exist_ok=True)
                if is_replaceable(target) and target.absolute() in new:
                    raise OutputError(
                        f"{target}: appeared during this run and would be replaced; move it, and run again"
                    )
            for target in map(folder.joinpath, obsolete):
                if is_replaceable(target):
                    target.unlink()
            for i, target in enumerate(map(folder.joinpath, files)):
                (made / str(i)).replace(target)
                new.discard(target.absolute())
    except OSError as error:
        raise OutputError(
            f"{target}: cannot be written ({error.strerror or error}); choose another output folder"
        ) from error


def _write_through(path: Path, content: bytes) -> None:
    # Without fsync a crash soon after the rename can leave an empty file under the final name.
    with path.open("xb") as handle:
        handle.write(content)
        handle.flush()
        os.fsync(handle.fileno())


def is_replaceable(target: Path) -> bool:
    """Tell whether an output would replace a file.

    Raises
    ------
    OutputError
        It is a folder, a link, a device, a FIFO or a socket, or the running command reads it.
    """
    try:
        status = target.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    if stat.S_ISDIR(status.st_mode):
        raise OutputError(f"{target}: this is a folder; name a file in it")
    if stat.S_ISLNK(status.st_mode):
        raise OutputError(
            f"{target}: is a link and would be replaced; name the file that it leads to, or another"
        )
    if not stat.S_ISREG(status.st_mode):
        raise OutputError(f"{target}: is no regular file and would be replaced; choose another name")
    place = (_READ.get() or {}).get((status.st_dev, status.st_ino))
    # The number of a file that is gone may be that of a new one.
    if place is not None and place.exists() and place.samefile(target):
        raise OutputError(f"{target}: is read by this run and would be replaced; choose another name")
    return True


def _exists(target: Path, overwrite: bool) -> bool:
    """Tell whether an output exists that may not be replaced; one that does not yet is recorded as new."""
    if is_replaceable(target) or overwrite:
        return not overwrite
    if (new := _NEW.get()) is not None:
        new.add(target.absolute())
    return False


def check_target(path: Path, overwrite: bool) -> None:
    """Refuse a file that exists or may not be replaced, or that has no folder to lie in.

    Raises
    ------
    OutputError
        With what to do instead.
    """
    if _exists(path, overwrite):
        raise OutputError(
            f"{path}: exists already; add --overwrite (in Python overwrite=True) to replace it, or choose another name"
        )
    if not path.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; make it first, or choose another")


def check_targets(folder: Path, names: Sequence[str], overwrite: bool, inputs: Sequence[Path] = ()) -> None:
    """Refuse a folder that cannot take files of these names, before any work is done.

    Raises
    ------
    OutputError
        It is a file, holds an input or an earlier output of the same name, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder with -o")
    if any(folder.exists() and path.exists() and folder.samefile(path) for path in inputs):
        raise OutputError(f"{folder}: is the log that this run reads; name another folder with -o")
    for target in (folder / name for name in names):
        if any(target.exists() and path.exists() and target.samefile(path) for path in inputs):
            raise OutputError(
                f"{target}: is read by this run and would be replaced; name another folder with -o"
            )
        if _exists(target, overwrite):
            raise OutputError(
                f"{target}: exists already; add --overwrite (in Python overwrite=True) to replace it, or name another folder"
            )
    parent = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not parent.is_dir():
        raise OutputError(f"{folder}: {parent} is a file and holds no folder; name another one with -o")
    if not os.access(parent, os.W_OK):
        raise OutputError(f"{folder}: cannot be written; name another folder with -o")


def make_folder(folder: Path) -> None:
    """Make a folder with its parents.

    Raises
    ------
    OutputError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file; name a folder") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from None
