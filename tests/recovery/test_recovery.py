"""Known truth, seeded noise, wrong start: every estimate within three of its standard errors.

Standard errors come from the Jacobian at the optimum, nuisances (initial states, sensor biases) included.
The noise is white and its covariance estimated, so they should be exact: pooled over seeds, squares of
(estimate - truth) / standard error must average one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from stoop.errors import IdentificationError, VehicleError
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options, fit
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle

LEFT_OUT = {
    "CLV": 0.05,
    "CDV": 0.02,
    "CDalpha2": 1.2,
    "CmV": 0.03,
}  #: truths that the paper's Table 1 leaves out
JOINT = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("aileron", "doublet", 8.0, 0.5, 0.10), ("elevator", "doublet", 12.0, 2.5, 0.06),
    ("rudder", "doublet", 20.0, 0.7, 0.15), ("rudder", "2-1-1", 26.0, 0.6, 0.12), ("aileron", "2-1-1", 31.0, 0.5, 0.10),
    ("elevator", "doublet", 36.0, 0.4, 0.10), ("elevator", "doublet", 40.0, 2.5, -0.06),
    ("aileron", "doublet", 50.0, 0.5, -0.1), ("rudder", "doublet", 53.0, 0.5, -0.15),
)  # fmt: skip
PITCH = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.12),
    ("elevator", "doublet", 5.0, 1.5, 0.05),
    ("elevator", "doublet", 12.0, 0.3, 0.1),
)


def maneuver(
    steps: tuple[tuple[str, str, float, float, float], ...], duration: float, rate: float = 50.0
) -> Maneuver:
    inputs = [{"control": c, "shape": s, "start": t, "step": d, "amplitude": a} for c, s, t, d, a in steps]
    return Maneuver.model_validate({"duration": duration, "rate": rate, "input": inputs})


def held(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the thrust that its trim needs: that is what will be flown."""
    thrust = trim(vehicle).thrust["propulsion.thrust"]
    return vehicle.with_numbers({"propulsion.thrust": {"value": float(thrust)}})


def spoiled(vehicle: Vehicle, seed: int, reach: float = 0.4) -> Vehicle:
    """Return the vehicle with every free number wrong by up to 40 %."""
    rng = np.random.default_rng(1000 + seed)
    free = [p for p in vehicle.parameters if p.free and not p.name.endswith(".bias")]
    return vehicle.with_numbers(
        {
            p.name: {"value": float(np.clip(p.value * rng.uniform(1 - reach, 1 + reach), p.lower, p.upper))}
            for p in free
        }
    )


def deviations(found: Estimate, truth: Mapping[str, float]) -> dict[str, float]:
    """Return (estimate - truth) / standard error of every parameter."""
    problem, rung = found.problem, len(found.problem.prices) - 1
    J = problem.jacobian(found.z, rung, problem.residuals(found.z[None, :], rung)[0])[0].dense()
    sigma = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[: problem.dimension] * problem.layout.width
    return {n: (v - truth[n]) / s for (n, v), s in zip(found.estimates.items(), sigma, strict=True)}


def truths(vehicle: Vehicle) -> dict[str, float]:
    return {p.name: p.value for p in vehicle.parameters}


@pytest.fixture(scope="module")
def aircraft() -> Vehicle:
    """Return the paper's aircraft, with all 32 coefficients different from zero."""
    v = load_vehicle(str(files("stoop") / "data" / "twin_boom.toml"))
    return held(v.with_numbers({name: {"value": value} for name, value in LEFT_OUT.items()}))


def recover(truth: Vehicle, start: Vehicle, flown: Maneuver, seed: int) -> Estimate:
    flight = simulate_flight(truth, flown, seed=seed, name="sim")
    return fit(start, {"sim": flight}, [Window("sim", 0.0, flown.duration)], Options(seed=seed))


def test_all_32_parameters_of_eq_1(aircraft: Vehicle) -> None:
    found = recover(aircraft, spoiled(aircraft, 4), maneuver(JOINT, 60.0), 4)
    z = deviations(found, truths(aircraft))
    assert len(z) == 32
    assert found.outcome.status == "converged"
    assert {name: v for name, v in z.items() if abs(v) > 3.0} == {}
    assert sum(v * v for v in z.values()) < 62.5, "chi square of 32, 99.9 %"


def test_standard_errors_are_exact_over_seeds(aircraft: Vehicle) -> None:
    """16 flights, 512 estimates: one in 20 beyond two standard errors, one in 370 beyond three."""
    all_z = []
    for seed in range(16):
        found = recover(aircraft, spoiled(aircraft, seed), maneuver(JOINT, 60.0), seed)
        all_z.append(list(deviations(found, truths(aircraft)).values()))
    z = np.array(all_z)
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.15)
    assert 0.025 < np.mean(np.abs(z) > 2.0) < 0.07
    assert np.mean(np.abs(z) > 3.0) < 0.01
    assert np.abs(np.mean(z, axis=0)).max() < 3.5 / np.sqrt(16), "none is biased"


