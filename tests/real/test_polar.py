"""The drag polar of a 9.4 kg solar airplane beside the published one (Sharpe and Hansman, SciTech 2024)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.errors import FlightError
from stoop.flight import Flight, load
from stoop.performance.polar import Propulsion
from stoop.workflow.reconstruction import drag_polar

PUBLISHED = {0.5: (0.052, 0.046, 0.063), 1.0: (0.065, 0.056, 0.072)}
"""CL -> CD and its 75 % interval, read off the published figure (SOURCE.md, figures of the repository)."""
QUANTILE_75 = 1.150  #: of the normal distribution
WINDOW = (1116.3, 1379.3)  #: s on the log's clock; flight window of SOURCE.md


def test_drag_agrees_with_the_published_polar_within_both_errors(shared_data: Path, tmp_path: Path) -> None:
    flight = load(shared_data / "mit-solar-surfer-px4csv")
    polar = drag_polar(flight, 9.4, 1.499, [WINDOW])[0]
    for CL, (CD, low, high) in PUBLISHED.items():
        value, std = polar.drag(np.array([CL]))
        theirs = (high - low) / 2.0 / QUANTILE_75
        assert abs(value[0] - CD) < 1.96 * np.hypot(std[0], theirs)
        assert 0.003 < std[0] < 0.015
    # about 92 W at 9.8 m/s, 150 W at 13 m/s, 300 W at 16 m/s, read off the figure
    value, std = polar.level_power(np.array([9.8, 13.0, 16.0]))
    assert np.all(np.abs(value - [92.0, 150.0, 300.0]) < 2.0 * std)
    fine = np.linspace(8.5, 16.0, 200)
    assert fine[int(np.argmin(polar.level_power(fine)[0]))] == pytest.approx(9.8, abs=1.5)
    value, error = polar.summary["efficiency"]  # an assumption that stays one
    assert 0.5 < value < 0.9
    assert error > 0.05
    for mass, area, efficiency, words in (
        (9400.0, 1.499, 0.7, "check the units"),  # grams
        (9.4, 149.9, 0.7, "check the units"),  # square decimeters
        (1e300, 1.499, 0.7, "check the units"),
        (9.4, 1.499, 70.0, "more than all"),  # percent
    ):
        with pytest.raises(FlightError, match=words):
            drag_polar(flight, mass, area, [WINDOW], Propulsion(efficiency))
    (tmp_path / "m.toml").write_text(
        '[time]\ncolumn = "t_s"\nunit = "s"\n[variables]\np = {column = "p_rps", unit = "rad/s", file = "plane_bodyrate.csv"}\n'
    )
    bare = load(shared_data / "stanford-skywalker-10hz", tmp_path / "m.toml")
    with pytest.raises(FlightError, match="a drag polar needs V, alpha"):
        drag_polar(bare, 2.47, 0.39)


def test_a_flight_in_which_power_tells_nothing_says_so(vtail_flight: Flight) -> None:
    _, notices = drag_polar(vtail_flight, 8.5, 0.66)
    assert any(one.code == "drag-not-identifiable" for one in notices)
