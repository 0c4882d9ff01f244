"""The reference of the Python interface names all of it."""

from __future__ import annotations

import re

import stoop
from docs.pages import DOCS


def test_every_public_name_is_documented() -> None:
    page = (DOCS / "api.md").read_text("utf-8")
    named = set(re.findall(r"auto(?:function|class|module):: stoop\.(\w+)\b", page))
    assert set(stoop.__all__) <= named


def test_public_names_exist_and_complete() -> None:
    assert set(stoop.__all__) <= set(dir(stoop))
    for name in stoop.__all__:
        assert getattr(stoop, name) is not None
    assert callable(stoop.simulate)
    assert callable(stoop.design)
    assert callable(stoop.export)
