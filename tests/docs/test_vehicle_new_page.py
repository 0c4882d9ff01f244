"""The page of drafted vehicle files: its figures are those of the code."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from docs.pages import DOCS, ROOT, commands, table
from stoop.cli.main import main
from stoop.results.result import read_result
from stoop.vehicle.builtin import resolve_vehicle
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


def test_quadrotor_by_defaults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The printed commands give the printed table, within its rounding and half a standard error."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    for command in commands(PAGE):
        assert main(shlex.split(command)[1:]) == 0
    drafted, truth = resolve_vehicle("quad.toml"), resolve_vehicle("quad-x")
    found = read_result("result/result.json").parameters
    for name, start, estimate, error, true in table(PAGE, "A quadrotor by defaults", "parameter").rows:
        one, sigma = found[name], float(error)
        assert drafted.value(name) == pytest.approx(float(start), rel=0.03)
        assert one.estimate == pytest.approx(float(estimate), abs=0.5 * sigma)
        assert one.std_error == pytest.approx(sigma, rel=0.5)
        assert truth.value(name) == float(true)
        assert abs(one.estimate - float(true)) < 3.0 * sigma
