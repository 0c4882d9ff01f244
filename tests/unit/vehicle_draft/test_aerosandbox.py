import sys

import pytest

from stoop.errors import VehicleError
from stoop.vehicle_draft import aerosandbox, handbook
from stoop.vehicle_draft.geometry import Geometry


@pytest.mark.parametrize("template", ["conventional", "v-tail", "flying-wing"])
def test_agrees_with_the_handbook(template):
    """Two methods that share no code for the surfaces: strip theory and a vortex lattice."""
    geometry = Geometry.typical(template, 3.4, 2.1, 0.36)
    expected = handbook.derivatives(geometry, 18.0)
    found = aerosandbox.derivatives(geometry, 18.0)
    assert list(found) == list(expected)
    z = {name: (a.value - expected[name].value) / a.std for name, a in found.items()}
    assert max(map(abs, z.values())) < 3.0, z
    assert sum(v**2 for v in z.values()) < len(z), z
    assert {a.source for a in found.values()} == {"AeroSandbox vortex lattice"}


def test_rates_are_about_the_center_of_gravity():
    """A wing without tail and sweep: CLq by the pitch rate at three quarters of the chord, 2 CLalpha (x_cg - x_3/4)/c."""
    wing = {"area": 4.0, "span": 8.0, "position": [3.0, 0.0, 0.0]} | dict.fromkeys(("sweep", "dihedral"), 0.0)
    tiny = {"area": 1e-5, "span": 0.01}
    raw = {"template": "flying-wing", "mass": 10.0, "wing": wing | {"taper": 1.0}, "fin": tiny}
    geometry = Geometry.of(raw | {"center_of_gravity": [2.9, 0.0, 0.0]}, "rectangle")
    found = aerosandbox.derivatives(geometry, 20.0)
    assert found["CLq"].value == pytest.approx(2.0 * found["CLalpha"].value * (2.9 - 2.625) / 0.5, rel=0.05)


def test_a_missing_package_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    with pytest.raises(VehicleError, match=r"pip install '\.\[geometry\]'"):
        aerosandbox.derivatives(Geometry.typical("glider", 2.0, 2.5, 0.2), 12.0)
