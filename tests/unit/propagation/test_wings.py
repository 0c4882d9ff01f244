"""Trims, linear models and limits of many draws against closed forms, and against one draw at a time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.errors import SimulationError
from stoop.propagation.propagation import propagate_draws
from stoop.propagation.wing_figures import Domain
from stoop.propagation.wings import level_flight, lift_maximum, linear_flights, static_margin, steady_flights
from stoop.simulation import linearize, trim
from stoop.simulation.initial import parameter_rows
from stoop.vehicle import Vehicle, load_vehicle
from stoop.vehicle.builtin import builtin_text, resolve_vehicle
from stoop.vehicle.load import parse_vehicle

GRAVITY = 9.80665
DENSITY = 1.20165
DOMAIN = Domain((30.0, 40.0), 35.0, 200.0, DENSITY, (-0.1, 0.2))


def spread(vehicle: Vehicle, names: tuple[str, ...], count: int, size: float = 0.05) -> Draws:
    center = np.array([vehicle.value(n) for n in names])
    noise = np.random.default_rng(0).standard_normal((count, len(names)))
    return Draws(names, center + size * np.maximum(np.abs(center), 0.01) * noise, "covariance")


def polar_aircraft() -> Vehicle:
    """Return an aircraft whose lift and drag depend on the angle of attack alone: CD = CD0 + CDalpha2 alpha^2."""
    zero: dict[str, Any] = {n: {"value": 0.0} for n in ("CL0", "CLelevator", "CDalpha", "Cm0")}
    whole = resolve_vehicle("twin-boom").with_numbers({**zero, "CDalpha2": {"value": 1.3}})
    return whole.reduced("longitudinal")


def speed_of(lift: float, weight: float = 189.40 * GRAVITY) -> float:
    """Return the airspeed at which a lift coefficient carries a weight."""
    return math.sqrt(2.0 * weight / (DENSITY * 2.8667 * lift))


@pytest.mark.parametrize("name", ["twin-boom", "vtail"])
def test_draws_are_those_of_one_at_a_time(name: str, request: pytest.FixtureRequest) -> None:
    """The naive twin: SciPy's root finding, and exact differentiation, of each draw by itself."""
    root = request.config.rootpath
    vehicle = resolve_vehicle(name) if name == "twin-boom" else load_vehicle(root / "examples" / "vtail.toml")
    speed, names = vehicle.value("reference.airspeed"), ("CLalpha", "Cmalpha", "Cnbeta", "Clp", "CD0")
    names += ("controls.aileron.lag",) if name == "vtail" else ()
    draws = spread(vehicle, names, 3)
    rows = parameter_rows(vehicle, dict(zip(names, draws.values.T, strict=True)), 3)
    flight = level_flight(vehicle, rows, 200.0, DENSITY)
    at = steady_flights(flight, {"V": np.full(3, speed)})
    models = linear_flights(flight, at)
    assert at.flies.all()
    for i, values in enumerate(draws.values):
        one = vehicle.with_numbers({n: {"value": float(v)} for n, v in zip(names, values, strict=True)})
        point = trim(one, speed, 200.0, 0.0, DENSITY)
        theirs = linearize(one, point)
        angles = {n: point.start[n] for n in ("alpha", "theta", "phi")}
        assert {n: at.start[n][i] for n in angles} == pytest.approx(angles, abs=1e-8)
        assert {n: at.deflections[n][i] for n in point.deflections} == pytest.approx(
            point.deflections, abs=1e-8
        )
        assert {n: at.thrust[n][i] for n in point.thrust} == pytest.approx(point.thrust, rel=1e-7)
        assert models.names == theirs.states
        assert np.allclose(models.A[i], theirs.A, atol=1e-6 * np.abs(theirs.A).max())
        for control, effect in models.effects.items():
            if f"{control}.lag" not in models.names:
                column = theirs.B[:, theirs.inputs.index(control)]
                assert np.allclose(effect[i], column, atol=1e-6 * np.abs(column).max())


def test_static_margin_is_the_ratio_of_two_slopes_and_moves_with_the_moment_point() -> None:
    """A moment point ahead of the center of gravity by 0.1 chord, at small angles without drag: 0.1 less."""
    ahead = "alpha = 0.0\nmoment_point = [0.055, 0.0, 0.0]\n"
    moved = builtin_text("twin-boom").replace("alpha = 0.0\n", ahead)
    numbers = {n: {"value": 0.0} for n in ("CD0", "CDalpha", "CL0")}
    for vehicle, alpha, margin in (
        (resolve_vehicle("twin-boom"), 0.1, 2.12 / 4.78),
        (parse_vehicle(moved, "moved").with_numbers(numbers), 0.0, 2.12 / 4.78 - 0.1),
    ):
        flow = {"V": np.array([35.0]), "alpha": np.array([alpha])}
        still = {c: np.zeros(1) for c in vehicle.controls}
        found = static_margin(vehicle, parameter_rows(vehicle), flow, still)
        assert found == pytest.approx(margin, rel=1e-6)


