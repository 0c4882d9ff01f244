"""The pages' templates: everything is escaped, nothing undefined passes silently."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from stoop.base.numbers import number


@cache
def environment() -> Environment:
    """Return where templates are found and how they are filled."""
    found = Environment(
        loader=PackageLoader("stoop.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters["number"] = number
    return found
