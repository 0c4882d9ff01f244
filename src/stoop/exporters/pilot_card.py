"""A card from which a pilot flies steps, while somebody counts aloud."""

from __future__ import annotations

import math
from typing import Final

from stoop.errors import SimulationError
from stoop.exporters.injection import Injection, Target
from stoop.simulation.maneuver import PATTERNS, Steps, amplitude_text

NUMBERS: Final = (
    "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
)  # fmt: skip
WIDTH: Final = 16  #: characters of the first column
STICKS: Final = ("aileron", "elevator", "rudder")
DIRECTIONS: Final = {
    "roll": ("right wing down", "left wing down"),
    "pitch": ("nose up", "nose down"),
    "yaw": ("nose right", "nose left"),
}  #: of a positive and of a negative moment
LIMITS: Final = {
    "V": ("airspeed", "m/s", 1.0),
    "phi": ("bank", "deg", math.degrees(1.0)),
    "theta": ("pitch", "deg", math.degrees(1.0)),
}
HEAD: Final = """\
FLIGHT CARD: {name}
Airspeed {V:.3g} m/s, altitude {h:.0f} m, straight and level, throttle fixed, calm air.
Beat {beat:g} s: {pace} counts a second, aloud. One stop for each stick, the same to both sides.
Manual mode, or the mode with the least feedback. Begin with half of each stop; fly each line twice.
"""
TAIL: Final = """\
{limits}Write down: time, line, wind, what went wrong. Words to stop: "knock it off".
"""


def card(injection: Injection) -> str:
    """Return the card.

    Raises
    ------
    SimulationError
        The maneuver is not one of steps on a beat.
    """
    if injection.beat is None or not all(isinstance(spec, Steps) for spec in injection.maneuver.input):
        raise SimulationError("pilot: a card holds steps on a beat; design with --for pilot")
    other = [c for c in injection.moved_controls if c not in STICKS]
    if other:
        raise SimulationError(
            f"pilot: sticks move {', '.join(STICKS)}, not {other[0]}; exclude it with --amplitude {other[0]}=0"
        )
    start, beat = injection.trim.start, injection.beat
    parts = [
        HEAD.format(name=injection.name, V=start["V"], h=start["h"], beat=beat, pace=f"{1.0 / beat:.3g}")
    ]
    for i, spec in enumerate(sorted(injection.maneuver.input, key=lambda one: one.start), 1):
        if isinstance(spec, Steps):
            parts.append(f"{i}. {_line(injection, spec)}")
    limits = []
    for channel, (name, unit, factor) in LIMITS.items():
        if channel in injection.envelope:
            low, high = (factor * edge for edge in injection.envelope[channel])
            limits.append(f"{name} {low:.0f} to {high:.0f} {unit}")
    if injection.caution:
        parts.append(f"CAUTION: {injection.caution}.\n")
    edges = f"Break off and recover beyond: {', '.join(limits)}.\n" if limits else ""
    parts.append(TAIL.format(limits=edges))
    return "\n".join(parts)


def _line(injection: Injection, spec: Steps) -> str:
    """Return the steps of one control, with the counts of each."""
    axis, moment = max(injection.moments(spec.control).items(), key=lambda item: abs(item[1]))
    throw = injection.throws.get(spec.control)
    stick = f" ({100.0 * abs(spec.amplitude) / throw:.0f} % of the stick)" if throw else ""
    stop = amplitude_text(spec.control, abs(spec.amplitude))
    counts = round(spec.step / (injection.beat or 1.0))
    rows = [f"{spec.control.upper()} {spec.shape}: stop at {stop}{stick}", f'   {"":{WIDTH}} "steady"']
    for i, length in enumerate(PATTERNS[spec.shape]):
        upward = (moment * spec.amplitude > 0.0) == (i % 2 == 0)
        words = [NUMBERS[k % len(NUMBERS)] for k in range(length * counts)]
        rows.append(f"   {DIRECTIONS[axis][0 if upward else 1]:{WIDTH}} {' - '.join(words)}")
    rows.append(f"   {'hands off':{WIDTH}} three seconds or more, then trim again")
    return "\n".join(rows) + "\n"


PILOT: Final = Target(
    lambda injection: {"card.txt": card(injection)}, ("card.txt",), on_wings=True, on_rotors=False,
    advice="its sticks command rates or angles; choose --for ardupilot or crazyflie",
)  # fmt: skip
