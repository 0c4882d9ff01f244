"""The method of identification that suits vehicle and recording, where none is named."""

from __future__ import annotations

from typing import Final

from stoop.base.notices import notice
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VARIABLES
from stoop.estimate import methods
from stoop.flight.gridding import GIVEN, GRID_RATES, SAME_RATE
from stoop.strategy.decision import Change, Decision, Setup
from stoop.vehicle.channels import AIR_FRAME, GROUND_FRAME
from stoop.vehicle.schema import WIND

#: by kind of vehicle: open loop one on rotors falls before a record ends
USUAL: Final = {AIR_FRAME: methods.DEFAULT, GROUND_FRAME: "multiple-shooting"}
SLOW_MOTORS: Final = "equation-error"  #: with rotors whose motors were logged at less than `MIN_MOTOR_RATE`
MIN_MOTOR_RATE: Final = GRID_RATES[0]
"""Hz, so that every step of an integration has a command of its own. What moves the motors faster than half the rate of their log
looks slow in it, and the vehicle seems to answer less: of a simulated flight with shaken motors
(tests/recovery/test_slow_motors.py), lag and delay held, multiple shooting makes the inertia 2.4 too large at 25 Hz, 0.39 at 50
Hz, 0.13 at 100 Hz; equation error 0.34, 0.24 and 0.06. With a lag to estimate, the error bars of multiple shooting hold at 50 Hz
(1.29 ± 0.41), those of equation error do not (1.19 ± 0.02)."""
#: with rotors where neither velocity nor attitude was recorded: rates are then all that regressors hold of the motion, their
#: noise hardly biases, and a simulation would have to estimate the states of every window from nothing
STATELESS: Final = "equation-error"


def choose(setup: Setup) -> Change | None:
    """Return the fit by the method that suits vehicle and recording."""
    vehicle, usual = setup.vehicle, USUAL[setup.vehicle.frame]
    if not setup.free_method or vehicle.frame == AIR_FRAME:
        return None
    recorded = [set(flight.channels) for flight in setup.flights.values()]
    sensed = all({*RATES, *SPECIFIC_FORCE} <= own and not own & {*WIND, *EULER} for own in recorded)
    if recorded and sensed:
        why = notice("no-states-recorded", method=STATELESS, other=usual)
        found = "neither velocity nor attitude was recorded"
        return Change(setup.by(STATELESS).noting(why), found, STATELESS)
    rate = slowest_motors(setup)
    if rate < MIN_MOTOR_RATE:
        why = notice("motors-logged-slowly", rate=rate, limit=MIN_MOTOR_RATE, method=SLOW_MOTORS, other=usual)
        return Change(setup.by(SLOW_MOTORS).noting(why), f"motors were logged at {rate:.0f} Hz", SLOW_MOTORS)
    return Change(setup.by(usual), "the vehicle flies on rotors", usual)


def slowest_motors(setup: Setup) -> float:
    """Return the lowest rate at which commands of motors were logged, at most `MIN_MOTOR_RATE`, Hz."""
    channels = {rotor.channel for rotor in setup.vehicle.file.rotor.values()}
    rates = [
        source.rate
        for flight in setup.flights.values()
        for c in channels & flight.sources.keys()
        # measured speeds are smooth, and columns given on their grid hold all that was commanded
        if VARIABLES[c].kind != "measurement"
        and not ((source := flight.sources[c]).source in GIVEN and SAME_RATE * source.rate > flight.rate)
    ]
    return min((r for r in rates if 0.0 < SAME_RATE * r < MIN_MOTOR_RATE), default=MIN_MOTOR_RATE)


METHOD = Decision("method", "Which method suits the vehicle and what was recorded of it?", problem=choose)
