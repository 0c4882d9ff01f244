import math
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from helpers.command_line import Done, Refused

from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.units import STANDARD_GRAVITY
from stoop.cli.main import main
from stoop.errors import VehicleError
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.defaults import EQUATION_1
from stoop_draft.vehicle_draft import aerosandbox, handbook
from stoop_draft.vehicle_draft.apriori import shifted, typical_std
from stoop_draft.vehicle_draft.geometry import WINGED, Geometry
from stoop_draft.vehicle_draft.handbook import derivatives, nominal, skin_friction
from stoop_draft.vehicle_draft.request import Evidence, Request
from stoop_draft.vehicle_draft.strips import flap_effectiveness, lift_slope
from stoop_draft.vehicle_new import asked

SIGNS = {
    "CLalpha": 1, "CD0": 1, "CDalpha": 1, "Cmq": -1, "CLelevator": 1, "Cmelevator": -1, "CQbeta": -1, "Clp": -1,
    "Clr": 1, "Claileron": 1, "Cnr": -1, "Cnrudder": -1, "CQrudder": 1, "Cnaileron": -1,
}  # fmt: skip
NO_FIN = {"area": 1e-6, "span": 0.002}
THIN = {"length": 1.0, "width": 0.001, "height": 0.001}
FLAT = {"taper": 1.0, "sweep": 0.0, "dihedral": 0.0}
WING = FLAT | {"area": 4.0, "span": 8.0, "position": [0.125, 0.0, 0.0]}
ELEVATOR = {"chord": 0.3, "span": [0.0, 1.0]}
TAIL = FLAT | {"area": 0.8, "span": 2.0, "position": [-1.9, 0.0, 0.0], "elevator": ELEVATOR}


def bare_wing(**changes):
    """Return a wing alone: no body or fin to speak of, unswept, flat, pitching about its quarter chord."""
    body = THIN | {"position": [0.5, 0.0, 0.0]}
    raw = {"template": "flying-wing", "mass": 10.0, "center_of_gravity": [0.0, 0.0, 0.0]}
    return Geometry.of(raw | {"wing": WING | changes, "fin": NO_FIN, "fuselage": body}, "wing")


def values(geometry, lift=0.0, alpha=0.0):
    return nominal(geometry, handbook.WorkingPoint(20.0, alpha, lift))


@pytest.mark.parametrize("template", WINGED)
def test_signs_and_terms(template):
    found = derivatives(Geometry.typical(template, 3.4, 2.1, 0.36), 18.0)
    terms = {name for group in EQUATION_1.values() for name in group}
    assert set(found) == {n for n in terms if template != "flying-wing" or "rudder" not in n}
    for name, a in found.items():
        assert math.isfinite(a.value)
        assert a.std > 0.0
        assert a.value * SIGNS.get(name, 0) >= 0.0, name


def test_textbook_values_of_sections():
    """Lift slope: 2 pi of an airfoil; pi A / 2 of a slender wing (Jones); lifting line of an elliptic wing of A = 20.

    A flap of half of the chord: 1/2 + 1/pi and -1/2; all of it is a change of incidence (Glauert). Skin friction at
    Re = 1e7: 0.0030 (Schlichting, Boundary-Layer Theory, fig. 21.2).
    """
    assert lift_slope(1e6, 0.0) == pytest.approx(2.0 * math.pi, rel=1e-5)
    assert lift_slope(0.01, 0.0) == pytest.approx(0.5 * math.pi * 0.01, rel=1e-4)
    assert lift_slope(20.0, 0.0) == pytest.approx(2.0 * math.pi / (1.0 + 2.0 / 20.0), rel=0.007)
    assert flap_effectiveness(0.5) == pytest.approx((0.5 + 1.0 / math.pi, -0.5))
    assert flap_effectiveness(1.0 - 1e-12)[0] == pytest.approx(1.0, abs=1e-5)
    assert skin_friction(1e7) == pytest.approx(0.0030, abs=5e-5)


def test_a_wing_alone():
    found = values(bare_wing())
    slope = handbook.wing_slope(bare_wing().wing)
    half = lift_slope(8.0, 0.0, handbook.SECTION)
    assert found["CLalpha"] == pytest.approx(slope, rel=1e-3)
    assert found["Cmalpha"] == pytest.approx(0.0, abs=2e-3)
    assert found["CLq"] == pytest.approx(slope, rel=2e-3)  # wash at 3/4 of the chord: 2 CLalpha / 2
    # an elliptic load of antisymmetric slope: -a/8 (Glauert)
    assert found["Clp"] == pytest.approx(-half / 8.0, rel=5e-3)
    for name in ("CQbeta", "Clbeta", "Cnbeta", "Clr", "Cnp", "CQp", "CQr"):
        assert found[name] == pytest.approx(0.0, abs=2e-3), name


