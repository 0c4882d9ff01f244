"""A property of the app's drawings, which need its package."""

from __future__ import annotations

import pytest


def test_curves_are_not_drawn_across_gaps() -> None:
    plots = pytest.importorskip("stoop.app.plots")
    drawn = plots._path([[1.0, 2.0, None, 3.0, 4.0], [5.0]], 1.0, 0.0, 1.0)
    assert "".join(c for c in drawn if c.isalpha()) == "MLMLM"
