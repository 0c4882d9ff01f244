"""A folder of compiled modules that survives damage, races and read-only disks.

Compiled code is run as it is read, and Numba keeps its own in pickles: neither may be read when it is not what we wrote. Each
module therefore lives in a folder of its own (mode 0700) with a manifest of checksums, which is written last. A
folder is built under a temporary name and renamed into place, so two processes cannot see each other's
half-written files; a folder whose checksums do not match is discarded and built again. One process builds a
folder while others wait for it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import json
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from stoop.errors import CacheWarning

MANIFEST = "manifest.json"
BUILDING = ".building-"
STALE = 86400.0  #: s
MAX_BYTES = 2**26  #: of a file; those of the largest models have some megabytes
#: s; a process that takes longer was stopped, or its lock was lost with a connection: then another one builds too
PATIENCE = 600.0


def cache_folder() -> Path:
    """Return where compiled modules are kept: ``STOOP_CACHE_DIR``, else the user's cache folder.

    Where there is none and none can be made, or others could put folders of theirs in its place, they are kept for this
    process only.
    """
    try:
        if given := os.environ.get("STOOP_CACHE_DIR"):
            folder = Path(given)
        else:
            folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stoop" / "kernels"
        folder = folder.resolve()  # nobody can lead it elsewhere afterwards
        if _ours_alone(folder):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            return folder
    except (RuntimeError, OSError):  # no home, as in containers; a link to itself; a read-only disk
        pass
    return _for_this_process()


def fonts_folder() -> Path:
    """Make the folder where Matplotlib keeps its list of fonts: in the cache, or for this process only."""
    try:
        folder = cache_folder() / "matplotlib"
        folder.mkdir(exist_ok=True, mode=0o700)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return _for_this_process()


def _ours_alone(folder: Path) -> bool:
    """Return whether nobody but this user and root can replace what lies in a folder without links, made or to be made.

    Each folder on the way to it belongs to one of these, and others cannot write there, except where they can only add
    (sticky, as /tmp) or the group has no other member (as many systems give each user one).
    """
    if not hasattr(os, "getuid"):
        return True
    return all(_replaceable_by_none(place.lstat()) for place in (folder, *folder.parents) if place.exists())


def _replaceable_by_none(status: os.stat_result) -> bool:
    if status.st_uid not in (os.getuid(), 0):
        return False
    if status.st_mode & stat.S_ISVTX:
        return True
    others = stat.S_IWOTH if _has_no_other_member(status.st_gid) else stat.S_IWOTH | stat.S_IWGRP
    return not status.st_mode & others


def _has_no_other_member(group: int) -> bool:
    import grp
    import pwd

    try:
        found, user = grp.getgrgid(group), pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return group == 0
    return group == 0 or (found.gr_name == user and not set(found.gr_mem) - {user})


@functools.cache
def _for_this_process() -> Path:
    return _until_exit(private())


def _is_for_this_process(folder: Path) -> bool:
    return _for_this_process.cache_info().currsize > 0 and folder == _for_this_process()


@functools.cache  # once: Python's own count begins again whenever a filter of warnings changes
def _warn(folder: Path) -> None:
    """Warn, but not in each worker process, that what is compiled for a folder now is lost at the end."""
    import multiprocessing

    if multiprocessing.parent_process() is None:
        warnings.warn(
            "the cache cannot be written, so equations are compiled again by every command; "
            "set STOOP_CACHE_DIR to a folder of yours",
            CacheWarning,
            stacklevel=1,
        )


def checksums(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file below a folder, the manifest left out."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != MANIFEST)
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def _private(folder: Path) -> bool:
    """Return whether nobody but this user and root can write there (a checksum proves nothing otherwise), and files are small.

    Where others cannot enter the folder, what lies in it may have any mode.
    """
    if not hasattr(os, "getuid"):
        return True
    closed = not folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    for status in (p.lstat() for p in (folder, *folder.rglob("*"))):
        writable = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        foreign = status.st_uid not in (os.getuid(), 0) or stat.S_ISLNK(status.st_mode)
        if foreign or (writable and not closed) or status.st_size > MAX_BYTES:
            return False
    return True


def intact(folder: Path) -> bool:
    """Return whether a folder is ours and holds exactly what its manifest says."""
    try:
        return _private(folder) and json.loads((folder / MANIFEST).read_text()) == checksums(folder)
    except (OSError, ValueError, RecursionError):
        return False


def writable(folder: Path) -> bool:
    """Return whether Numba could write beside its files; where it cannot, it does not read them either."""
    compiled = folder / "__pycache__"
    return os.access(folder, os.W_OK) and (not compiled.exists() or os.access(compiled, os.W_OK))


def private() -> Path:
    """Make a folder outside the cache, which nobody else can enter; the caller discards it."""
    return Path(tempfile.mkdtemp(prefix="stoop-kernels-"))


def copy(folder: Path) -> Path:
    """Copy a folder that cannot be written to a private one that can."""
    target = private()
    shutil.copytree(folder, target, dirs_exist_ok=True)
    for inner in (target, *target.rglob("*/")):
        inner.chmod(stat.S_IRWXU)
    return target


def provide(final: Path, make: Callable[[Path], None]) -> Path:
    """Return the sealed folder of a module; one for this process alone where the cache cannot be written.

    Parameters
    ----------
    final : Path
        Where it lies, or will lie once it is built.
    make : callable
        Writes the files into a folder. One process calls it; the others wait. When that process dies, the next one builds.

    Raises
    ------
    OSError
        Neither the cache nor the folder of temporary files has room.
    """
    try:
        folder = _from_cache(final, make)
    except OSError:  # a full disk
        _warn(final.parent)
        folder = _until_exit(private())
        make(folder)
    return folder if folder == final else _until_exit(folder)


def _from_cache(final: Path, make: Callable[[Path], None]) -> Path:
    if not intact(final):
        with _lock(final):
            if not intact(final):
                return _build(final, make)
    return final if writable(final) else copy(final)


def _build(final: Path, make: Callable[[Path], None]) -> Path:
    building = start_build(final.parent)
    if building.parent != final.parent or _is_for_this_process(final.parent):
        _warn(final.parent)
    try:
        make(building)
        return seal(building, final)
    except OSError:
        discard(building)
        raise


def _until_exit(folder: Path) -> Path:
    atexit.register(discard, folder)
    return folder


@contextlib.contextmanager
def _lock(final: Path) -> Iterator[None]:
    """Wait until no other process builds the folder. The lock ends with its process."""
    place = final.with_name(f"{BUILDING}{final.name}")
    handle = _acquire(place)
    try:
        yield
    finally:
        if handle is not None:
            import fcntl

            with contextlib.suppress(OSError):
                place.rmdir()  # before it is unlocked: a process that waits for it then makes another one
            fcntl.flock(handle, fcntl.LOCK_UN)  # also for a fork, which has the same open folder
            os.close(handle)


def _acquire(place: Path) -> int | None:
    """Make and lock a folder; return it open, or None on a system or a disk without such locks, or after `PATIENCE`."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            place.mkdir(exist_ok=True, mode=0o700)
        except OSError:  # nobody builds there
            return None
        try:
            return _locked(place)
        except (BlockingIOError, FileNotFoundError):
            time.sleep(0.05)
        except (ImportError, OSError):
            return None
    return None