def test_a_wing_alone_that_lifts_and_one_with_dihedral():
    """Elliptic lifting line: Cnp = -CL/8 (tilt) + 3 CL/(pi A) a/8 (induced drag), Clr = CL/8 (1 + a(A/2)/a(A)) (Glauert).

    The right half sees beta sin(dihedral): Clbeta = -a(A/2) dihedral times the arm of half an ellipse, 2/(3 pi).
    """
    geometry = bare_wing()
    found, lift = values(geometry, lift=0.5), 0.5
    slope, half = handbook.wing_slope(geometry.wing), lift_slope(8.0, 0.0, handbook.SECTION)
    tilt = 0.5 * (1.0 / 8.0 + 1.0 / 6.0)  # symmetric loads are half elliptic, half rectangular (Schrenk)
    assert found["Cnp"] == pytest.approx(-lift * tilt + 3.0 * lift / (math.pi * 16.0) * half / 8.0, rel=0.02)
    assert found["Clr"] == pytest.approx(lift * (tilt + half / slope / 8.0), rel=0.15)
    assert found["Cnaileron"] == pytest.approx(-3.0 * lift / (math.pi * 16.0) * found["Claileron"], rel=0.02)
    for angle in (0.1, -0.1):
        expected = -half * math.sin(angle) * 2.0 / (3.0 * math.pi)
        assert values(bare_wing(dihedral=angle))["Clbeta"] == pytest.approx(expected, rel=0.02)


def test_tail_of_a_textbook():
    """Elevator power and pitch damping are those of volume and arm (Nelson, eqs. 2.35 and 3.79)."""
    raw = {"template": "conventional", "mass": 10.0, "center_of_gravity": [0.0, 0.0, 0.0]}
    with_tail = Geometry.of(raw | {"wing": WING, "tail": TAIL, "fin": NO_FIN, "fuselage": THIN}, "tail")
    found, alone = values(with_tail), values(bare_wing())
    slope = handbook.wing_slope(with_tail.tail)
    volume = handbook.TAIL_PRESSURE * 0.8 * 2.0 / (4.0 * 0.5)
    effect = handbook.FLAP_EFFICIENCY * flap_effectiveness(0.3)[0]
    assert found["Cmelevator"] == pytest.approx(-volume * slope * effect, rel=0.06)
    downwash = handbook.downwash_slope(with_tail.wing, with_tail.tail)
    damping = -2.0 * slope * volume * 2.0 / 0.5 * (1.0 + downwash)
    assert found["Cmq"] - alone["Cmq"] == pytest.approx(damping, rel=0.12)


def test_v_tail_of_purser_and_campbell():
    """NACA TR 823: lift slope cos^2, side force sin^2 of the dihedral; the rest is the ratio of odd to even slopes."""
    wing = {"area": 4.0, "span": 8.0, "dihedral": 0.0}
    raw = {"template": "v-tail", "mass": 10.0, "wing": wing, "fuselage": THIN}
    found = {}
    for dihedral in (0.5, 0.9):
        tail = {"area": 0.8, "span": 2.0, "dihedral": dihedral, "position": [-2.0, 0.0, 0.0]}
        found[dihedral] = values(Geometry.of(raw | {"tail": tail}, "v"))
    ratio = {name: found[0.9][name] / found[0.5][name] for name in ("CQbeta", "CLelevator")}
    assert ratio["CQbeta"] == pytest.approx((math.sin(0.9) / math.sin(0.5)) ** 2, rel=0.02)
    assert ratio["CLelevator"] == pytest.approx(math.cos(0.9) / math.cos(0.5), rel=0.02)


def test_the_spread_is_that_of_draws():
    sizes = Geometry.typical("conventional", 8.5, 2.32, area=0.66)
    measured = sizes.model_copy(update={"spread": {}})
    wide, narrow = derivatives(sizes, 20.0), derivatives(measured, 20.0)
    assert all((a.value, a.std <= wide[name].std) == (wide[name].value, True) for name, a in narrow.items())
    rng = np.random.default_rng(1)
    keep = ("wing.dihedral", "center_of_gravity.x", "tail.incidence", "wing.aileron.chord", "fin.sweep")
    sizes = sizes.model_copy(update={"spread": {k: 0.3 * sizes.spread[k] for k in keep}})
    draws = []
    for _ in range(60):
        drawn = sizes
        for path, std in sizes.spread.items():
            drawn = shifted(drawn, path, std * rng.standard_normal())
        draws.append(values(drawn, 0.3))
    expected = typical_std(sizes, lambda g: values(g, 0.3))
    for name in ("Clbeta", "Cmalpha", "Claileron", "Cmelevator"):
        assert np.std([d[name] for d in draws]) == pytest.approx(expected[name], rel=0.3, abs=1e-6), name


