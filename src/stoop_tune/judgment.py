"""Margins of the gains that flew: of every axis, at airspeeds, at the estimates and over draws of the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop import Notice, Vehicle, trim
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.motion import (
    LinearModel,
    Trim,
    linear_models,
)
from stoop.extend.text import without_rounding
from stoop.extend.variables import FAMILIES
from stoop.extend.verbs import hook
from stoop_analysis.draws import Draws
from stoop_analysis.handling import attitude_figures
from stoop_tune.control_laws.rate_law import AXES
from stoop_tune.control_laws.table import Firmware
from stoop_tune.loops import (
    LANES,
    AxisLoop,
    Plants,
    followed,
    frequencies,
    motion,
    opened,
    part_of,
    return_difference,
    stable,
)
from stoop_tune.margins import Margins, joined, margins, rms_of_noise, split

if TYPE_CHECKING:
    import pandas as pd

PERCENTILES: Final = (5, 50, 95)
SMALL: Final = ("phase delay", "noise")  #: figures of which less is better
STOP: Final = 1000.0  #: us, pulse of a motor at a command of zero
COARSE: Final = 4  #: every so many of the frequencies are enough for bandwidth and phase delay, to 1e-3


@dataclass(frozen=True, eq=False)
class AxisMargins:
    """Margins about one axis at one airspeed: first at the estimates, then of draws of the model (1 + d,)."""

    axis: str
    airspeed: float  #: m/s; zero in a hover
    margins: Margins
    stable: float  #: share of the draws whose loops are stable together
    noise: FloatArray  #: rms of the command that the noise of its gyro causes, share of a full one (1 + d,); NaN where unknown
    #: rad/s, phase bandwidth of the attitude over its setpoint, or over that of the rate without an attitude loop
    bandwidth: FloatArray = field(default_factory=lambda: np.full(1, np.nan))
    phase_delay: FloatArray = field(default_factory=lambda: np.full(1, np.nan))  #: s, of the same

    def values(self) -> dict[str, tuple[str, FloatArray]]:
        """Return unit and values (1 + d,) of each figure, as engineers read them."""
        own = self.margins
        with np.errstate(divide="ignore"):
            return {
                "gain margin": ("dB", 20.0 * np.log10(own.gain)),
                "phase margin": ("deg", np.degrees(own.phase)),
                "delay margin": ("s", own.delay),
                "disk margin": ("dB", 20.0 * np.log10(own.disk_gain)),
                "crossover": ("rad/s", own.crossover),
                "rejection": ("rad/s", own.rejection),
                "peak": ("dB", 20.0 * np.log10(own.peak)),
                "bandwidth": ("rad/s", self.bandwidth),
                "phase delay": ("s", self.phase_delay),
                "noise": ("%", 100.0 * self.noise),
            }

    def figures(self) -> dict[str, tuple[str, dict[str, float]]]:
        """Return unit, estimate and percentiles 5, 50 and 95 of each figure; those that nobody knows are left out."""
        out = {}
        for name, (unit, x) in self.values().items():
            if np.isnan(x).all():
                continue
            drawn = np.sort(x[1:]) if len(x) > 1 else x
            spread = {f"p{p}": float(drawn[round(0.01 * p * (len(drawn) - 1))]) for p in PERCENTILES}
            out[name] = unit, {"estimate": float(x[0]), **spread}
        return out


def worst(judged: Sequence[AxisMargins], axis: str, name: str) -> float:
    """Return the 5th percentile of a figure about an axis, the 95th of `SMALL` ones, at the worst airspeed; NaN where unknown."""
    key, least = ("p95", max) if name in SMALL else ("p5", min)
    found = [one.figures() for one in judged if one.axis == axis]
    known = [f[name][1][key] for f in found if name in f and not np.isnan(f[name][1][key])]
    return least(known, default=np.nan)


@dataclass(frozen=True, eq=False)
class Commands:
    """How the commands about axes reach the inputs of a linear model."""

    axes: tuple[str, ...]
    mixing: FloatArray  #: (m, axes), of `model_inputs`
    outputs: FloatArray  #: (n_u, axes), of the recorded channels
    channels: tuple[str, ...]  #: of each axis, whose delay counts


def commands_of(
    vehicle: Vehicle, firmware: Firmware, parameters: Mapping[str, float], altitude: float = 200.0
) -> Commands:
    """Return how the commands of a firmware move a vehicle.

    Surfaces move by the commands themselves (``control_roll`` and so on), or by outputs that the parameters allocate.
    Motors whose thrust is linearized move as they do about the hover at an altitude, m.

    Raises
    ------
    StoopError
        No surface moves by either, or how the motors are mixed is not known.
    """
    inputs = vehicle.model_inputs()
    if firmware.rotors:
        if firmware.mixing is None:
            raise StoopError(
                f"how {firmware.title} mixes its motors is not modeled; take gains of another firmware"
            )
        rotors = vehicle.file.rotor
        places = np.array([[vehicle.value(f"rotor.{n}.position.{a}", 0.0) for a in "xyz"] for n in rotors])
        mixed = firmware.mixing(
            parameters, places, np.array([1.0 if r.spin == "ccw" else -1.0 for r in rotors.values()])
        )
        mixing = np.zeros((len(inputs), len(AXES)))
        outputs = np.zeros((len(vehicle.inputs), len(AXES)))
        units = {"motor": 1.0, "pwm": firmware.pulse(parameters)}
        for rotor, row in zip(rotors.values(), mixed, strict=True):
            kind = rotor.channel.partition("_")[0]
            if kind not in units:
                raise StoopError(
                    f"{vehicle.name}: the rotors turn by {rotor.channel}; what a command makes of it is not known: "
                    "identify with the commands of the motors (motor_1, pwm_1)"
                )
            mixing[inputs.index(rotor.channel)] = row * units[kind]
            outputs[vehicle.inputs.index(rotor.channel)] = row * units[kind]
        channel = next(iter(rotors.values())).channel
        if firmware.thrust_slope is not None:
            hover = float(trim(vehicle, altitude=altitude).inputs[vehicle.rotor_range.columns].mean())
            if channel.startswith("pwm"):
                hover = (hover - STOP) / units["pwm"]
            slope = firmware.thrust_slope(parameters, hover)
            mixing, outputs = slope * mixing, slope * outputs
        return Commands(AXES, mixing, outputs, (channel,) * len(AXES))
    moves = _outputs(parameters) | {f"control_{a}": row for a, row in zip(AXES, np.eye(3), strict=True)}
    driven = np.array([moves.get(c, np.zeros(3)) for c in vehicle.inputs])
    moved = vehicle.channel_gains(vehicle.parameter_rows())[0][:, :, None] * driven  # control, channel, axis
    first = [np.argwhere(moved[:, :, k])[:1, 1] for k in range(3)]
    flown = [
        a
        for a in firmware.axes
        if parameters.get(firmware.enabled_by.get(a, ""), a not in firmware.enabled_by)
    ]
    used = [k for k, axis in enumerate(AXES) if first[k].size and axis in flown]
    if not used:
        raise StoopError(
            f"{vehicle.name}: no surface moves by control_roll, control_pitch or control_yaw, nor by an output "
            "that the parameters allocate (CA_SV_CS0_TYPE, SERVO1_FUNCTION): write these as the channels of its "
            "surfaces and identify again"
        )
    mixing = np.zeros((len(inputs), len(used)))
    mixing[: len(moved)] = moved.sum(axis=1)[:, used]
    late = tuple(vehicle.inputs[int(first[k][0])] for k in used)
    return Commands(tuple(AXES[k] for k in used), mixing, driven[:, used], late)


def _outputs(parameters: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return by output the change of its channel for full commands about the axes (3,).

    PX4 allocates by the pseudo-inverse of the shares that surfaces have in the moments; ArduPilot adds the shares themselves.
    """
    setup = hook("read_setup", "stoop tune", object)(parameters)
    if not setup.surfaces:
        return {}
    shares = np.array([surface.shares for surface in setup.surfaces])
    mixed = without_rounding(np.linalg.pinv(shares.T), 1.0) if setup.autopilot == "PX4" else shares
    return {
        channel: scale.unit * row
        for surface, row in zip(setup.surfaces, mixed, strict=True)
        for channel, scale in surface.channels.items()
    }


