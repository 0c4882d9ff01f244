"""Windows of a planned maneuver: where controls move, with what goes before and after."""

from __future__ import annotations

from stoop.input_design.candidates import STYLES, maneuver_windows
from stoop.simulation.maneuver import Maneuver, parse_maneuver
from stoop.vehicle.vehicle import AIR_FRAME, GROUND_FRAME

ON_WINGS, ON_ROTORS = (STYLES[frame] for frame in (AIR_FRAME, GROUND_FRAME))


def maneuver(duration: float, *pulses: tuple[str, float]) -> Maneuver:
    """Pulses of 2 s."""
    text = "\n".join(
        f'[[input]]\ncontrol = "{control}"\nshape = "pulse"\nstart = {start}\nduration = 2.0\namplitude = 0.1'
        for control, start in pulses
    )
    return parse_maneuver(f'format = "stoop-maneuver/1"\nduration = {duration}\nrate = 50.0\n{text}', "m")


def test_an_aircraft_is_fitted_from_one_start_through_its_phugoid() -> None:
    plan = maneuver_windows(maneuver(100.0, ("elevator", 5.0), ("rudder", 20.0)), ON_WINGS)
    assert (plan.fit, plan.validate) == (("4:42",), ())


def test_long_rests_are_left_out() -> None:
    plan = maneuver_windows(maneuver(300.0, ("elevator", 5.0), ("rudder", 100.0)), ON_WINGS)
    assert plan.fit == ("4:27", "99:122")


def test_one_stretch_of_what_hovers_is_predicted_where_others_move_its_controls() -> None:
    flown = maneuver(60.0, ("roll", 5.0), ("pitch", 10.0), ("yaw", 15.0), ("roll", 40.0), ("pitch", 40.5))
    plan = maneuver_windows(flown, ON_ROTORS)
    assert plan.validate == ("4:8",)
    assert plan.fit == ("9:18", "39:43.5")


def test_none_is_predicted_where_each_moves_a_control_of_its_own() -> None:
    plan = maneuver_windows(maneuver(60.0, ("roll", 5.0), ("pitch", 10.0), ("yaw", 30.0)), ON_ROTORS)
    assert (plan.fit, plan.validate) == (("4:13", "29:33"), ())


def test_nothing_moves() -> None:
    assert maneuver_windows(maneuver(10.0), ON_ROTORS).fit == ()
    assert maneuver_windows(maneuver(10.0, ("roll", 20.0)), ON_ROTORS).fit == ()
