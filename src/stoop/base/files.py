"""Write whole files or nothing: to a temporary name beside the target, then renamed over it."""

from __future__ import annotations

import contextlib
import os
import secrets
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
