"""Size and power of the tests of extensions: made-up results turn every verdict round; one flight end to end."""

from __future__ import annotations

import pytest

from stoop_studies.verify.extensions import examine


def test_one_flight() -> None:
    (result,) = examine({"case": "lag-aileron", "seed": 1}, [None])
    (found,) = result["flights"]
    assert found["named"]
    assert found["harm"] > 5.0
    assert found["value"] == pytest.approx(0.04, abs=0.02)