def test_best_glide_of_a_parabolic_polar() -> None:
    vehicle = polar_aircraft()
    draws = spread(vehicle, ("CD0", "CLalpha"), 100, 0.02)
    domain = Domain((20.0, 60.0), 35.0, 200.0, DENSITY, (-0.1, 0.6))
    found = propagate_draws(vehicle, draws, domain)
    # (CL/CD)max = CLalpha / (2 sqrt(CD0 CDalpha2)) at alpha = sqrt(CD0 / CDalpha2)
    best = 4.78 / (2.0 * math.sqrt(0.06 * 1.3))
    weight = 189.40 * GRAVITY
    speed = speed_of(4.78 * math.sqrt(0.06 / 1.3), weight * math.cos(math.atan(1.0 / best)))
    assert found["best glide ratio"].estimate == pytest.approx(best, rel=1e-3)
    assert found["airspeed of the best glide"].estimate == pytest.approx(speed, rel=5e-3)
    # relative: d ln = d ln CLalpha - 1/2 d ln CD0
    relative = math.hypot(0.02, 0.01)
    assert found["best glide ratio"].std_error / best == pytest.approx(relative, rel=0.25)
    # CL^3/CD^2 is greatest where the induced drag is three times the other
    lift, drag = 4.78 * math.sqrt(3.0 * 0.06 / 1.3), 4.0 * 0.06
    flat = math.atan(drag / lift)
    sink = speed_of(lift, weight * math.cos(flat)) * math.sin(flat)
    assert found["least sink rate"].estimate == pytest.approx(sink, rel=1e-2)


def test_lowest_airspeed_within_the_angles_of_attack_flown() -> None:
    """Thrust along the body's axis: V^2 = 2 W / (rho S (CL + CD tan alpha)) in level flight."""
    vehicle, alpha = polar_aircraft(), 0.15
    domain = Domain((30.0, 40.0), 35.0, 200.0, DENSITY, (0.0, alpha))
    found = propagate_draws(vehicle, spread(vehicle, ("CLalpha",), 50), domain)
    slowest = speed_of(4.78 * alpha + (0.06 + 1.3 * alpha**2) * math.tan(alpha))
    assert found["lowest airspeed, alpha as flown"].estimate == pytest.approx(slowest, rel=1e-3)
    assert "propagate-no-stall" in [n.code for n in found.notices]


def test_a_lift_with_a_maximum_gives_a_stall_speed() -> None:
    bent = 'CLalpha = 4.78\nCLalpha2 = { term = "alpha^2", value = -8.0, bounds = [-50.0, 0.0] }'
    text = builtin_text("twin-boom").replace("CLalpha = 4.78", bent)
    vehicle = parse_vehicle(text, "stalling").reduced("longitudinal")
    flow = {"V": np.array([35.0]), "alpha": np.zeros(1)}
    peak = lift_maximum(vehicle, parameter_rows(vehicle), flow, {"elevator": np.zeros(1)}, 0.0, 0.4)
    assert peak == pytest.approx(4.78 / 16.0, abs=1e-6)
    domain = Domain((33.0, 40.0), 35.0, 200.0, DENSITY, (0.0, 0.4))
    found = propagate_draws(vehicle, spread(vehicle, ("CLalpha",), 50, 0.02), domain)
    assert found["angle of attack of greatest lift"].estimate == pytest.approx(4.78 / 16.0, abs=1e-4)
    assert found["stall speed"].estimate < 33.0
    assert "propagate-stall" in [n.code for n in found.notices]


def test_extrapolation_beyond_the_angles_flown_is_told() -> None:
    vehicle = polar_aircraft()
    domain = Domain((25.0, 40.0), 35.0, 200.0, DENSITY, (0.0, 0.12))
    found = propagate_draws(vehicle, spread(vehicle, ("CLalpha",), 50), domain)
    told = next(n for n in found.notices if n.code == "propagate-extrapolated")
    alpha = next(c for c in found.curves if c.name == "alpha")
    assert told.values["low"] == 25.0
    assert alpha.estimate[alpha.airspeed <= told.values["high"]].min() > 0.12
    assert found.extrapolated == ((25.0, told.values["high"]),)


def test_draws_that_do_not_trim_are_counted_and_nothing_that_trims_is_an_error() -> None:
    vehicle = polar_aircraft()
    slopes = np.repeat([4.78, 0.01], [40, 10])[:, None]
    draws = Draws(("CLalpha",), slopes, "covariance")
    found = propagate_draws(vehicle, draws, DOMAIN)
    assert found["alpha"].failed == pytest.approx(0.2)
    assert {"propagate-no-trim", "propagate-figure-failed"} <= {n.code for n in found.notices}
    with pytest.raises(SimulationError, match=r"nothing trims at 3 m/s .* give --airspeed A:B"):
        propagate_draws(vehicle, draws, Domain((3.0, 4.0), 3.0, 200.0, DENSITY))
