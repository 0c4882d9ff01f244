"""A folder of compiled modules that survives damage, races and read-only disks.

Numba keeps compiled code in pickles, which must never be read when they are not what we wrote. Each module
therefore lives in a folder of its own (mode 0700) with a manifest of checksums, which is written last. A
folder is built under a temporary name and renamed into place, so two processes cannot see each other's
half-written files; a folder whose checksums do not match is discarded and built again.
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
from pathlib import Path

MANIFEST = "manifest.json"
BUILDING = ".building-"
STALE = 86400.0  #: s


def cache_folder() -> Path:
    """Return where compiled modules are kept: ``STOOP_CACHE_DIR``, else the user's cache folder."""
    if folder := os.environ.get("STOOP_CACHE_DIR"):
        return Path(folder)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "stoop" / "kernels"
    except RuntimeError:  # a user without a home, as containers have them
        return _for_this_process()


@functools.cache
def _for_this_process() -> Path:
    folder = private()
    atexit.register(discard, folder)
    return folder


def checksums(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file below a folder, the manifest left out."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != MANIFEST)
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def _private(folder: Path) -> bool:
    """Return whether nobody but this user and root can write there (a checksum proves nothing otherwise).

    Where others cannot enter the folder, what lies in it may have any mode.
    """
    if not hasattr(os, "getuid"):
        return True
    closed = not folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    for status in (p.lstat() for p in (folder, *folder.rglob("*"))):
        writable = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if status.st_uid not in (os.getuid(), 0) or stat.S_ISLNK(status.st_mode) or (writable and not closed):
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


def start_build(root: Path) -> Path:
    """Make a private folder to build in; outside the cache when the cache cannot be written."""
    try:
        root.mkdir(parents=True, exist_ok=True, mode=0o700)
        for old in root.glob(f"{BUILDING}*"):  # a process was killed while it compiled
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
        doomed = Path(tempfile.mkdtemp(prefix=".discarded-", dir=folder.parent))
        folder.rename(doomed / folder.name)
        folder = doomed
    shutil.rmtree(folder, ignore_errors=True)
