"""What pydantic finds wrong with a file, in one line for the person who wrote it: key, fault, remedy."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

_TAGS = ("kind", "shape")  #: keys that choose among tables
_REMEDIES = {
    "missing": "missing; add it",
    "model_type": "this must be a table; write its keys below it",
    "dict_type": "this must be a table; write its keys below it",
    "tuple_type": "this must be a list; write it in square brackets",
    "string_pattern_mismatch": "a name is letters, digits and _, the first a letter; rename it",
    "string_too_long": "too long; shorten it",
    "too_long": "too many entries; remove some",
}


def first_complaint(
    error: ValidationError,
    raw: Mapping[str, Any],
    model: type[BaseModel],
    usual: Callable[[str], str] | None = None,
) -> str:
    """Return the first of an error's complaints as ``key: what is wrong; what to write``; of an unknown key, if there is one.

    Parameters
    ----------
    error : ValidationError
    raw : mapping
        What was validated: tells keys of the file from pydantic's own notes on where it was.
    model : type of BaseModel
        Knows which keys could have been meant.
    usual : callable, optional
        Returns the usual size of a key that is missing, in words; empty where it knows none.
    """
    # a misspelled key is missing under its name
    first = min(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")
    key, message = _key(first, raw), _message(first, model)
    if first["type"] == "missing" and usual is not None and (size := usual(key)):
        message = f"{message} ({size})"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    return f"{key}: {message}{more}" if key else f"{message}{more}"


def _key(first: Any, raw: Any) -> str:
    path, here, tagged = [], raw, False
    for part in first["loc"]:
        if not tagged and isinstance(here, Mapping) and part in [here.get(t) for t in _TAGS]:
            tagged = True
        elif part in here if isinstance(here, Mapping) else isinstance(here, list) and isinstance(part, int):
            path.append(str(part))
            here, tagged = here[part] if isinstance(here, Mapping) or part < len(here) else None, False
    if first["type"] == "missing" and isinstance(first["loc"][-1], str):
        path.append(first["loc"][-1])
    return ".".join(path)


def _message(first: Any, model: type[BaseModel]) -> str:
    kind, context = first["type"], first.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key; remove it or correct its name ({_known(first['loc'], model)})"
    if kind == "missing" and isinstance(first["loc"][-1], int):
        return "too few entries; write one more"
    if kind == "union_tag_not_found":
        return f"the key {context['discriminator']} is missing; it says which of several tables this is"
    if kind == "union_tag_invalid":
        return f"{context['discriminator']} is '{context['tag']}'; choose one of {context['expected_tags']}"
    plain = first["msg"].removeprefix("Value error, ")
    if kind in _REMEDIES or kind == "value_error":
        return _REMEDIES.get(kind) or plain
    if plain.startswith("Input "):
        return f"{plain.replace('Input should', 'it must')}; correct it"
    return f"{plain[:1].lower()}{plain[1:]}; correct it"


def _known(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Say which keys a table knows, the nearest to the wrong one first."""
    tables = [model]
    for part in location[:-1]:
        holders = [m for m in tables if part in m.model_fields]
        inner = [t for m in holders for t in _tables(m.model_fields[str(part)].annotation)]
        # the tables that a tag chooses; a part that is no tag is a name of the user's
        fields_of = [(m, m.model_fields[t].annotation) for m in tables for t in _TAGS if t in m.model_fields]
        tables = inner or [m for m, values in fields_of if part in get_args(values)] or tables
    fields = list(dict.fromkeys(f.alias or name for m in tables for name, f in m.model_fields.items()))
    near = difflib.get_close_matches(str(location[-1]), fields, 1)
    return f"did you mean {near[0]}?" if near else "known here: " + ", ".join(fields)


def _tables(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [t for a in get_args(annotation) for t in _tables(a)]
