"""The quadrotor's and the hexacopter's problems: what the truth costs, who finds it, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from naive.multirotor import Multirotor
from scipy.integrate import solve_ivp

from stoop import optimize
from stoop.errors import FlightError, IdentificationError
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import parse_maneuver
from stoop_studies.problems import Posed, hexacopter, pose
from stoop_studies.problems.multirotor import MANEUVER, NAMES, NOISE, SOUGHT, quad
from stoop_studies.problems.paper import NEAR

DATA = Path(__file__).parents[3] / "src" / "stoop" / "data"
TEN = {
    "rotors.T1": 2.5, "rotors.T2": 6.0, "rotors.torque_ratio": 0.016, "rotors.inflow": 0.25, "rotors.drag": 0.08,
    "rotors.lag": 0.05, "mass.inertia.xx": 0.0291, "mass.inertia.yy": 0.0291, "mass.inertia.zz": 0.0552,
    "body_drag.quadratic.x": 0.02,
}  # fmt: skip


def place(posed: Posed) -> np.ndarray:
    """Return where the truth lies in the unit box (D,)."""
    assert posed.truth is not None
    zero = posed.values(np.zeros(len(posed.truth)))
    return np.asarray((posed.truth - zero) / (posed.values(np.ones(len(posed.truth))) - zero))


def test_the_truth_is_the_built_in_vehicle_and_costs_nothing() -> None:
    posed = pose("multirotor", 5)
    assert posed.truth is not None
    assert dict(zip(posed.parameters, posed.truth.tolist(), strict=True)) == TEN
    assert set(SOUGHT) == set(TEN)
    x = place(posed)
    assert posed.problem.costs(x[None], 0)[0] < 1e-12 * posed.reference
    assert posed.target == NEAR * posed.reference
    assert x.min() > 0.09
    assert x.max() < 0.91
    assert (np.abs(x - 0.5) > 0.02).any(), "never on purpose in the middle"


def test_noise_moves_the_optimum_and_the_target_follows_it() -> None:
    posed = pose("multirotor+noise", 5)
    at_truth = posed.problem.costs(place(posed)[None], 0)[0]
    readings = 12.0 * sum(len(p.time) for p in posed.problem.pieces)
    assert posed.target < at_truth
    assert readings < at_truth < 4.0 * readings, "noise of the readings, and of those that windows begin with"


def test_a_window_is_what_an_integration_by_other_means_says() -> None:
    """Take the third window with two numbers wrong, and fly it by the naive model."""
    case = quad()
    problem = case.problem("N", 0, noise=False)
    wrong = TEN | {"rotors.T2": 7.0, "mass.inertia.xx": 0.02}
    names_of = [p.name for p in problem.layout.parameters]
    z = problem.layout.unit(np.array([wrong[n] for n in names_of]))
    piece = problem.pieces[2]
    first = sum(len(p.time) for p in problem.pieces[:2])
    ours = problem.residuals(z[None], 0)[0].reshape(-1, 12)[first : first + len(piece.time)]
    text = (DATA / "quad_x.toml").read_text(encoding="utf-8")
    craft = Multirotor(text, wrong)
    channels = [f"motor_{i}" for i in (1, 2, 3, 4)]
    columns = [case.vehicle.inputs.index(c) for c in channels]

    def told(t: float) -> dict[str, float]:
        return {
            c: float(np.interp(t, piece.time, piece.inputs[:, i]))
            for c, i in zip(channels, columns, strict=True)
        }

    s = piece.start
    spins = [piece.inputs[0, i] + s[f"m{k}.lag"] for k, i in enumerate(columns, 1)]
    turned = attitude(s["phi"], s["theta"], s["psi"])
    begin = np.array([s[n] for n in "uvwpqr"] + turned.ravel().tolist() + [s["h"], *spins])
    flown = solve_ivp(
        lambda t, y: craft.rates(y, told(t)), piece.time[[0, -1]], begin, t_eval=piece.time, rtol=1e-9, atol=1e-10, max_step=0.02
    )  # fmt: skip
    sigma = np.array([NOISE[c] for c in case.vehicle.outputs])
    theirs = (flown.y[3:6].T - piece.measured[:, 3:6]) / sigma[3:6]
    assert np.abs(ours).max() > 1.0
    np.testing.assert_allclose(ours[:, 3:6], theirs, atol=0.02 * np.abs(theirs).max())


def attitude(phi: float, theta: float, psi: float) -> np.ndarray:
    """Return the rotation (3, 3) from body to Earth."""
    (a, b, c), (d, e, f) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    return np.array(
        [[b * c, d * e * c - a * f, a * e * c + d * f], [b * f, d * e * f + a * c, a * e * f - d * c], [-e, d * b, a * b]]
    )  # fmt: skip


def test_the_default_finds_all_ten_and_ps_gde_as_well() -> None:
    posed = pose("multirotor", 3)
    for name, generations, within in (("ps-gde-lm", 10**9, 1e-6), ("ps-gde", 150, 1e-2)):
        found = optimize.minimize(
            optimize.create(name), posed.problem, seed=3, stop=optimize.Stop(generations, np.inf, -np.inf)
        )
        assert np.abs(posed.values(found.z) / posed.truth - 1.0).max() < within
        assert found.cost < posed.target


def test_the_flight_is_one_that_a_quadrotor_can_fly() -> None:
    flown = fly(quad().vehicle, parse_maneuver(MANEUVER, "quadrotor"))
    assert flown.clipped is not None
    assert flown.clipped.mean(axis=0).max() < 0.01
    assert np.abs(quad().readings - flown.outputs).max() < 1e-4


def test_what_is_refused() -> None:
    assert NAMES == ("multirotor", "multirotor+noise")
    with pytest.raises(IdentificationError, match="knows no window"):
        pose("multirotor", 1, window=3)
    with pytest.raises(IdentificationError, match="box Q"):
        pose("multirotor", 1, box="Q")
    with pytest.raises(IdentificationError, match="needs data"):
        pose("hexacopter", 1)


def test_a_folder_without_the_log_is_said(tmp_path: Path) -> None:
    with pytest.raises(FlightError, match="holds no log of the hexacopter"):
        pose("hexacopter", 1, data=str(tmp_path))


def test_the_hexacopter_of_the_problem_is_the_one_of_the_examples() -> None:
    examples = Path(__file__).parents[3] / "examples"
    own = Path(hexacopter.__file__).parent
    name = "hexacopter_mapping.toml"
    assert (own / name).read_text(encoding="utf-8") == (examples / name).read_text(encoding="utf-8")
    vehicle = hexacopter.vehicle()
    free = [p for p in vehicle.parameters if p.free]
    assert len(free) == 14
    assert all(p.lower < p.value < p.upper for p in free)
    assert hexacopter.MIXER[:, :2].sum(axis=0) == pytest.approx(0.0), "no moment of equal commands"
