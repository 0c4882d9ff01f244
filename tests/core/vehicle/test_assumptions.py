"""What an estimation assumes of a file that leaves lags, delays and errors of thrust out."""

import pytest
import sympy as sp

from stoop.errors import VehicleError
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.assumptions import with_assumptions
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.defaults import SHORTEST_LAG
from stoop.vehicle.symbolic.forces import lagged
from stoop.vehicle.usual import USUAL

DT = 0.02
PLAIN = """
name = "commanded"
reference = { area = 0.66, chord = 0.285, span = 2.32, airspeed = 24.0 }
mass.mass = 8.5
mass.inertia = { xx = 1.38, yy = { value = 0.84, prior = "guess" }, zz = { value = 2.17, prior = 0.2, free = false } }
"""
CONTROLS = """
[controls]
aileron = { mix = { control_roll = 0.35 } }
elevator = { mix = { servo_1 = 0.3, servo_2 = 0.3 } }
[controls.rudder]
mix = { control_yaw = -0.35 }
"""
PROPELLER = """
propulsion = { kind = "propeller", channel = "control_throttle", speed_gain = 147.2, diameter = 0.4, \
    CT0 = 0.14, CT1 = { value = -0.1, prior = 0.03 } }
"""


def completed(text: str, dt: float = DT) -> tuple[Vehicle, set[str]]:
    vehicle, found = with_assumptions(parse_vehicle(text, "x"), dt)
    return vehicle, {one.code for one in found}


def free(vehicle: Vehicle) -> set[str]:
    return {p.name for p in vehicle.parameters if p.free and "." in p.name and not p.name.endswith(".bias")}


def test_one_lag_and_one_delay_for_all_servos_that_commands_move() -> None:
    vehicle, codes = completed(PLAIN + CONTROLS)
    assert codes == {"lag-assumed", "delay-assumed"}
    assert free(vehicle) == {"controls.aileron.lag", "controls.aileron.delay", "mass.inertia.yy"}
    for kind in ("lag", "delay"):
        assert len({vehicle.rows[f"controls.{c}.{kind}"] for c in ("aileron", "elevator", "rudder")}) == 1
    lag, delay = (vehicle.parameters[vehicle.rows[f"controls.rudder.{k}"]] for k in ("lag", "delay"))
    assert (lag.value, lag.prior, lag.lower) == (USUAL.lag, USUAL.lag_std, 0.0)
    assert delay.lower < 0.0 < delay.upper  # measurements may be stamped late
    # what stands in the identified file is not assumed again
    assert with_assumptions(vehicle, DT) == (vehicle, ())


def test_what_the_file_gives_of_one_servo_stands() -> None:
    for line, lag in (("lag = 0", 0.0), ("lag = 0.04", 0.04), ("delay = 0", 0.05)):
        vehicle, _ = completed(PLAIN + CONTROLS + line)  # of the rudder
        assert free(vehicle) == {"controls.aileron.lag", "controls.aileron.delay", "mass.inertia.yy"}
        assert [vehicle.value(f"controls.rudder.{k}", 0.0) for k in ("lag", "delay")] == [lag, 0.0]
    shared = CONTROLS.replace("control_yaw = -0.35", "servo_1 = 0.3")  # servos of one channel have its delay
    vehicle, _ = completed(PLAIN + shared + "lag = 0.04")
    assert [f"controls.{c}.delay" in vehicle.rows for c in ("elevator", "aileron")] == [False, True]
    assert not [s for s in parse_vehicle(PLAIN + CONTROLS + "lag = 0.0", "x").states if s.endswith(".lag")]


def test_deflections_have_no_lag_and_slow_logs_show_none() -> None:
    assert completed(PLAIN) == (parse_vehicle(PLAIN, "x"), set())
    assert not free(completed(PLAIN + CONTROLS, 0.2)[0]) - {"mass.inertia.yy"}
    slow, _ = completed(PLAIN + CONTROLS, 0.1)
    lag = slow.parameters[slow.rows["controls.aileron.lag"]]
    assert lag.lower == pytest.approx(USUAL.lag_samples * 0.1)


