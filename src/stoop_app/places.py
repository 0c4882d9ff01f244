"""Paths of a project, resolved in one place: inside its folder, or a log that the person opened.

The folder may come from someone else. What its files and links say is not believed: a path that leads outside, or to a
device or a pipe, is refused. What the person did, such as opening a log, is kept in the person's own folder instead.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from stoop.extend.errors import OutputError, StoopError
from stoop.extend.files import cache_folder, read_bounded, write_file

MAX_DOCUMENT: Final = 64 << 20  #: bytes of a JSON file
#: raised while a document is interpreted whose values have other types than stoop writes
MAX_BYTES: Final = 1_000_000  #: of a file of the folder
MALFORMED: Final = (
    TypeError, ValueError, LookupError, AttributeError, ArithmeticError, RecursionError, AssertionError,
)  # fmt: skip

_session: dict[Path, str] = {}  #: what `remember` kept since the app was started


def resolved(path: Path) -> Path:
    """Return a path without links; raises `OutputError` where no file can have it, or it is a device or a pipe."""
    try:
        place = path.resolve()
        if not place.exists() or place.is_file() or place.is_dir():
            return place
    except (OSError, ValueError, RuntimeError):  # too long, a NUL, a link to itself
        raise OutputError(f"{str(path)[:200]}: no file can have this path; check it") from None
    raise OutputError(f"{path}: is neither a file nor a folder; remove it")


def inside(root: Path, name: str | Path) -> Path:
    """Return a place in the folder of a project; raises `OutputError` where it leads outside, see `resolved`."""
    path = root / name
    if not resolved(path).is_relative_to(root.resolve()):
        raise OutputError(f"{path}: leads outside the folder {root}; replace it by a file of the folder")
    return path


def bytes_of(root: Path, name: str | Path, limit: int = MAX_BYTES) -> bytes:
    """Return the content of a file of the folder, empty where there is none; raises `OutputError`."""
    path = inside(root, name)
    try:
        return read_bounded(path, limit)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({error.strerror or error}); mend or remove it") from None


def text_of(root: Path, name: str | Path, limit: int = MAX_BYTES) -> str:
    """Return the text of a file of the folder, empty where there is none; raises `OutputError`."""
    try:
        text = bytes_of(root, name, limit).decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise OutputError(f"{root / name}: is not UTF-8 text; save it as UTF-8, or remove it")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def tail_of(root: Path, name: str | Path, count: int) -> str:
    """Return the last bytes of a file of the folder as text; empty where it cannot be read."""
    with contextlib.suppress(OSError, StoopError), inside(root, name).open("rb") as handle:
        handle.seek(max(os.fstat(handle.fileno()).st_size - count, 0))
        return handle.read(count).decode("utf-8", "replace")
    return ""


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Say in one line that a file of the folder is not as stoop writes it, where its values have other types."""
    try:
        yield
    except StoopError:
        raise
    except MALFORMED:
        raise OutputError(f"{path}: is not as stoop writes it; remove it, or run that step again") from None


def document_of(root: Path, name: str | Path) -> dict[str, Any]:
    """Return the JSON object that a file of the folder holds, empty where there is none; raises `OutputError`."""
    text = text_of(root, name, MAX_DOCUMENT)
    with reading(root / name):
        return dict(json.loads(text)) if text else {}


def remember(kind: str, place: Path, text: str = "") -> None:
    """Keep what the person did with a place, outside every project; where that cannot be written, until the app ends."""
    path = _memory(kind, place)
    _session[path] = text
    with contextlib.suppress(OSError, OutputError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_file(path, text)


def recalled(kind: str, place: Path) -> str | None:
    """Return what `remember` kept; None where the person did no such thing."""
    path = _memory(kind, place)
    with contextlib.suppress(OSError, ValueError):
        return _session.get(path) or path.read_text("utf-8")
    return _session.get(path)


def _memory(kind: str, place: Path) -> Path:
    name = hashlib.sha256(os.fsencode(place)).hexdigest()
    return cache_folder() / "app" / f"{kind}-{name}"