def _locked(place: Path) -> int:
    """Return a folder, open and locked; raise BlockingIOError if it is in use, FileNotFoundError if it was removed."""
    import fcntl

    handle = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not os.path.samestat(place.stat(), os.fstat(handle)):
            raise FileNotFoundError(place)
        os.utime(handle)  # held from now: an old lock would be discarded as stale
    except OSError:
        os.close(handle)
        raise
    return handle


def start_build(root: Path) -> Path:
    """Make a private folder to build in; outside the cache when the cache cannot be written."""
    try:
        root.mkdir(parents=True, exist_ok=True, mode=0o700)
        for old in root.glob(f"{BUILDING}*"):  # a process was killed while it compiled
            # another process may just have put its folder in its place
            with contextlib.suppress(FileNotFoundError):
                if time.time() - old.stat().st_mtime > STALE:
                    discard(old)
        return Path(tempfile.mkdtemp(prefix=BUILDING, dir=root))
    except OSError:
        return private()


def seal(building: Path, final: Path) -> Path:
    """Write the manifest and put the folder in its place; return where it now is.

    Another process may have been faster: then its folder stays and ours serves this process only.
    """
    (building / MANIFEST).write_text(json.dumps(checksums(building)))
    if building.parent != final.parent:
        return building
    if final.exists() and not intact(final):
        discard(final)
    try:
        building.rename(final)
    except OSError:
        return building
    return final


def discard(folder: Path) -> None:
    """Remove a folder as far as the disk allows."""
    with contextlib.suppress(OSError):
        doomed = Path(tempfile.mkdtemp(prefix=BUILDING, dir=folder.parent))
        folder.rename(doomed / folder.name)
        folder = doomed
    shutil.rmtree(folder, ignore_errors=True)
