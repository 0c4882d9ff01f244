"""Read a small TOML file whole, or say in one line why not; texts and keys as TOML writes them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from stoop.errors import StoopError

MAX_BYTES = 1_000_000


def read_source(path: Path | str, what: str, error: type[StoopError]) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : Path or str
    what : str
        Kind of file, for the message.
    error : type of StoopError
        What to raise.
    """
    try:
        if Path(path).stat().st_size > MAX_BYTES:
            raise error(f"{path}: larger than {MAX_BYTES} bytes; this is no {what} file, check the path")
        return Path(path).read_text(encoding="utf-8")
    except IsADirectoryError:
        inside = sorted(p.name for p in Path(path).glob("*.toml"))
        advice = f"name {' or '.join(inside[:3])} in it" if inside else "check the path"
        raise error(f"{path}: is a folder, no {what} file; {advice}") from None
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or "not UTF-8 text"
        raise error(f"{path}: cannot read the {what} file ({reason}); check the path") from None


def parse_source(text: str, where: str, error: type[StoopError]) -> dict[str, Any]:
    """Return the tables of a TOML text; ``where`` names it in messages."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as fault:
        raise error(f"{where}: not valid TOML: {fault}; mend that line") from None


def quoted(text: str) -> str:
    """Return a text as TOML writes it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'


def quoted_key(text: str) -> str:
    """Return a key as TOML writes it, bare where it can be."""
    plain = text.replace("_", "").replace("-", "")
    return text if plain.isascii() and plain.isalnum() else quoted(text)
