"""Windows of a planned maneuver: where controls move, with what goes before and after."""

from __future__ import annotations

from stoop.design.planned import planned
from stoop.simulate.maneuver import Maneuver, parse_maneuver
from stoop.vehicle.builtin import builtin_vehicle

AIRCRAFT, MULTIROTOR = builtin_vehicle("twin-boom"), builtin_vehicle("quad-x")


def maneuver(duration: float, *pulses: tuple[str, float]) -> Maneuver:
    """Pulses of 2 s."""
    text = "\n".join(
        f'[[input]]\ncontrol = "{control}"\nshape = "pulse"\nstart = {start}\nduration = 2.0\namplitude = 0.1'
        for control, start in pulses
    )
    return parse_maneuver(f'format = "stoop-maneuver/1"\nduration = {duration}\nrate = 50.0\n{text}', "m")


def test_an_aircraft_is_fitted_from_one_start_through_its_phugoid() -> None:
    plan = planned(maneuver(100.0, ("elevator", 5.0), ("rudder", 20.0)), AIRCRAFT)
    assert (plan.fit, plan.validate) == (("4:42",), ())


def test_long_rests_are_left_out() -> None:
    plan = planned(maneuver(300.0, ("elevator", 5.0), ("rudder", 100.0)), AIRCRAFT)
    assert plan.fit == ("4:27", "99:122")


def test_one_stretch_of_what_hovers_is_predicted_where_others_move_its_controls() -> None:
    flown = maneuver(60.0, ("roll", 5.0), ("pitch", 10.0), ("yaw", 15.0), ("roll", 40.0), ("pitch", 40.5))
    plan = planned(flown, MULTIROTOR)
    assert plan.validate == ("4:8",)
    assert plan.fit == ("9:18", "39:43.5")


def test_none_is_predicted_where_each_moves_a_control_of_its_own() -> None:
    plan = planned(maneuver(60.0, ("roll", 5.0), ("pitch", 10.0), ("yaw", 30.0)), MULTIROTOR)
    assert (plan.fit, plan.validate) == (("4:13", "29:33"), ())


def test_nothing_moves() -> None:
    assert planned(maneuver(10.0), MULTIROTOR).fit == ()
    assert planned(maneuver(10.0, ("roll", 20.0)), MULTIROTOR).fit == ()
