import math

import pytest

from stoop.errors import VehicleError
from stoop.vehicle_draft.geometry import WINGED, Geometry

GIVEN = """
template = "conventional"
mass = 8.5
center_of_gravity = [-0.09, 0.0, 0.0]
[wing]
area = 0.66
span = 2.32
taper = 0.8
sweep = 0.0
dihedral = 0.05
position = [0.0, 0.0, 0.0]
[tail]
area = 0.12
span = 0.7
position = [-1.0, 0.0, 0.0]
elevator = { chord = 0.3, span = [0.0, 1.0] }
"""


def test_typical_geometry_is_complete():
    for template in WINGED:
        geometry = Geometry.typical(template, 3.4, 2.1, area=0.75)
        assert geometry.wing.chord == pytest.approx(0.75 / 2.1)
        assert "NaN" not in geometry.model_dump_json()
        assert (geometry.tail is None) == (template == "flying-wing")
        assert {"wing.taper", "center_of_gravity.x"} <= set(geometry.spread)


def test_what_a_file_has_stands_and_has_no_spread():
    geometry = Geometry.parse(GIVEN, "g.toml")
    assert (geometry.wing.taper, geometry.tail.area) == (0.8, 0.12)
    assert not {"wing.taper", "tail.area", "tail.position.x", "center_of_gravity.x"} & set(geometry.spread)
    assert {"fin.area", "tail.taper", "wing.aileron.chord"} <= set(geometry.spread)
    assert math.isfinite(geometry.fin.position[0])


def test_contradictions_are_one_line():
    for old, new, message in (
        ("span = 2.32", "span = 2.32\nchord = 0.4", "wing.area: 0.66 m2 is not span times chord, 2.32 x 0.4"),
        ("span = 2.32", "", "wing: needs two of area, span and chord, has area; with 8.5 kg"),
        ("position = [-1.0", "position = [1.0", "tail.position: the quarter chord is at x = "),
        ("area = 0.12", "area = 0.7", "tail.area: 0.7 m2 is more than the 0.66 m2 of the wing"),
        ("[-0.09,", "[-1.9,", "center_of_gravity: x = -1.9 m is far from the wing"),
        ("span = [0.0, 1.0]", "span = [0.9, 0.1]", "tail.elevator.span: [0.9, 0.1] runs inward"),
        ('"conventional"', '"flying-wing"', "tail: a flying-wing has none"),
        ('"conventional"', '"hexa"', "template: hexa has no wing"),
        ('"conventional"', '"biplane"', "template: it must be"),
        ("taper = 0.8", "tapper = 0.8", "wing.tapper: unknown key; remove it or correct its name (did you mean taper?)"),
        ("dihedral = 0.05", "dihedral = 5.0", "wing.dihedral: 5 rad is 286 deg"),
        ("mass = 8.5", "mass = -1.0", "mass: it must be greater than 0"),
        ("position = [0.0, 0.0, 0.0]", "position = [0.0, 0.3, 0.0]", "wing.position: y is 0.3"),
    ):  # fmt: skip
        with pytest.raises(VehicleError) as caught:
            Geometry.parse(GIVEN.replace(old, new, 1), "g.toml")
        assert str(caught.value).startswith(f"g.toml: {message}")
        assert "\n" not in str(caught.value)