def test_motors_of_rotors() -> None:
    quad = builtin_vehicle("quad-x")
    assert with_assumptions(quad, DT) == (quad, ())  # its file gives a lag
    vehicle, _ = completed(quad.text.replace("lag = 0.05", ""))
    assert {"rotors.lag", "rotors.delay"} <= free(vehicle)
    speeds = quad.text.replace("lag = 0.05", "").replace('channel = "motor_', 'channel = "rotor_')
    assert "rotors.lag" not in completed(speeds)[0].rows


def test_thrust_is_uncertain_unless_the_file_says_how_well_it_is_known() -> None:
    vehicle, codes = completed(PLAIN + PROPELLER)
    assert codes == {"thrust-assumed"}
    assert free(vehicle) == {"propulsion.CT0", "propulsion.CT1", "mass.inertia.yy"}
    priors = {p.name: p.prior for p in vehicle.parameters}
    assert (priors["propulsion.CT0"], priors["propulsion.CT1"]) == (pytest.approx(USUAL.thrust * 0.14), 0.03)
    known = PROPELLER.replace("CT0 = 0.14", "CT0 = { value = 0.14, free = false }")
    assert "propulsion.CT0" not in free(completed(PLAIN + known)[0])
    loading = '[loadings.heavy]\n"propulsion.CT0" = 0.15\n'
    assert "propulsion.CT0" not in free(completed(PLAIN + PROPELLER + loading)[0])


def test_a_prior_frees_its_number_and_a_guess_is_one() -> None:
    vehicle = parse_vehicle(PLAIN + "[sensors.alpha]\nbias = { value = 0.0, prior = 0.01 }\n", "x")
    known = {p.name: p for p in vehicle.parameters}
    names = ("mass.inertia.yy", "mass.inertia.zz", "sensors.alpha.bias", "sensors.beta.bias")
    assert [known[name].free for name in names] == [True, False, True, False]
    assert known["mass.inertia.yy"].prior == pytest.approx(0.3 * 0.84)
    assert 0.0 < known["mass.inertia.yy"].lower < 0.84
    guess = PLAIN.replace("area =", 'alpha = { value = 0.0, prior = "guess" }, area =')
    with pytest.raises(VehicleError, match="other than zero"):
        parse_vehicle(guess, "x")


def transfer(lag: float, s: complex) -> complex:
    """Return output over command of the equations of a lag at a complex frequency."""
    x, u = sp.symbols("x u")
    output, rate = lagged(x, u, sp.Float(lag))
    state = sp.solve(sp.Eq(s * x, rate.subs(u, 1)), x)[0]
    return complex(output.subs({u: 1, x: state}))


def test_a_lag_is_of_first_order_and_none_passes_the_command() -> None:
    for lag in (SHORTEST_LAG, 0.3):
        assert transfer(lag, 20j) == pytest.approx(1.0 / (1.0 + 20j * lag), rel=1e-12)
    assert transfer(0.0, 20j) == pytest.approx(1.0, rel=1e-12)
    _, rate = lagged(sp.Float(0.0), sp.Float(1.0), sp.Float(0.0))
    assert float(rate) == pytest.approx(2.0 / SHORTEST_LAG)  # stable in steps of up to 0.028 s


def test_short_lags_differ_in_second_order_only() -> None:
    """(1 + a s) / (1 + (a + lag) s) has the phase of the lag at low frequency: the difference falls as s squared."""
    for lag in (0.002, 0.015):
        errors = [abs(transfer(lag, 1j * w) - 1.0 / (1.0 + 1j * w * lag)) for w in (2.0, 4.0)]
        assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.05)
        assert abs(transfer(lag, 20j) - 1.0 / (1.0 + 20j * lag)) < 0.02


def test_output_and_rate_are_smooth_in_the_lag() -> None:
    for i in (0, 1):
        lags = [sp.Float(SHORTEST_LAG + h) for h in (-1e-6, 0.0, 1e-6)]
        short, at, long = (float(lagged(sp.Float(0.3), sp.Float(1.0), lag)[i]) for lag in lags)
        assert (at - short) / 1e-6 == pytest.approx((long - at) / 1e-6, rel=1e-3, abs=1e-3)