def test_separate_maneuvers_have_their_own_starts_and_biases(aircraft: Vehicle) -> None:
    pitch, turn = (
        maneuver(PITCH, 16.0),
        maneuver((("aileron", "doublet", 1.0, 0.6, 0.1), ("rudder", "2-1-1", 5.0, 0.6, 0.15)), 16.0),
    )
    biased = [
        aircraft.with_numbers({"sensors.q.bias": {"value": q}, "sensors.az.bias": {"value": z}})
        for q, z in ((0.012, -0.1), (-0.008, 0.15))
    ]
    flights = {
        n: simulate_flight(v, m, seed=i, name=n)
        for i, (n, v, m) in enumerate(zip(("a", "b"), biased, (pitch, turn), strict=True))
    }
    few = (
        "CLalpha",
        "Cmalpha",
        "Cmq",
        "Cmelevator",
        "CL0",
        "Cm0",
        "Clp",
        "Claileron",
        "Clbeta",
        "Cnbeta",
        "Cnr",
        "Cnrudder",
        "CQbeta",
    )
    start = aircraft.with_numbers(
        {p.name: {"free": p.name in few} for p in aircraft.parameters if "." not in p.name}
    )
    found = fit(spoiled(start, 3), flights, [Window("a", 0.0, 16.0), Window("b", 0.0, 16.0)], Options(seed=3))
    z = deviations(found, truths(aircraft))
    assert max(map(abs, z.values())) < 3.0
    d = found.problem.dimension
    biases = {
        (n.name, n.maneuver): n.center + n.scale * found.z[d + j]
        for j, n in enumerate(found.problem.layout.nuisances)
        if n.is_bias
    }
    assert biases["sensors.q.bias", 0] == pytest.approx(0.012, abs=3e-3)
    assert biases["sensors.q.bias", 1] == pytest.approx(-0.008, abs=3e-3)
    assert biases["sensors.az.bias", 1] - biases["sensors.az.bias", 0] == pytest.approx(0.25, abs=0.05)


def freed(vehicle: Vehicle, numbers: Mapping[str, tuple[float, float]]) -> Vehicle:
    """Return the vehicle with these numbers free within bounds, and no others."""
    closed = vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if "." not in p.name})
    return closed.with_numbers({name: {"free": True, "bounds": bounds} for name, bounds in numbers.items()})


def test_mass_inertia_and_center_of_gravity() -> None:
    """With the coefficients known, what the aircraft weighs, how it turns and where it balances."""
    text = (files("stoop") / "data" / "twin_boom.toml").read_text()
    text = text.replace("[mass]\n", "[mass]\ncenter_of_gravity = [0.03, 0.0, 0.0]\n").replace(
        "alpha = 0.0\n", "alpha = 0.0\nmoment_point = [0.0, 0.0, 0.0]\n"
    )
    truth = held(parse_vehicle(text, "truth").reduced("longitudinal"))
    start = freed(
        truth,
        {
            "mass.mass": (140.0, 240.0),
            "mass.inertia.yy": (60.0, 200.0),
            "mass.center_of_gravity.x": (-0.1, 0.15),
        },
    )
    found = recover(truth, spoiled(start, 1), maneuver(PITCH, 16.0), 1)
    z = deviations(found, truths(truth))
    assert set(z) == {"mass.mass", "mass.inertia.yy", "mass.center_of_gravity.x"}
    assert max(map(abs, z.values())) < 3.0
    assert found.estimates["mass.mass"] == pytest.approx(189.4, rel=5e-3)
    assert found.estimates["mass.center_of_gravity.x"] == pytest.approx(0.03, abs=2e-3)


def test_a_loading_of_its_own_maneuver(aircraft: Vehicle) -> None:
    """Two flights, one 20 kg heavier and balanced elsewhere; the coefficients are the same."""
    loading = '\n[loadings.heavy]\n"mass.mass" = 209.4\n"mass.inertia.yy" = 131.0\n'
    light = parse_vehicle(aircraft.text + loading, "loaded").reduced("longitudinal")
    light = held(light.with_numbers({p.name: {"value": p.value} for p in aircraft.parameters}))
    heavy = light.with_numbers({"mass.mass": {"value": 209.4}, "mass.inertia.yy": {"value": 131.0}})
    drag = trim(heavy).thrust["propulsion.thrust"] - trim(light).thrust["propulsion.thrust"]
    flown = {"a": light, "b": heavy}
    flights = {
        n: simulate_flight(v, maneuver(PITCH, 16.0), seed=i, name=n) for i, (n, v) in enumerate(flown.items())
    }
    few = {"CLalpha": (2.0, 8.0), "Cmalpha": (-4.0, 0.0), "Cmq": (-90.0, -10.0), "Cmelevator": (-2.0, 0.0)}
    start = spoiled(freed(light, few), 6)
    start = replace(start, file=start.file.model_copy(update={"loadings": {
        "heavy": {"mass.mass": 209.4, "mass.inertia.yy": 131.0, "propulsion.thrust": light.value("propulsion.thrust") + drag}
    }}))  # fmt: skip
    right = fit(start, flights, [Window("a", 0.0, 16.0), Window("b", 0.0, 16.0, "heavy")], Options(seed=6))
    assert max(map(abs, deviations(right, truths(light)).values())) < 3.0
    same_noise = Options(
        seed=6, covariance=right.measurement_noise
    )  # or what is wrong would count as noise of b
    wrong = fit(start, flights, [Window("a", 0.0, 16.0), Window("b", 0.0, 16.0)], same_noise)
    assert max(map(abs, deviations(wrong, truths(light)).values())) > 5.0, "the loading matters"


