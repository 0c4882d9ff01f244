"""JSON as one text per value, so that equal values are equal bytes."""

from __future__ import annotations

import json
from typing import Any, TypeAlias

from stoop.errors import CampaignError

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
_PLAIN = (bool, int, float, str)


def to_text(value: Any, what: str) -> str:
    """Return the canonical text of a value: keys sorted, no blanks, ASCII only, floats to the last bit.

    JSON has no word for infinity and nan; as Python, SQLite and JavaScript do, they are written ``Infinity`` and
    ``NaN``.

    Parameters
    ----------
    value : Json
    what : str
        Names the value in the error.

    Raises
    ------
    CampaignError
        The value is not made of None, bool, int, float, str, list and dict with str keys: read back, it would be
        another one.
    """
    try:
        _check(value, what)
        return json.dumps(value, sort_keys=True, separators=(",", ":"))
    except (RecursionError, ValueError) as error:
        raise CampaignError(
            f"{what}: cannot be written as JSON ({error}); make it flatter or smaller"
        ) from None


def from_text(text: str) -> Json:
    """Return the value of a text that :func:`to_text` wrote."""
    value: Json = json.loads(text)
    return value


def _check(value: Any, where: str) -> None:
    """Refuse what would come back as something else."""
    if value is None or isinstance(value, _PLAIN):
        return
    if isinstance(value, list):
        for i, item in enumerate(value):
            _check(item, f"{where}[{i}]")
    elif isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                raise CampaignError(
                    f"{where}: the key {key!r} is no text; JSON has no other keys, use str(key)"
                )
            _check(item, f"{where}[{key!r}]")
    else:
        raise CampaignError(f"{where}: a {type(value).__name__} is not JSON; make it {_remedy(value)}")


def _remedy(value: Any) -> str:
    """Say what to call on a value."""
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars
        return "a list or number with .tolist()"
    return "a list" if isinstance(value, tuple | set | frozenset) else "numbers, texts, lists and dicts"
