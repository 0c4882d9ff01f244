"""Output files: refused before the work begins, and written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Sequence
from pathlib import Path

from stoop.errors import OutputError


def write_bytes_atomic(path: Path, content: bytes) -> None:
    """Write `content` to `path`; a reader sees the old file or the whole new one, never a part.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    content : bytes
        What the file holds afterwards.

    Raises
    ------
    OutputError
        When the folder is missing or not writable, or the disk is full; nothing is left behind.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.tmp")
    try:
        _write_through(temporary, content)
        temporary.replace(target)
    except OSError as error:
        raise OutputError(
            f"{target}: cannot be written ({error.strerror or error}); choose another output folder"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text_atomic(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path`, all or nothing; see `write_bytes_atomic`."""
    write_bytes_atomic(path, text.encode("utf-8", errors="replace"))


def _write_through(path: Path, content: bytes) -> None:
    # Without fsync a crash soon after the rename can leave an empty file under the final name.
    with path.open("xb") as handle:
        handle.write(content)
        handle.flush()
        os.fsync(handle.fileno())


def check_target(path: Path, overwrite: bool) -> None:
    """Refuse a file that exists, or that has no folder to lie in.

    Raises
    ------
    OutputError
        With what to do instead.
    """
    if path.is_dir():
        raise OutputError(f"{path}: this is a folder; name a file in it")
    if path.exists() and not overwrite:
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
    for target in (folder / name for name in names):
        if any(target.exists() and path.exists() and target.samefile(path) for path in inputs):
            raise OutputError(
                f"{target}: is read by this run and would be replaced; name another folder with -o"
            )
        if target.exists() and not overwrite:
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
