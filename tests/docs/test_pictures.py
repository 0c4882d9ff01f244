"""Pictures: each is on a page and says what it shows; they are drawn when they are older than what they are made of."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from docs.pages import DOCS

sys.path.insert(0, str(DOCS))
pytest.importorskip("matplotlib")

from pictures import flights, registry, rotors, turbulence
from pictures.sketch import PALETTES

from stoop.vehicle.builtin import resolve_vehicle

SHOWN = re.compile(r"^```\{picture\} (\S+)\n((?::[^\n]*\n)*)(.*?)^```", re.MULTILINE | re.DOTALL)


def test_every_picture_is_on_a_page_with_a_caption_and_a_text() -> None:
    shown = [found for page in sorted(DOCS.glob("*.md")) for found in SHOWN.findall(page.read_text("utf-8"))]
    known = registry.pictures()
    explained = {n for n, options, _ in shown if ":bare:" not in options or n.startswith("door-")}
    assert {name for name, _, _ in shown} == set(known) == explained
    assert all(len(p.alternative) > 20 and p.alternative.endswith(".") for p in known.values())
    assert all(c.strip().endswith((".", ":")) for name, _, c in shown if not name.startswith("door-"))


def test_a_picture_is_drawn_for_light_and_for_dark_pages_when_it_is_old(tmp_path: Path) -> None:
    one = registry.pictures()["deflection-elevator"]
    assert one in registry.outdated(tmp_path)
    assert registry.draw(one, tmp_path) == []
    assert one not in registry.outdated(tmp_path)
    light, dark = ((tmp_path / name).read_text("utf-8") for name in one.files())
    back = dict(zip(PALETTES["dark"].values(), PALETTES["light"].values(), strict=True))
    assert re.sub(r"#[0-9a-f]{6}", lambda m: back.get(m[0], m[0]), dark) == light != dark


def test_sketched_signs_are_those_of_the_simulation() -> None:
    """Elevator down turns the nose down, aileron right wing down, rudder nose left; rotors stand as their file says."""
    for control, rate, sign in (("elevator", "q", -1.0), ("aileron", "p", 1.0), ("rudder", "r", -1.0)):
        flown = flights.flight(0.8, (control, "pulse", 0.2, 2.0, 0.03), noise=False)
        assert sign * flown.column(rate)[-1] > 0.01
    assert rotors.hubs(resolve_vehicle("quad-x"))["m1"] == (0.177, 0.177)  # front right
    change = rotors.shares(resolve_vehicle("quad-x"))
    assert (np.sign(change).T == [[-1, 1, 1, -1], [1, -1, 1, -1], [1, 1, -1, -1], [1, 1, 1, 1]]).all()


def test_gusts_of_the_equations_have_the_spectra_of_the_standard() -> None:
    speed, found = turbulence.filters()
    for axis in "uw":
        A, b = found[axis]
        for omega in np.logspace(-4.0, 0.0, 9):
            H = turbulence.SUM[axis] @ np.linalg.solve(1j * speed * omega * np.eye(len(b)) - A, b)
            expected = turbulence.dryden(axis, omega)
            assert abs(H) ** 2 * speed / np.pi == pytest.approx(expected, rel=1e-6)