def test_a_path_that_curves_moves_the_tail():
    """Terms of CL and Cm are those of the rate of alpha by the force equation of a straight start, by differences."""
    mass, V, density = 3.0, 15.0, 1.1
    geometry = Geometry.typical("conventional", mass, 2.0, 0.25, None)
    wing = geometry.wing
    published = handbook.derivatives(geometry, V, density=density)
    found = handbook.with_curved_path(geometry, density, published)
    point = handbook.WorkingPoint.of(geometry, V, None, density, None)
    nominal_, by_rate, h = nominal(geometry, point), handbook.lag(geometry), 1e-6

    def rate(V: float = 0.0, alpha: float = 0.0, elevator: float = 0.0) -> float:
        lift = point.lift + nominal_["CLalpha"] * alpha + nominal_["CLelevator"] * elevator
        speed = 15.0 * (1.0 + V)
        upward = 0.5 * density * speed**2 * wing.area * lift / mass - STANDARD_GRAVITY
        return -upward / speed * wing.chord / (2.0 * speed)  # times c/2V, at no pitch rate

    for name in ("alpha", "elevator", "V"):
        slope = (rate(**{name: h}) - rate(**{name: -h})) / (2.0 * h)
        for coefficient in ("CL", "Cm"):
            one, before = found[coefficient + name], published[coefficient + name]
            change = by_rate[f"{coefficient}q"] * slope
            assert one.value - before.value == pytest.approx(change, rel=1e-5)
            assert one.std == pytest.approx(np.hypot(before.std, 0.5 * change), rel=1e-5)
    assert found["CmV"].value > 0.03


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


GIVEN = """
template = "conventional"
mass = 8.5
center_of_gravity = [-0.09, 0.0, 0.0]
wing = { area = 0.66, span = 2.32, taper = 0.8, sweep = 0.0, dihedral = 0.05, position = [0.0, 0.0, 0.0] }
tail = { area = 0.12, span = 0.7, position = [-1.0, 0.0, 0.0], elevator = { chord = 0.3, span = [0.0, 1.0] } }
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
        ("span = 2.32", "span = 2.32, chord = 0.4", "wing.area: 0.66 m2 is not span times chord, 2.32 x 0.4"),
        ("span = 2.32, ", "", "wing: needs two of area, span and chord, has area; with 8.5 kg"),
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


DIMENSIONS = ["--template", "glider", "--mass", "2.1", "--span", "2.5", "--area", "0.4"]


def geometry(folder: Path) -> Path:
    path = folder / "g.toml"
    path.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    return path


def test_from_dimensions_or_a_geometry(tmp_path: Path, done: Done) -> None:
    target = tmp_path / "glider.toml"
    assert f"stoop trim {target}" in done(["vehicle", "new", *DIMENSIONS, "-o", target])
    vehicle = load_vehicle(target)
    assert vehicle.file.propulsion is None
    assert vehicle.value("reference.chord") == pytest.approx(0.16)
    assert main(["vehicle", "new", *DIMENSIONS, "-o", str(target)]) == 2
    done(["vehicle", "new", "--geometry", geometry(tmp_path), "-o", tmp_path / "v.toml"])
    assert load_vehicle(tmp_path / "v.toml").value("mass.mass") == 3.0


def test_derivatives_of_a_geometry_by_the_vortex_lattice(here: Path, done: Done) -> None:
    pytest.importorskip("aerosandbox")
    path = geometry(here)
    done(f"vehicle new -o v.toml --aerodynamics aerosandbox --geometry {path}")
    assert Path("v.toml").read_text("utf-8").count(aerosandbox.SOURCE) == 1
    vehicle, table = load_vehicle("v.toml"), Geometry.load(path)
    found = aerosandbox.derivatives(table, vehicle.value("reference.airspeed"))
    expected = handbook.with_curved_path(table, SEA_LEVEL_DENSITY, found)
    for name in ("CLalpha", "Cmq", "Clp", "Cnbeta"):
        assert vehicle.value(name) == pytest.approx(expected[name].value, rel=1e-3)


def test_without_the_vortex_lattice(here: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    command = f"vehicle new --geometry {geometry(here)} --aerodynamics aerosandbox -o v.toml"
    assert "pip install '.[geometry]'" in refused(command)


def test_questions() -> None:
    answers = iter(["kite", "conventional", "eight", "8.5", "2.3", "0.28", ""])
    shown: list[str] = []
    told: list[str] = []
    found = asked(Request(), Evidence(), lambda text: shown.append(text) or next(answers), told.append)
    assert (found.template, found.mass, found.span, found.chord) == ("conventional", 8.5, 2.3, 0.28)
    assert (found.engine, len(told)) == ("electric", 2)
    assert "usual" in shown[4]  # a span for this mass
    assert list(answers) == []


def test_the_end_of_the_answers_is_an_interruption() -> None:
    with pytest.raises(KeyboardInterrupt):
        asked(Request(), Evidence(), Mock(side_effect=EOFError), print)
