"""Windows amid gusts: each kind of input is found, gusts are none, and made-up figures turn every verdict round."""

from __future__ import annotations

import pytest

from stoop.errors import FlightError
from stoop.input_design.windows import find_windows
from stoop_studies.verify.windows import CASES, held


@pytest.mark.parametrize("case", [c for c in CASES if c.endswith("moderate") and "gusts" not in c])
def test_inputs_are_found(case: str) -> None:
    flown = CASES[case](7)
    assert len(flown.spans) == 3
    found = find_windows({flown.flight.name: flown.flight})
    assert all(held(found, span) for span in flown.spans)
    assert all(any(w.start < b and a < w.stop for a, b in flown.spans) for w in found.windows)


@pytest.mark.parametrize("case", [c for c in CASES if "gusts" in c])
def test_gusts_are_no_maneuver(case: str) -> None:
    flown = CASES[case](7)
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({flown.flight.name: flown.flight}, flown.start)
