from pathlib import Path

import numpy as np
from naive.multirotor import Multirotor
from scipy.integrate import solve_ivp

from stoop_studies.problems import Posed, pose
from stoop_studies.problems.multirotor import NOISE, SOUGHT, quad
from stoop_studies.problems.paper import NEAR

DATA = Path(__file__).parents[3] / "src" / "stoop" / "data"
TEN = {
    "rotors.T1": 2.5, "rotors.T2": 6.0, "rotors.torque_ratio": 0.016, "rotors.inflow": 0.25, "rotors.drag": 0.08,
    "rotors.lag": 0.05, "mass.inertia.xx": 0.0291, "mass.inertia.yy": 0.0291, "mass.inertia.zz": 0.0552,
    "body_drag.quadratic.x": 0.02,
}  # fmt: skip


def place(posed: Posed) -> np.ndarray:
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


def test_a_window_is_what_an_integration_by_other_means_says() -> None:
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
    columns = {f"motor_{i}": case.vehicle.inputs.index(f"motor_{i}") for i in (1, 2, 3, 4)}

    def told(t: float) -> dict[str, float]:
        return {c: float(np.interp(t, piece.time, piece.inputs[:, i])) for c, i in columns.items()}

    s = piece.start
    spins = [piece.inputs[0, i] + s[f"m{k}.lag"] for k, i in enumerate(columns.values(), 1)]
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
    (a, b, c), (d, e, f) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    return np.array(
        [[b * c, d * e * c - a * f, a * e * c + d * f], [b * f, d * e * f + a * c, a * e * f - d * c], [-e, d * b, a * b]]
    )  # fmt: skip