def test_a_loading_may_not_hold_what_is_free(aircraft: Vehicle) -> None:
    text = aircraft.text + '\n[loadings.heavy]\n"mass.mass" = 209.4\n'
    start = parse_vehicle(text, "v.toml").with_numbers({"mass.mass": {"free": True}})
    flight = simulate_flight(start, maneuver(PITCH, 2.0), name="sim")
    with pytest.raises(
        VehicleError, match=r"loadings\.heavy\.mass\.mass: the number is free.*--fix mass\.mass"
    ):
        fit(start, {"sim": flight}, [Window("sim", 0.0, 2.0, "heavy")])


@pytest.mark.parametrize("lost", [("alpha",), ("alpha", "V", "theta")])
def test_channels_that_nothing_measured(aircraft: Vehicle, lost: tuple[str, ...]) -> None:
    v = aircraft.reduced("longitudinal")
    flight = simulate_flight(v, maneuver(PITCH, 16.0), seed=8, name="sim")
    data = flight.data.copy(deep=True)
    for channel in lost:
        data[channel][:] = np.nan
    start = freed(
        v, {"Cmq": (-90.0, -10.0), "Cmalpha": (-4.0, 0.0), "Cmelevator": (-2.0, 0.0), "CLalpha": (2.0, 8.0)}
    )
    found = fit(
        spoiled(start, 8), {"sim": replace(flight, data=data)}, [Window("sim", 0.0, 16.0)], Options(seed=8)
    )
    assert max(map(abs, deviations(found, truths(v)).values())) < 3.0


def test_a_free_number_needs_bounds(aircraft: Vehicle) -> None:
    start = aircraft.with_numbers({"reference.alpha": {"free": True}})
    flight = simulate_flight(start, maneuver(PITCH, 2.0), name="sim")
    with pytest.raises(
        IdentificationError, match=r"reference\.alpha: free, but its bounds are \[0, 0\]; write bounds"
    ):
        fit(start, {"sim": flight}, [Window("sim", 0.0, 2.0)])


INSTRUMENTED = """
[controls.elevator]
lag = 0.08
delay = 0.047
[controls.aileron]
[controls.rudder]
[sensors]
vane_position = [1.2, 0.0, 0.0]
accelerometer_position = [0.4, 0.0, 0.1]
[sensors.alpha]
scale = 1.06
delay = 0.033
[sensors.q]
delay = 0.012
"""


def test_delays_lags_positions_and_scales() -> None:
    text = (files("stoop") / "data" / "twin_boom.toml").read_text() + INSTRUMENTED
    truth = held(parse_vehicle(text, "truth").reduced("longitudinal"))
    numbers = {
        "controls.elevator.delay": (0.0, 0.15), "controls.elevator.lag": (0.02, 0.3), "sensors.alpha.delay": (0.0, 0.15),
        "sensors.q.delay": (0.0, 0.1), "sensors.alpha.scale": (0.8, 1.3), "sensors.vane_position.x": (0.0, 3.0),
        "sensors.accelerometer_position.x": (-1.0, 2.0), "Cmalpha": (-4.0, 0.0), "Cmq": (-90.0, -10.0), "Cmelevator": (-2.0, 0.0),
    }  # fmt: skip
    found = recover(truth, spoiled(freed(truth, numbers), 2), maneuver(PITCH, 16.0), 2)
    z = deviations(found, truths(truth))
    assert set(z) == set(numbers)
    assert max(map(abs, z.values())) < 3.0
    assert found.estimates["controls.elevator.delay"] == pytest.approx(0.047, abs=0.01)
    assert found.estimates["sensors.q.delay"] == pytest.approx(0.012, abs=0.01)


def test_a_prior_is_weighed_against_the_data(aircraft: Vehicle) -> None:
    """A narrow wrong prior holds the estimate, a wide one does not."""
    v = aircraft.reduced("longitudinal")
    estimates = []
    for prior in (1e-3, 100.0):
        start = freed(v, {"Cmq": (-90.0, -10.0), "Cmalpha": (-4.0, 0.0)})
        start = start.with_numbers(
            {"Cmq": {"value": -40.0, "prior": prior, "free": True, "bounds": (-90.0, -10.0)}}
        )
        estimates.append(recover(v, start, maneuver(PITCH, 16.0), 5).estimates["Cmq"])
    assert estimates[0] == pytest.approx(-40.0, abs=0.01)
    assert estimates[1] == pytest.approx(-47.6, abs=2.0)
