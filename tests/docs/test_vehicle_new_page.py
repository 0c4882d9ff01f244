"""The page of drafted vehicle files: its figures are those of the code."""

from __future__ import annotations

from docs.pages import DOCS, table
from stoop.vehicle_draft.inertia import PUBLISHED, of_airplane

PAGE = DOCS / "vehicle-new.md"


def test_inertias() -> None:
    rows = table(PAGE, "Inertia", "aircraft").rows
    assert [row[0] for row in rows] == list(PUBLISHED)
    for name, template, mass, span, *moments in rows:
        one = PUBLISHED[name]
        assert (template, mass, span) == (one.template, f"{one.mass:g}", f"{one.span:g}")
        drafted = of_airplane(one.template, one.mass, one.span)
        said = [f"{getattr(one, axis):.3g}, {drafted[axis].value:.3g}" for axis in ("xx", "yy", "zz")]
        assert moments == said