def plants_of(vehicle: Vehicle, point: Trim, draws: Draws, commands: Commands) -> Plants:
    """Return the linear models about a trim, at the estimates and then at draws of the numbers."""
    drawn = draws.numbers_of(vehicle)
    points = point.neighbors()({n: np.concatenate([[vehicle.value(n)], x]) for n, x in drawn.items()})
    states, A, B, *_ = linear_models(vehicle, points)
    turning = [i for i, name in enumerate(states) if name not in LinearModel.INTEGRATORS]
    late = {vehicle.inputs[column]: points.rows[row] for column, row in vehicle.input_delays()}
    still = np.zeros(points.rows.shape[1])
    gyros = {
        n: points.rows[row]
        for n in FAMILIES["rates"]
        if (row := vehicle.rows.get(f"sensors.{n}.scale")) is not None
    }
    return Plants(
        tuple(states[i] for i in turning),
        A[:, turning][:, :, turning],
        B[:, turning] @ commands.mixing,
        np.column_stack([late.get(c, still) for c in commands.channels]),
        gyros,
    )


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins of every axis at every airspeed, with what they rest on."""

    firmware: str
    axes: tuple[AxisMargins, ...]
    count: int  #: of draws of the model
    source: str  #: of the draws
    notices: tuple[Notice, ...]

    def __repr__(self) -> str:
        """Return the size on one line."""
        return f"<LoopMargins of {self.firmware}: {len(self.axes)} loops, {self.count} draws>"

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each axis, airspeed and figure: estimate, and percentiles 5, 50 and 95 of the draws."""
        import pandas as pd

        rows = [
            {"axis": one.axis, "airspeed": one.airspeed, "figure": name, "unit": unit, **spread}
            for one in self.axes
            for name, (unit, spread) in one.figures().items()
        ]
        return pd.DataFrame(rows)

    def document(self) -> dict[str, Any]:
        """Return all but the draws for JSON; infinite and unknown margins are null."""
        return {
            "format": "stoop-loop-margins/1", "firmware": self.firmware, "draws": self.count, "source": self.source,
            "loops": [
                {"axis": one.axis, "airspeed": one.airspeed, "stable": one.stable,
                 "figures": {n: {"unit": u, **spread} for n, (u, spread) in one.figures().items()}}
                for one in self.axes
            ],
            "notices": [one.to_dict() for one in self.notices],
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Condition:
    """Linear models about one airspeed, at the estimates and then of draws."""

    airspeed: float  #: m/s; zero in a hover
    #: of trim airspeed to the airspeed that the autopilot reads, as the firmware scales its law; (1 + d, 1) where readings differ
    ratio: FloatArray | float
    plants: Plants

    @property
    def place(self) -> str:
        """Where it is, as messages say it."""
        return f"at {self.airspeed:.4g} m/s" if self.airspeed else "in hover"

    @classmethod
    def joint(cls, conditions: Sequence[Condition]) -> Condition:
        """Return the estimates at some conditions as the models of one, at no airspeed of its own."""
        plants = [one.plants.part(slice(0, 1)) for one in conditions]
        ratios = np.array([[np.ravel(one.ratio)[0]] for one in conditions])
        return cls(math.nan, ratios if np.ptp(ratios) else ratios[0, 0].item(), Plants.joint(plants))

    def part(self, lanes: slice) -> Condition:
        """Return the condition of some of the models."""
        return Condition(self.airspeed, part_of(self.ratio, lanes), self.plants.part(lanes))


def judge(
    condition: Condition, loops: Mapping[str, AxisLoop], noise: Mapping[str, float]
) -> list[AxisMargins]:
    """Return the margins of loops by axis around models; the commands of the models are those about the axes of `loops`.

    Parameters
    ----------
    noise : power spectral density of each axis' gyro, (rad/s)^2/Hz, one-sided
    """
    plants, frequency = condition.plants, frequencies(list(loops.values()))
    count = len(plants.A)
    parts: list[list[Margins]] = []
    noises, holds = np.empty((len(loops), count)), np.empty(count, dtype=bool)
    for begin in range(0, count, LANES):
        lanes = slice(begin, begin + LANES)
        part, own = plants.part(lanes), [loop.part(lanes) for loop in loops.values()]
        holds[lanes] = stable(part, own)
        returned = opened(return_difference(motion(part, frequency), own, frequency))
        parts.append(split(margins(frequency, returned.reshape(-1, len(frequency))), len(loops)))
        for i, (axis, loop) in enumerate(zip(loops, own, strict=True)):
            density = noise.get(axis, np.nan)
            noises[i, lanes] = rms_of_noise(
                frequency, loop.law.feedback(frequency, loop.scale), returned[i], density
            )
    share = float(np.mean(holds[1:])) if count > 1 else float(holds[0])
    return [
        AxisMargins(
            axis, condition.airspeed, joined(found).where(holds), share, np.where(holds, noises[i], np.inf)
        )
        for i, (axis, found) in enumerate(zip(loops, zip(*parts, strict=True), strict=True))
    ]


def with_handling(
    condition: Condition, loops: Mapping[str, AxisLoop], judged: Sequence[AxisMargins]
) -> list[AxisMargins]:
    """Return margins of loops by axis with bandwidth and phase delay of what they hold, all loops closed."""
    own, plants = list(loops.values()), condition.plants
    frequency, count = frequencies(own, COARSE), len(plants.A)
    found = np.empty((len(own), count, 4))
    starts = np.empty(len(own))
    for begin in range(0, count, LANES):
        lanes = slice(begin, begin + LANES)
        part = [loop.part(lanes) for loop in own]
        answers = followed(motion(plants.part(lanes), frequency), part, frequency)
        for i, loop in enumerate(own):
            attitude = answers[i] if loop.held != loop.rate else answers[i] / (1j * frequency)
            starts[i] = starts[i] if begin else np.angle(attitude[0, 0])
            found[i, lanes] = attitude_figures(frequency, attitude, starts[i])
    known = [
        np.where(np.isfinite(one.margins.peak), x.T, np.nan) for one, x in zip(judged, found, strict=True)
    ]
    return [replace(one, bandwidth=x[1], phase_delay=x[3]) for one, x in zip(judged, known, strict=True)]


def require_stable(condition: Condition, judged: Sequence[AxisMargins]) -> None:
    """Refuse loops that are unstable at the estimates: they cannot have flown."""
    if not judged[0].margins.gain[0] > 1.0:
        raise StoopError(
            f"tune: {condition.place} the loops of {', '.join(one.axis for one in judged)} are unstable with these gains "
            "around this model. If they flew, model, gains or delays are not those of the flight; if not, lower them"
        )
