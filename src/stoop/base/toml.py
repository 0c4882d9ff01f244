"""Read a small TOML or JSON file whole, or say in one line why not; texts and keys as TOML writes them.

Whoever wrote it: its size, its depth and its numbers have bounds, so that nothing that reads it must expect more.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from stoop.base.files import read_bounded, utf8_text
from stoop.errors import StoopError

MAX_BYTES = 1_000_000
MAX_DEPTH = 64  #: of tables and lists in each other
# comments and texts, whose last characters may be quotes; those without an end go on to the end of the line or file
_APART = re.compile(
    r'#[^\n]*|"""(?:[^\\]|\\[\s\S])*?(?:"{3,5}|\Z)|\'\'\'[\s\S]*?(?:\'{3,5}|\Z)'
    r'|"(?:[^"\\\n]|\\.)*(?:"|$)|\'[^\'\n]*(?:\'|$)',
    re.MULTILINE,
)


def read_source(
    path: Path | str, what: str, error: type[StoopError], max_bytes: int = MAX_BYTES, ending: str = ".toml"
) -> str:
    """Return the text of a regular file, see `read_bounded`.

    Parameters
    ----------
    path : Path or str
    what : str
        Kind of file, for the message.
    error : type of StoopError
        What to raise.
    max_bytes : int
        Size from which a file is refused.
    ending : str
        Of such files, for the advice where a folder is named.
    """
    try:
        return utf8_text(read_bounded(path, max_bytes))
    except IsADirectoryError:
        inside = sorted(p.name for p in Path(path).glob(f"*{ending}"))
        advice = f"name {' or '.join(inside[:3])} in it" if inside else "check the path"
        raise error(f"{path}: is a folder, no {what} file; {advice}") from None
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or fault
        raise error(f"{path}: cannot read the {what} file ({reason}); check the path") from None


def parse_source(text: str, where: str, error: type[StoopError]) -> dict[str, Any]:
    """Return the tables of a TOML text; ``where`` names it in messages."""
    try:
        keys = re.split(r"[,=\[\]{}\n]", _APART.sub("s", text))
        if any(key.count(".") > MAX_DEPTH for key in keys):  # tomllib takes minutes for a key of many parts
            raise ValueError(f"a key of more than {MAX_DEPTH} parts")
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as fault:
        raise error(f"{where}: not valid TOML: {fault}; mend that line") from None
    try:
        check_bounds(content)
    except ValueError as fault:
        raise error(f"{where}: {fault}; mend that line") from None
    return content


def parse_json(text: str | bytes) -> Any:
    """Return what a JSON text holds; raises ValueError where it holds none, or more than `check_bounds` allows."""
    try:
        content = json.loads(text)
    except RecursionError:
        raise ValueError(f"nested more than {MAX_DEPTH} deep") from None
    check_bounds(content)
    return content


def is_of_type(value: Any, kind: type) -> bool:
    """Tell whether a value of a document is of a type: a whole number is a float, too, and true and false are no numbers."""
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, int | float if kind is float else kind)


def check_bounds(content: Any) -> None:
    """Raise ValueError where a document is nested too deep, or has an integer that no float can hold."""
    level, depth = [("", content)], 0
    while level:
        if depth > MAX_DEPTH:
            raise ValueError(f"nested more than {MAX_DEPTH} deep")
        for key, one in level:
            if isinstance(one, int) and one.bit_length() > 1023:
                raise ValueError(f"{key}: an integer of more than 308 digits")
        inside = [(key, one) for key, one in level if isinstance(one, dict)]
        tables = [(f"{key}.{k}".lstrip("."), x) for key, one in inside for k, x in one.items()]
        lists = [(key, inner) for key, one in level if isinstance(one, list) for inner in one]
        level, depth = tables + lists, depth + 1


def quoted(text: str) -> str:
    """Return a text as TOML writes it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'


def quoted_key(text: str) -> str:
    """Return a key as TOML writes it, bare where it can be."""
    plain = text.replace("_", "").replace("-", "")
    return text if plain.isascii() and plain.isalnum() else quoted(text)
