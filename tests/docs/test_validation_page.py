"""The limits of the verdict that its page gives are those of the code."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from docs.pages import DOCS, table
from stoop.assessment.verdict import LIMITS

PAGE = DOCS / "validation.md"


def test_limits() -> None:
    shown = {row[0].strip("`"): float(row[1]) for row in table(PAGE, "The verdict", "limit").rows}
    assert shown == pytest.approx(asdict(LIMITS))
