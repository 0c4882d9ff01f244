"""Gains that flew and better ones, around draws of a model."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import BLUE, FAINT, INK, ORANGE, SOFT, plots
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_tune.control_laws.table import firmware_of
from stoop_tune.gain_search import Design, Specification, propose
from stoop_tune.loops import frequencies
from stoop_tune.tuning import conditions_of

FLOWN = {
    "FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_RR_FF": 0.3, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_PR_FF": 1.0, "FW_YR_P": 0.3,
    "FW_YR_I": 0.1, "FW_YR_FF": 0.0, "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MIN": 20.0, "FW_AIRSPD_MAX": 50.0,
}  # fmt: skip
THROW = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}
UNSURE = ("Cmelevator", "Cmq", "Cmalpha", "controls.elevator.lag")
SPREAD, DRAWS = 0.08, 40
EVERY = 3  #: so many frequencies one is drawn
PITCH = 1


def design() -> Design:
    """Return the pitch loop of the twin-boom airplane under PX4's law, its pitching moment known to a few percent."""
    entries = {("controls", s, "mix"): {f"control_{axis}": x} for s, (axis, x) in THROW.items()}
    entries |= {("controls", s, n): x for s in THROW for n, x in (("lag", 0.048), ("delay", 0.036))}
    vehicle, rng = with_entries(builtin_vehicle("twin-boom"), entries), np.random.default_rng(0)
    drawn = np.column_stack([vehicle.value(n) * (1.0 + SPREAD * rng.standard_normal(DRAWS)) for n in UNSURE])
    firmware = firmware_of(FLOWN, rotors=False)
    conditions = conditions_of(vehicle, firmware, FLOWN, [35.0], 200.0, Draws(UNSURE, drawn, "covariance"))
    return Design(firmware, FLOWN, ("roll", "pitch", "yaw"), conditions, Specification(), {})


@picture("gains")
def gains() -> Figure:
    """The pitch loop of an airplane with gains that flew and with proposed ones, at the estimates and at draws of the model.

    Left, a Nichols plot: the proposed loop passes closer by the cross of gain and phase margin. Right, the sensitivity:
    the proposed gains reduce slow disturbances by twice as many decibels, at the price of a higher peak near 10 rad/s.
    """
    own = design()
    frequency = frequencies([own.loop(FLOWN, "pitch", own.conditions[0])])[::EVERY]
    figure, (nichols, sensitivity) = plots(1, 2, 3.2)
    kept = own.specification
    nichols.plot([-180.0 - kept.phase, -180.0 + kept.phase], [0.0, 0.0], color=FAINT, linewidth=5.0, zorder=0)
    nichols.plot([-180.0, -180.0], [-kept.gain, kept.gain], color=FAINT, linewidth=5.0, zorder=0)
    for color, label, values in ((ORANGE, "flown", {}), (BLUE, "proposed", propose(own))):
        loops = own.opened({**FLOWN, **values}, 0, 1 + DRAWS)[PITCH, :, ::EVERY]
        for i, loop in reversed(list(enumerate(loops))):
            line = {"color": color, "linewidth": 0.4 if i else 1.8, "alpha": 0.4 if i else 1.0}
            phase = np.degrees(np.unwrap(np.angle(loop)))
            nichols.plot(phase, 20.0 * np.log10(np.abs(loop)), label=None if i else label, **line)
            sensitivity.semilogx(frequency, -20.0 * np.log10(np.abs(1.0 + loop)), **line)
    nichols.set(xlabel="phase, deg", ylabel="magnitude, dB", xlim=(-290.0, -60.0), ylim=(-22.0, 22.0))
    nichols.set_xticks([-270.0, -180.0, -90.0])
    nichols.text(-180.0, 8.0, "6 dB, 45 deg", color=SOFT, ha="center", fontsize=9.0)
    nichols.legend(loc="lower right")
    sensitivity.axhline(-3.0, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    sensitivity.text(0.25, -2.3, "-3 dB", color=INK, fontsize=9.0)
    sensitivity.set(xlabel="frequency, rad/s", ylabel="sensitivity, dB", xlim=(0.2, 100.0), ylim=(-22.0, 8.0))
    return figure
