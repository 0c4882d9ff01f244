"""A stock aircraft trimmed and flown through a maneuver on all three controls, read at 100 Hz."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import root

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.simulate import parse_maneuver
from stoop_studies.verify.jsbsim_truth.aircraft import SURFACES, Stock
from stoop_studies.verify.jsbsim_truth.machine import FOOT, POUND, RATE, STEP, Machine, State

MANEUVER: Final = """
format = "stoop-maneuver/1"
duration = {duration}
rate = {rate}
{inputs}"""
INPUT: Final = """
[[input]]
control = "{control}"
shape = "multisine"
start = 1.0
duration = {duration}
amplitude = {amplitude}
band = {band}
first = {first}
stride = 3
"""
DURATION: Final = 30.0  #: s
CLEAN: Final = {"gear/gear-pos-norm": 0.0, "fcs/mixture-pos-norm": 0.0}
RATES: Final = tuple(
    f"accelerations/{a}dot-{unit}" for axes, unit in (("uvw", "ft_sec2"), ("pqr", "rad_sec2")) for a in axes
)
READ: Final = {
    "V": ("velocities/vt-fps", FOOT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    **{a: (f"velocities/{a}i-rad_sec", 1.0) for a in "pqr"},
    **{a: (f"attitude/{a}-rad", 1.0) for a in ("phi", "theta", "psi")},
    **{f"a{a}": (f"accelerations/a-pilot-{a}-ft_sec2", FOOT) for a in "xyz"},
    "altitude": ("position/h-sl-ft", FOOT),
    "thrust": ("forces/fbx-prop-lbs", POUND),
}  #: channel -> property and its unit: gyros sense the rate in space, accelerometers sit at the pilot's eye


@dataclass(frozen=True)
class Trim:
    """A state without acceleration, and the deflections that hold it."""

    state: State
    deflections: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Recording:
    """A flight without noise.

    Attributes
    ----------
    time : (n,), s
    columns : mapping
        Channel -> (n,), SI.
    """

    time: FloatArray
    columns: Mapping[str, FloatArray]

    @property
    def altitude(self) -> float:
        """Mean altitude, m."""
        return float(self.columns["altitude"].mean())


def machine(stock: Stock) -> Machine:
    """Return JSBSim with a clean aircraft in it."""
    throttle = 0.0 if stock.throttle is None else stock.throttle
    held = {**CLEAN, "fcs/throttle-pos-norm": throttle, "fcs/throttle-pos-norm[1]": throttle}
    return Machine(stock.model, held, stock.throttle is not None)


def trimmed(stock: Stock, jsbsim: Machine) -> Trim:
    """Return the straight flight at the stock's airspeed; what the thrust leaves over climbs or sinks.

    Raises
    ------
    StoopError
        There is none.
    """

    def point(x: FloatArray) -> Trim:
        alpha, theta, phi = (float(v) for v in x[:3])
        state = State(stock.airspeed, stock.altitude, alpha=alpha, theta=theta, phi=phi)
        return Trim(state, dict(zip(SURFACES, map(float, x[3:]), strict=True)))

    def accelerations(x: FloatArray) -> FloatArray:
        trim = point(x)
        jsbsim.put(trim.state, written(stock, trim.deflections))
        return jsbsim.read(RATES)

    found = root(accelerations, np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]), tol=1e-10)
    if np.abs(found.fun).max() > 1e-6:
        raise StoopError(
            f"jsbsim: {stock.model} finds no trim at {stock.airspeed:g} m/s; its data may have changed"
        )
    return point(found.x)


def written(stock: Stock, deflections: Mapping[str, float]) -> dict[str, float]:
    """Return deflections by property."""
    return {stock.surfaces[control]: value for control, value in deflections.items()}


def maneuver(stock: Stock) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the time (n,) and the change (n,) of each stick: orthogonal multisines on all three."""
    inputs = "".join(
        INPUT.format(control=c, duration=DURATION - 2.0, amplitude=a, band=stock.band, first=i + 5)
        for i, (c, a) in enumerate(stock.amplitude.items())
    )
    text = MANEUVER.format(duration=DURATION, rate=float(RATE), inputs=inputs)
    parsed = parse_maneuver(text, stock.model)
    return parsed.time, parsed.deflections()


def fly(stock: Stock, jsbsim: Machine, trim: Trim) -> Recording:
    """Fly the maneuver from trim, and read the instruments at 100 Hz.

    Between the samples the deflections move on straight lines, as the record is taken to say.
    """
    time, moves = maneuver(stock)
    deflections = np.column_stack([trim.deflections[c] + moves.get(c, 0.0 * time) for c in SURFACES])
    names = [*(p for p, _ in READ.values()), *(stock.surfaces[c] for c in SURFACES)]
    jsbsim.put(trim.state, written(stock, dict(zip(SURFACES, deflections[0], strict=True))))
    fine = round(1.0 / (RATE * STEP))
    rows = [jsbsim.read(names)]
    for before, after in itertools.pairwise(deflections):
        for k in range(1, fine + 1):
            now = before + (after - before) * (k / fine)
            jsbsim.step(written(stock, dict(zip(SURFACES, now.tolist(), strict=True))))
        rows.append(jsbsim.read(names))
    units = np.array([*(unit for _, unit in READ.values()), *(1.0 for _ in SURFACES)])
    table = np.array(rows) * units
    return Recording(time, dict(zip((*READ, *SURFACES), table.T, strict=True)))
