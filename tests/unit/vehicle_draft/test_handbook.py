import math

import pytest

from stoop.vehicle.defaults import EQUATION_1
from stoop.vehicle_draft.geometry import WINGED, Geometry
from stoop.vehicle_draft.handbook import derivatives

SIGNS = {
    "CLalpha": 1, "CD0": 1, "CDalpha": 1, "Cmq": -1, "CLelevator": 1, "Cmelevator": -1, "CQbeta": -1, "Clp": -1,
    "Clr": 1, "Claileron": 1, "Cnr": -1, "Cnrudder": -1, "CQrudder": 1, "Cnaileron": -1,
}  # fmt: skip


@pytest.mark.parametrize("template", WINGED)
def test_signs_and_terms(template):
    found = derivatives(Geometry.typical(template, 3.4, 2.1, 0.36), 18.0)
    terms = {name for group in EQUATION_1.values() for name in group}
    assert set(found) == (terms if template != "flying-wing" else {n for n in terms if "rudder" not in n})
    for name, a in found.items():
        assert math.isfinite(a.value)
        assert a.std > 0.0
        assert a.value * SIGNS.get(name, 0) >= 0.0, name
