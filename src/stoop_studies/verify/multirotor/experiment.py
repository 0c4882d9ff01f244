"""The multirotor of an independent simulator identified from its outputs, against its own rotors and its own body."""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np

from stoop_studies.findings import Findings, Setting
from stoop_studies.verify.experiment import Samples, Verification, work
from stoop_studies.verify.jsbsim.experiment import HEAD as JSBSIM_HEAD
from stoop_studies.verify.jsbsim.experiment import Case, Identified, identified_findings
from stoop_studies.verify.jsbsim.flight import Subject
from stoop_studies.verify.multirotor.flight import CLIMB, DURATION, MOTORS, TURNS, Quadrotor, fly
from stoop_studies.verify.multirotor.truth import KNOWN, NOISE, motor_curve, truth, vehicle_of

SPEEDS: Final = "speeds"  #: recorded are the speeds of the rotors
COMMANDS: Final = "commands"  #: recorded are the commands alone
HEAD: Final = ("recorded", *JSBSIM_HEAD[1:])
LEAD: Final = f"""\
The F450 of JSBSim's own package, a quadrotor of 1.4 kg with brushless motors and tables of measured propellers, is flown \
by a simple autopilot that shakes it on all four axes for {DURATION:.0f} s of a climb at {CLIMB:g} m/s. Its instruments are \
read, noise is added, and stoop identifies rotors, drag and inertia from short windows, mass and geometry known. What it \
finds is held against what JSBSim's own rotors and body do along that flight, each force for itself."""
WORDS: Final = """\
Estimate, standard error and difference are those of the first flight. An estimate agrees within 3 of its standard errors \
or 2 % of the true value, whichever is larger. The last column is the difference of the mean over all flights, in standard \
errors of one."""
RECORDS: Final = (
    Subject(
        SPEEDS,
        "Speeds of the rotors recorded",
        "As an autopilot does that hears its speed controllers: what the motors do is seen, what the propellers do is found.",
    ),
    Subject(
        COMMANDS,
        "Commands alone recorded",
        "The lag of the motors is found, too. How fast they turn at a command is told (a straight line from the stand): "
        "otherwise thrust, torque and inertia of a rotor could be told per command only.",
    ),
)


@functools.cache
def case(recorded: str) -> Case:
    """Fly the vehicle, and measure it on the stand.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its data have changed.
    """
    airborne, clamped = Quadrotor(), Quadrotor()
    flown = fly(airborne)
    by_speed = recorded == SPEEDS
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    motor = None if by_speed else motor_curve(clamped, middle)
    found = truth(clamped, flown, motor)
    vehicle = vehicle_of(clamped, flown, found, motor)
    channels = (*NOISE, "altitude", *(TURNS if by_speed else MOTORS))
    unknown = {n: v for n, v in found.items() if n not in KNOWN}
    return Case("f450", vehicle, flown, unknown, NOISE, channels, int(by_speed))


@work
def identify_once(recorded: str, seed: int) -> dict[str, Any]:
    """Identify the vehicle from one noisy flight."""
    known = case(recorded)
    return known.estimates(known.flight(seed))


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how far the estimates are off."""
    title = "JSBSim's F450, identified from its outputs"
    found = [Identified(record, samples[record.model]) for record in RECORDS]
    return identified_findings(title, LEAD, WORDS, "parameter", HEAD, found, NOISE)


EXPERIMENT: Final = Verification(
    "multirotor",
    show,
    runs=10,
    work="stoop_studies.verify.multirotor.experiment:identify_once",
    cases=(SPEEDS, COMMANDS),
)
