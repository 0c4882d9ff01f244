import numpy as np
import pytest

from stoop_studies.verify import multirotor
from stoop_studies.verify.jsbsim_flight import Recording
from stoop_studies.verify.multirotor import FOOT_POUND, KNOWN, LIFTS, RATE, TURNS, TWISTS, Quadrotor

MORE = {
    **{f"{a}_dot": (f"accelerations/{a}idot-rad_sec2", 1.0) for a in "pqr"},
    **{f"{a}_moment": (f"moments/{a}-prop-lbsft", FOOT_POUND) for a in "lmn"},
    **{f"advance_{i}": (f"propulsion/engine[{i}]/advance-ratio", 1.0) for i in range(4)},
}


@pytest.fixture(scope="module")
def craft() -> Quadrotor:
    return Quadrotor()


@pytest.fixture(scope="module")
def flown() -> Recording:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multirotor, "DURATION", 6.0)
        patch.setattr(multirotor, "READ", {**multirotor.READ, **MORE})
        return multirotor.fly(Quadrotor())


def test_balances_are_at_the_arms(craft: Quadrotor, flown: Recording) -> None:
    """Thrust times arm, the reaction of the rotors and their gyroscopic moment are what turns JSBSim's body."""
    known = flown.columns
    lift, twist, turn = (np.stack([known[c] for c in names]) for names in (LIFTS, TWISTS, TURNS))
    x, y, _ = np.array([craft.position(i) for i in range(4)]).T[:, :, None]
    signs = np.array([1.0 if craft.sense(i) == "ccw" else -1.0 for i in range(4)])
    up = 6.05e-5 * signs @ turn
    assert -(y * lift).sum(axis=0) + known["q"] * up == pytest.approx(known["l_moment"], abs=2e-5)
    assert (x * lift).sum(axis=0) - known["p"] * up == pytest.approx(known["m_moment"], abs=2e-5)
    assert -twist.sum(axis=0) == pytest.approx(known["n_moment"], abs=1e-9)


def test_equations_agree_at_the_states_flown(craft: Quadrotor, flown: Recording) -> None:
    """No fit: with JSBSim's numbers our equations give JSBSim's accelerations at its own states."""
    found = multirotor.truth(craft, flown, None)
    known, true = flown.columns, {n: {"value": v} for n, v in found.items() if n not in KNOWN}
    vehicle = multirotor.vehicle_of(craft, flown, found, None).with_numbers(true)
    rows = vehicle.parameter_rows({}, len(flown.time))
    turns = np.stack([known[c] for c in TURNS])
    told = np.vstack([turns, np.gradient(turns, 1.0 / RATE, axis=1)])
    assert vehicle.inputs == (*TURNS, *(f"{c}.slope" for c in TURNS))
    states = {c: known[c] for c in ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")}
    start = vehicle.initial_states({**states, "h": known["altitude"]}, rows, told)
    rates, readings = vehicle.kernel().evaluate(rows, start, told)
    near = dict.fromkeys(("p_dot", "q_dot", "r_dot", "az"), 0.05) | dict.fromkeys(("ax", "ay"), 0.15)
    for name, share in near.items():  # what is left is that tables bend and that a plate is braked by |V| v
        ours = rates[vehicle.states.index(name[0])] if name in MORE else readings[vehicle.outputs.index(name)]
        off = (ours - known[name])[2:-2]
        assert np.sqrt(np.mean(off**2)) < share * np.std(known[name]), name
