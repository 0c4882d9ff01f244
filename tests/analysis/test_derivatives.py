"""Derivatives: by hand from the coefficients of the file, by differences, along both axes, and their errors."""

import math

import numpy as np
import pytest

from stoop.errors import SimulationError
from stoop.simulation import linearize, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_analysis.derivatives import FORMS, LOADS, MOTIONS, Derivatives, ParameterCovariance, derivatives
from stoop_studies.verify.export import load

SIGMAS = {"CLalpha": 0.1, "Cmq": 1.0, "Clp": 0.02}


@pytest.fixture(scope="module")
def found(twin_boom: Vehicle) -> Derivatives:
    known = ParameterCovariance((*SIGMAS, "Cnr"), np.diag([*(s**2 for s in SIGMAS.values()), np.inf]))
    return derivatives(twin_boom, trim(twin_boom), known)


def named(of: Derivatives, form: str) -> dict[str, float]:
    table = of.table(form)
    return dict(zip(table.names, table.values.tolist(), strict=True))


def test_coefficients_are_those_of_the_file(twin_boom: Vehicle, found: Derivatives) -> None:
    """In stability axes C_Zalpha = -(C_Lalpha + C_D), C_Xalpha = C_L - C_Dalpha (Etkin and Reid, section 5.1)."""
    table, n = named(found.along("stability"), "nondimensional"), twin_boom.value
    alpha, elevator = found.alpha, trim(twin_boom).deflections["elevator"]
    CL = n("CL0") + n("CLalpha") * alpha + n("CLelevator") * elevator
    CD = n("CD0") + n("CDalpha") * alpha
    assert table["CZ_alpha"] == pytest.approx(-(n("CLalpha") + CD), rel=1e-9)
    assert table["CX_alpha"] == pytest.approx(CL - n("CDalpha"), rel=1e-9)
    assert table["CZ_q"] == pytest.approx(-n("CLq"), rel=1e-9)
    assert table["CZ_elevator"] == pytest.approx(-n("CLelevator"), rel=1e-9)
    for name in ("Cm_alpha", "Cm_q", "Cm_elevator"):
        assert table[name] == pytest.approx(n(name.replace("_", "")), rel=1e-9)
    # Constant thrust along the body: C_X falls with the speed as the dynamic pressure that divides it grows.
    force = 0.5 * n("environment.density") * 35.0**2 * n("reference.area")
    thrust = trim(twin_boom).changes["propulsion.thrust"]
    assert table["CX_u"] == pytest.approx(-2.0 * thrust * math.cos(alpha) / force, abs=1e-3)


def test_lateral_ones_turn_with_the_axes(twin_boom: Vehicle, found: Derivatives) -> None:
    """L' = c L + s N of rates p = c p' - s r': by hand for Cl_p and Cn_r."""
    table, n = named(found.along("stability"), "nondimensional"), twin_boom.value
    c, s = math.cos(found.alpha), math.sin(found.alpha)
    expected = c * c * n("Clp") + c * s * (n("Clr") + n("Cnp")) + s * s * n("Cnr")
    assert table["Cl_p"] == pytest.approx(expected, rel=1e-9)
    expected = c * c * n("Cnr") - c * s * (n("Clr") + n("Cnp")) + s * s * n("Clp")
    assert table["Cn_r"] == pytest.approx(expected, rel=1e-9)
    body = named(found, "nondimensional")
    assert body["Cl_p"] == pytest.approx(n("Clp"), rel=1e-9)
    assert body["Cn_rudder"] == pytest.approx(n("Cnrudder"), rel=1e-9)


def test_dimensional_ones_by_hand(twin_boom: Vehicle, found: Derivatives) -> None:
    """M_q = rho V S c^2 Cmq / 4 and L_p = rho V S b^2 Clp / 4 (Etkin and Reid, table 4.4); over Iyy, 1/s."""
    table, specific, n = named(found, "dimensional"), named(found, "specific"), twin_boom.value
    common = n("environment.density") * 35.0 * n("reference.area") / 4.0
    assert table["M_q"] == pytest.approx(common * n("reference.chord") ** 2 * n("Cmq"), rel=1e-9)
    assert table["L_p"] == pytest.approx(common * n("reference.span") ** 2 * n("Clp"), rel=1e-9)
    assert specific["M_q"] == pytest.approx(table["M_q"] / n("mass.inertia.yy"), rel=1e-12)
    assert specific["Z_w"] == pytest.approx(table["Z_w"] / n("mass.mass"), rel=1e-12)
    model = linearize(twin_boom, trim(twin_boom))
    q = model.states.index("q")
    assert specific["M_q"] == pytest.approx(model.A[q, q], rel=1e-9)


