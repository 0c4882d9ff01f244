"""Windows of real flights: those that people chose are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.flight import Flight, load
from stoop.input_design.windows import find_windows
from stoop.vehicle import load_vehicle

EXAMPLES = Path(__file__).parents[2] / "examples"
FLOWN = (
    (140.5, 145.0),
    (146.0, 151.5),
    (161.6, 168.3),
    (188.1, 195.1),
)  #: roll, pitch, yaw, roll; docs/vtail.md


def test_the_doublets_of_the_v_tail_are_found_without_a_vehicle(vtail_flight: Flight) -> None:
    flight = vtail_flight
    found = find_windows({flight.name: flight})
    kept = [w for w in found.windows if w.accept]
    assert [w.axis for w in kept] == ["roll", "pitch", "yaw", "roll"]
    for window, (start, stop) in zip(kept, FLOWN, strict=True):
        assert window.start == pytest.approx(start, abs=0.5)
        assert window.stop == pytest.approx(stop, abs=0.5)
    assert [w.axis for w in kept if w.use == "validate"] == ["roll"], "the axis that was flown twice"


def test_the_doublets_of_the_v_tail_tell_its_numbers(vtail_flight: Flight) -> None:
    flight = vtail_flight
    found = find_windows({flight.name: flight}, load_vehicle(EXAMPLES / "vtail.toml"))
    kept = [w for w in found.windows if w.accept]
    for start, stop in FLOWN:
        assert any(w.start < 0.5 * (start + stop) < w.stop for w in kept)
    assert max(w.stop for w in kept) < 245.0, "it lands hard after that"
    assert all(e.std_error > 0.0 for e in found.expected)


def test_climbs_and_sprints_of_the_hexacopter_are_found(shared_data: Path) -> None:
    flight = load(shared_data / "altlnt-hexacopter-px4", EXAMPLES / "hexacopter_mapping.toml")
    found = find_windows({flight.name: flight}, load_vehicle(EXAMPLES / "hexacopter.toml"))
    kept = [w for w in found.windows if w.accept]
    assert any(214.0 < w.start < 260.0 for w in kept), "the sprints"
    expected = {e.name: e.relative for e in found.expected}
    assert expected["rotors.T2"] < 0.3
    assert 0.005 < expected["rotors.lag"] < 0.5
