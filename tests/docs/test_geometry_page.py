"""The reference of geometry files: its examples load, its keys are the schema's, its errors are those that are raised."""

from __future__ import annotations

import pytest

from docs.pages import DOCS, blocks, tables
from stoop.errors import VehicleError
from stoop.vehicle_draft import geometry
from stoop.vehicle_draft.geometry import Geometry

PAGE = DOCS / "geometry.md"
SMALLEST, COMPLETE = blocks(PAGE, "toml")


def test_examples_load() -> None:
    assert len(Geometry.parse(SMALLEST, "my.toml").spread) > 30
    complete = Geometry.parse(COMPLETE, "my.toml")
    assert complete.spread == {}


def test_keys_are_those_of_the_schema() -> None:
    top, surface = (t for t in tables(PAGE) if t.heading == "Keys")
    assert {k.strip("`") for k in top.column("key")} == set(Geometry.model_fields) - {"spread"}
    known = {n for m in (geometry.Wing, geometry.Tail, geometry.Fin) for n in m.model_fields}
    controls = {"aileron", "elevon", "elevator", "ruddervator", "rudder"}
    assert {k.strip("`") for k in surface.column("key of a surface")} == known - controls


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("span = 2.32", "span = 2.32\nchord = 0.4"),
        ("span = 2.32", "span = 2.32\n[tail]\nposition = [1.0, 0.0, 0.0]"),
        ("span = 2.32", "span = 2.32\ndihedral = 5.0"),
        ("span = 2.32", ""),
    ],
)
def test_errors(old: str, new: str) -> None:
    with pytest.raises(VehicleError) as caught:
        Geometry.parse(SMALLEST.replace(old, new), "my.toml")
    shown = blocks(PAGE, "text")[0].splitlines()
    assert f"stoop: error: {caught.value}" in shown