@pytest.mark.parametrize("name", ["crooked", "quad-x"])
def test_forces_and_moments_by_differences(name: str) -> None:
    vehicle = builtin_vehicle(name) if name == "quad-x" else load(name)
    point = trim(vehicle)
    found = derivatives(vehicle, point)
    rows = vehicle.parameter_rows(point.changes)
    n = vehicle.value
    xx, yy, zz, xy, xz, yz = (n(f"mass.inertia.{a}", 0.0) for a in ("xx", "yy", "zz", "xy", "xz", "yz"))
    tensor = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])

    def loads(states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        rates, _ = vehicle.kernel().evaluate(rows, states[:, None], inputs[:, None])
        speeds, turning = ([vehicle.states.index(a) for a in axes] for axes in ("uvw", "pqr"))
        V, w = states[speeds], states[turning]
        moment = tensor @ rates[turning, 0] + np.cross(w, tensor @ w)
        return np.concatenate([n("mass.mass") * (rates[speeds, 0] + np.cross(w, V)), moment])

    steady = vehicle.initial_states(point.start, rows, point.inputs)[:, 0]
    for j, motion in enumerate(MOTIONS):
        step = np.zeros(len(steady))
        step[vehicle.states.index(motion)] = 1e-5
        slope = (loads(steady + step, point.inputs) - loads(steady - step, point.inputs)) / 2e-5
        assert found.matrix[:, j] == pytest.approx(slope, rel=1e-5, abs=1e-5)
    if name == "quad-x":  # a motor's thrust after its lag has settled: T1 + 2 T2 x
        x = point.inputs[0]
        column = 6 + list(found.controls).index("motor_1")
        ratio = point.density(vehicle) / 1.225
        assert ratio == pytest.approx(1.20165 / 1.225, rel=1e-5), "standard atmosphere, 200 m over sea level"
        thrust = ratio * (n("rotors.T1") + 2 * n("rotors.T2") * x)
        assert found.matrix[2, column] == pytest.approx(-thrust, rel=1e-4)


def test_there_and_back(found: Derivatives) -> None:
    again = found.along("stability").along("body")
    assert again.values == pytest.approx(found.values, rel=1e-12, abs=1e-10)
    for form in FORMS:
        ours, theirs = found.table(form), again.table(form)
        assert np.array_equal(ours.identified, theirs.identified)
        kept = ours.identified
        first, second = (t.covariance[np.ix_(kept, kept)] for t in (ours, theirs))
        assert second == pytest.approx(first, rel=1e-9, abs=1e-12 * first.max())


def test_the_covariance_is_that_of_sampled_parameters(twin_boom: Vehicle, found: Derivatives) -> None:
    table = found.along("stability").table("nondimensional")
    errors = dict(zip(table.names, table.std_errors.tolist(), strict=True))
    assert errors["CZ_alpha"] == pytest.approx(SIGMAS["CLalpha"], rel=1e-6)
    assert errors["Cm_q"] == pytest.approx(SIGMAS["Cmq"], rel=1e-6)
    c, s = math.cos(found.alpha), math.sin(found.alpha)
    # Clp spreads over four: Cl_p c^2, Cl_r and Cn_p -c s, Cn_r s^2
    for name, share in {"Cl_p": c * c, "Cl_r": c * s, "Cn_p": c * s, "Cn_r": s * s}.items():
        i = table.names.index(name)
        assert abs(table.sensitivity[i, 2]) == pytest.approx(share, rel=1e-6)
    i, j = table.names.index("CX_alpha"), table.names.index("CZ_alpha")
    assert abs(table.covariance[i, j]) < SIGMAS["CLalpha"] ** 2


def test_what_an_unidentified_parameter_touches_is_marked(found: Derivatives) -> None:
    for axes, lost in (("body", {"Cn_r"}), ("stability", {"Cl_p", "Cl_r", "Cn_p", "Cn_r"})):
        table = found.along(axes).table("nondimensional")
        marked = {n for n, known in zip(table.names, table.identified, strict=True) if not known}
        assert marked == lost
        assert np.isinf([table.std_errors[table.names.index(n)] for n in lost]).all()


def test_an_estimated_inertia_cancels_from_what_is_divided_by_it(twin_boom: Vehicle) -> None:
    """M is Iyy q': with a coefficient that holds for a fixed inertia, M_q does not move with Iyy, but M_q/Iyy does."""
    known = ParameterCovariance(("mass.inertia.yy",), np.array([[1.0]]))
    found = derivatives(twin_boom, trim(twin_boom), known)
    total, specific = found.table("dimensional"), found.table("specific")
    i = total.names.index("M_q")
    assert total.std_errors[i] == pytest.approx(0.0, abs=1e-6 * abs(total.values[i]))
    expected = abs(specific.values[i]) / twin_boom.value("mass.inertia.yy")
    assert specific.std_errors[i] == pytest.approx(expected, rel=1e-5)


def test_refusals(twin_boom: Vehicle) -> None:
    quad = builtin_vehicle("quad-x")
    with pytest.raises(SimulationError, match="need wings and an airspeed"):
        derivatives(quad, trim(quad)).table("nondimensional")
    with pytest.raises(SimulationError, match="full equations"):
        derivatives(twin_boom.reduced("longitudinal"), trim(twin_boom.reduced("longitudinal")))
    assert np.isnan(derivatives(twin_boom, trim(twin_boom)).table().std_errors).all()
    assert len(derivatives(quad, trim(quad)).table("specific").names) == 6 * (6 + 4) == 10 * len(LOADS)
