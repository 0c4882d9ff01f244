"""What a verb writes: files that are whole, and that their readers read."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from studies.robustness.trials import BrokenPromiseError

from stoop.base.toml import parse_source
from stoop.errors import StoopError
from stoop.flight import load
from stoop.results.result import from_json, to_json
from stoop.vehicle import load_vehicle


def check_outputs(written: Iterable[str], folder: Path) -> None:
    """Look for the files that a verb writes, by pattern, and read all."""
    for name in written:
        if not any(folder.glob(name)):
            raise BrokenPromiseError(f"{name} was not written")
    results = [path.read_text("utf-8") for path in folder.glob("out/result.json")]
    refused = any('"estimates-refused"' in text for text in results)  # what is said need not hold
    for pattern in ("out/**/*", "[mv].toml", "simulated.*", "written.*", "linear.json"):
        for path in filter(Path.is_file, folder.glob(pattern)):
            if not (refused and path.name == "vehicle.toml"):
                check_file(path)


def strict_json(text: str, name: str) -> Any:
    """Read JSON without NaN and infinities."""

    def refuse(word: str) -> float:
        raise BrokenPromiseError(f"{name} holds {word}")

    try:
        return json.loads(text, parse_constant=refuse)
    except ValueError as error:
        raise BrokenPromiseError(f"{name} is no JSON: {error}") from error


def check_file(path: Path) -> None:
    """Read an output by its own reader."""
    if path.name.startswith(".") or not path.stat().st_size:
        raise BrokenPromiseError(f"{path.name} was left behind or is empty")
    reader = READERS.get(path.name) or READERS.get(path.suffix)
    if reader is not None:
        try:
            reader(path)
        except (StoopError, ET.ParseError, UnicodeDecodeError) as error:
            raise BrokenPromiseError(f"{path.name} cannot be read: {error}") from error


def _read_json(path: Path) -> None:
    strict_json(path.read_text("utf-8"), path.name)


def _read_result(path: Path) -> None:
    _read_json(path)
    if to_json(from_json(path.read_text("utf-8"))) != path.read_text("utf-8"):
        raise BrokenPromiseError("result.json reads as another result")


def _read_page(path: Path) -> None:
    text = path.read_text("utf-8").strip().lower()
    if not (text.startswith("<!doctype html") and text.endswith("</html>")):
        raise BrokenPromiseError(f"{path.name} is cut off")


READERS: Final[Mapping[str, Callable[[Path], Any]]] = {
    "result.json": _read_result,
    ".json": _read_json,
    ".html": _read_page,
    "vehicle.toml": load_vehicle,
    "v.toml": load_vehicle,
    ".toml": lambda path: parse_source(path.read_text("utf-8"), path.name, StoopError),
    ".nc": load,
    ".xml": ET.parse,
}  #: name or ending -> how it is read
