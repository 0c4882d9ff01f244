"""What ``validation.json`` holds, schema ``stoop-validation/1``: see ``docs/validation.md``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from stoop.results.result import ManeuverResult, plain

SCHEMA: Final = "stoop-validation/1"


@dataclass(frozen=True, eq=False)
class Validation:
    """A fitted model against flights that it was not fitted to.

    Attributes
    ----------
    vehicle : str
        Its name.
    result : str
        SHA-256 of the ``result.json`` that was validated.
    maneuvers : tuple of ManeuverResult
        With the same figures as in ``result.json``.
    compared, better : int
        Channels that have a figure of the trivial model, and in how many of them the model beats it.
    warnings, notes : tuple of str
        Plain words: what is doubtful, and what was found while preparing the data.
    versions, inputs : mapping of str to str
        As in ``result.json``.
    command : str
        How it was made.
    """

    vehicle: str
    result: str
    maneuvers: tuple[ManeuverResult, ...]
    compared: int
    better: int
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    command: str = ""

    def to_json(self) -> str:
        """Return the validation as JSON text; NaN and infinities become ``null``."""
        document = {"schema": SCHEMA, **plain(self)}
        return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
