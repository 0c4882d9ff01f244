"""The reference of the Python interface names all of it, and what it names exists."""

from __future__ import annotations

import importlib
import re
from functools import reduce

import stoop
from docs.pages import DOCS

LIST = re.compile(r"^\.\. autosummary::\n(?:   :.*\n)*\n((?:   \S+\n)+)", re.MULTILINE)


def listed() -> list[str]:
    """Return the names that the lists of the page give pages of their own, as they stand there."""
    page = (DOCS / "api.md").read_text("utf-8")
    return [name for found in LIST.findall(page) for name in found.split()]


def test_every_public_name_is_documented() -> None:
    assert set(stoop.__all__) <= set(listed())


def test_what_is_listed_exists_and_says_what_it_is() -> None:
    names = listed()
    assert len(names) == len(set(names)) > 30
    for name in names:
        path = name.split(".")
        for i in range(len(path)):
            try:
                importlib.import_module(".".join(("stoop", *path[:i])))
            except ModuleNotFoundError:
                break
        assert (reduce(getattr, path, stoop).__doc__ or "").strip(), name


def test_public_names_exist_and_complete() -> None:
    assert set(stoop.__all__) <= set(dir(stoop))
    for name in stoop.__all__:
        assert getattr(stoop, name) is not None
    assert callable(stoop.simulate)
    assert callable(stoop.design)
    assert callable(stoop.export)
