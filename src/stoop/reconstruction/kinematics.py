"""Kinematics driven by what the inertial sensors read: exact, whatever the aircraft is.

The point that is followed is the accelerometer's own, so that no rate has to be differentiated. Everything
else sits at a position relative to a reference point, the one whose velocity over ground was logged::

    d(u, v, w)/dt = f + g R' z - omega x (u, v, w)      f = (a - bias) / scale, omega likewise
    d(e0 ... e3)/dt = quaternion kinematics             from the same omega
    d(n, e, d)/dt = R (u, v, w)

    air at a sensor = (u, v, w) + omega x (r_sensor - r_accelerometer) - R' wind

All vectors are in body axes forward-right-down but wind and position (north-east-down). The expressions are
those of the vehicle's equations of motion (`stoop.vehicle.symbolic`), with the specific force measured
instead of modeled.

References
----------
Klein and Morelli, "Aircraft System Identification", 2nd ed., chapter 10 (data compatibility).
Jategaonkar, "Flight Vehicle System Identification", 2nd ed., chapter 10 (flight path reconstruction).
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any, Final

from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import WRAPPED
from stoop.kernels import Kernel, SymbolicModel, load_kernel

STATES: Final = ("u", "v", "w", "e0", "e1", "e2", "e3", "pn", "pe", "pd")
INPUTS: Final = ("ax", "ay", "az", "p", "q", "r")
OUTPUTS: Final = (
    "V", "airspeed_pitot", "alpha", "beta", "phi", "theta", "psi", "vn", "ve", "vd", "pn", "pe", "pd",
)  # fmt: skip
WIND: Final = ("wind.n", "wind.e", "wind.d")
POINTS: Final = ("accelerometer", "vane")
SCALED: Final = (*INPUTS, "V", "airspeed_pitot", "alpha", "beta")
BIASED: Final = (*SCALED, "phi", "theta", "psi")
PARAMETERS: Final = (
    *(f"{name}.bias" for name in BIASED),
    *(f"{name}.scale" for name in SCALED),
    *WIND,
    *(f"{point}.{axis}" for point in POINTS for axis in "xyz"),
)


def model() -> SymbolicModel:
    """Return the equations."""
    import sympy as sp

    from stoop.vehicle.symbolic import frames
    from stoop.vehicle.symbolic.frames import Vector, add, cross, over_ground, subtract, to_body

    x = {name: sp.Symbol(f"state {name}", real=True) for name in STATES}
    z = {name: sp.Symbol(f"input {name}", real=True) for name in INPUTS}
    n = {name: sp.Symbol(name, real=True) for name in PARAMETERS}
    true = {name: (z[name] - n[f"{name}.bias"]) / n[f"{name}.scale"] for name in INPUTS}
    velocity: Vector = (x["u"], x["v"], x["w"])
    force: Vector = (true["ax"], true["ay"], true["az"])
    omega: Vector = (true["p"], true["q"], true["r"])
    e = (x["e0"], x["e1"], x["e2"], x["e3"])
    turned = frames.attitude(e)
    arm: dict[str, Vector] = {point: (n[f"{point}.x"], n[f"{point}.y"], n[f"{point}.z"]) for point in POINTS}
    wind: Vector = (n["wind.n"], n["wind.e"], n["wind.d"])
    moved = add(velocity, cross(omega, subtract(arm["vane"], arm["accelerometer"])))
    vane = frames.air(subtract(moved, to_body(e, wind)))
    ground = over_ground(e, subtract(velocity, cross(omega, arm["accelerometer"])))
    truth = {
        "V": vane.V, "airspeed_pitot": vane.V, "alpha": vane.alpha, "beta": vane.beta,
        "phi": turned.phi, "theta": turned.theta, "psi": turned.psi,
        **dict(zip(("vn", "ve", "vd"), ground, strict=True)),
        **{name: x[name] for name in ("pn", "pe", "pd")},
    }  # fmt: skip
    acceleration = frames.body_acceleration(force, sp.Float(STANDARD_GRAVITY), turned.down, velocity, omega)
    rates: tuple[Any, ...] = (*acceleration, *frames.quaternion_rate(e, omega), *ground)
    return SymbolicModel(
        states=tuple(x.values()),
        inputs=tuple(z.values()),
        parameters=tuple(n.values()),
        derivatives=rates,
        # scale (upwash, for a vane) and bias, where a channel has them
        outputs=tuple(n.get(f"{k}.scale", 1) * truth[k] + n.get(f"{k}.bias", 0) for k in OUTPUTS),
        output_names=OUTPUTS,
        wrapped=tuple(name in WRAPPED for name in OUTPUTS),
    )


@functools.cache
def kernel() -> Kernel:
    """Return the compiled equations."""
    # what decides the equations: this file and the symbols that it is made of
    sources = [Path(__file__), Path(__file__).parents[1] / "vehicle" / "symbolic" / "frames.py"]
    version = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    return load_kernel(f"kinematics {version}", model)
