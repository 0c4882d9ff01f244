r"""The closed rate loops that a log shows, from setpoint to rate, beside those of a model under the same law.

The setpoints of all axes are inputs that move together: each response is that of one rate loop, the others closed. An attitude
loop of gain k makes the setpoints answer gusts too. What the pilot asks, :math:`E = R + k Y / (j\omega)` of setpoint R and rate
Y, is not moved by gusts; as an instrument [1]_ it gives the response

.. math:: T = H \frac{1 + \kappa / \gamma^2}{1 + \kappa}, \qquad \kappa = \overline{k H / (j\omega)}

from the estimate H and its coherence. T - H counts as an error of H. Where :math:`1 + \kappa` is small, gusts alone made the
setpoints, H is the inverse of the feedback, and nothing is known.

References
----------
.. [1] T. Soderstrom and P. Stoica, System Identification, Prentice Hall, 1989, chapters 8 and 10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop import Flight, Notice, load_flight
from stoop.extend import flights
from stoop.extend.arrays import ComplexArray, FloatArray, run_slices
from stoop.extend.errors import StoopError
from stoop.extend.fits import NORMAL_95
from stoop.extend.notices import notice
from stoop.extend.recordings import read
from stoop_analysis.frequency import FrequencyAnalysis, ModelResponse, known
from stoop_analysis.handling import DB, DEG, error_correlation
from stoop_tune.control_laws.rate_law import AXES
from stoop_tune.judgment import Condition
from stoop_tune.loops import AxisLoop, followed, motion

#: of the rate at which a setpoint was logged: up to there a spline through it is right to 2 %
RESOLVED: Final = 0.25
#: least distance of the attitude loop from -1, below which gusts alone make the setpoints
STEADY: Final = 0.5
DRAWS: Final = 400  #: of the model at each airspeed, for its band
FULL: Final = 0.999  #: of the limit, from where on a command is at it
SATURATED: Final = 0.01  #: share of the samples with a full command, from which on a loop was not linear
LEVEL: Final = 0.999  #: of the test that two responses differ
INSIDE: Final = 0.95  #: of a band
NOTHING: Final = "it holds no setpoints of the rates beside the rates, or too few in flight"

Columns = tuple[str, ...]  #: stream, and columns of it that are added


@dataclass(frozen=True)
class Recorded:
    """Where a log holds the setpoint of a rate, the rate behind the gyro's filters in the same unit, and the command."""

    columns: tuple[Columns, Columns, Columns]
    full: float = 1.0  #: command
    rotors: tuple[bool, ...] = (True, False)  #: a copter's PID messages hold the setpoint behind its filter


def _recorded(axis: str, i: int, x: str) -> tuple[Recorded, ...]:
    px4 = ("vehicle_rates_setpoint", axis), ("vehicle_angular_velocity", f"xyz[{i}]")
    pid, main = f"PID{x}", "main"
    return (
        Recorded((*px4, ("vehicle_torque_setpoint", f"xyz[{i}]"))),
        Recorded((*px4, ("actuator_controls_0", f"control[{i}]"))),
        Recorded((("RATE", f"{x}Des"), ("RATE", x), ("RATE", f"{x}Out")), rotors=(True,)),
        Recorded(((pid, "Tar"), (pid, "Act"), (pid, "P", "I", "D", "FF")), 45.0, rotors=(False,)),
        Recorded(((main, f"setpoint[{i}]"), (main, f"gyroADC[{i}]"), (main, f"axisSum[{i}]")), 1000.0),
    )


RECORDED: Final = {axis: _recorded(axis, i, "RPY"[i]) for i, axis in enumerate(AXES)}
STREAMS: Final = frozenset(x[0] for own in RECORDED.values() for one in own for x in one.columns)


@dataclass(frozen=True, eq=False)
class Signals:
    """Setpoint, rate and command, a share of a full one, about an axis (n, 3), on the grid of a flight; NaN where unknown."""

    values: FloatArray
    slowest: float  #: Hz, of the clocks of setpoint and rate
    together: bool  #: whether these are one


def recorded_signals(path: Path, flight: Flight, rotors: bool) -> dict[str, Signals]:
    """Return the signals of the rate loops in flight by axis, of those whose setpoint moves."""
    streams, up = read(path, topics=STREAMS).streams, flight.in_flight()

    def column(stream: str, *names: str) -> FloatArray:
        total = np.sum([streams[stream].columns[n] for n in names], axis=0)
        good = np.isfinite(total)
        return np.where(up, flight.resampled(streams[stream].time[good], total[good]), np.nan)

    found = {}
    for axis, forms in RECORDED.items():
        own = next((f for f in forms if rotors in f.rotors and all(x[0] in streams for x in f.columns)), None)
        if own is None or not all(set(x[1:]) <= set(streams[x[0]].columns) for x in own.columns):
            continue
        values = np.column_stack([column(*x) for x in own.columns]) / np.array([1.0, 1.0, own.full])
        (asked, *_), (turning, *_), _ = own.columns
        if flights.moves(values[:, 0]):
            slowest = 1.0 / max(streams[asked].period, streams[turning].period)
            found[axis] = Signals(values, slowest, asked == turning)
    return found


def closed_loops(
    path: Path, rotors: bool, conditions: Sequence[Condition], loops: Sequence[Mapping[str, AxisLoop]]
) -> tuple[FrequencyAnalysis | None, list[Notice]]:
    """Return the responses of rates to their setpoints by a log, beside those of models; and where they disagree.

    Parameters
    ----------
    conditions : the band is that of all models at all of them
    loops : by axis, at each condition
    """
    try:
        flight = load_flight(path)
        signals = recorded_signals(path, flight, rotors)
    except StoopError as error:
        return None, [notice("tune-no-closed-loop", path.name, reason=str(error))]
    setpoints, rates = (np.array([one.values[:, k] for one in signals.values()]).T for k in (0, 1))
    slowest = min((one.slowest for one in signals.values()), default=np.nan)
    band = 0.0, 2.0 * np.pi * min(flights.FrequencyResponse.MAX_FREQUENCY, RESOLVED * slowest)
    stretches = [flights.Stretch(flight.rate, setpoints, rates)] if signals else []
    found, modeled, notices = [], {}, []
    for one in flights.FrequencyResponse.estimate(stretches, list(signals), list(signals), band):
        if one.input != one.output or one.input not in loops[0]:
            continue
        loop, own = loops[0][one.input], signals[one.input]
        flown = replace(under_feedback(one, loop.back(one.frequency)), output=loop.rate)
        if not own.together:  # the clocks may differ by a sample of the loop, and what is faster folds
            folded = (1.0 / flown.coherence - 1.0, flown.frequency / loop.law.rate)
            flown = replace(flown, bound=np.sqrt(flown.bound**2 + np.square(folded).sum(axis=0)))
        command = own.values[np.isfinite(own.values[:, 2]), 2]
        full = float(np.sum(np.abs(command) >= FULL * loop.law.limit)) / max(command.size, 1)
        model = modeled[flown.input, flown.output] = modeled_loop(flown, conditions, loops)
        notices += disagreement(flown, model, full)
        found.append(flown)
    if not found:
        return None, [notice("tune-no-closed-loop", path.name, reason=NOTHING)]
    pieces = run_slices(np.isfinite(np.sum(setpoints + rates, axis=1)))
    windows = tuple(flights.Window(flight.name, *flight.time[[x.start, x.stop - 1]].tolist()) for x in pieces)
    names, of = ((flight.name,), windows), (tuple(r.input for r in found), tuple(r.output for r in found))
    return FrequencyAnalysis(*names, *of, tuple(found), modeled, (), {}, tuple(notices)), notices


def under_feedback(one: flights.FrequencyResponse, gain: ComplexArray | float) -> flights.FrequencyResponse:
    """Return the response of a rate to its setpoint with the error that gusts bring by an attitude loop of a gain (m,), 1/s.

    Of the instrument that is the random error beside that of regression, by the spectra of what is left of the rate, and of
    what the pilot asks; and the distance between both estimates.
    """
    H, back = one.response, gain * one.response / (1j * one.frequency)
    with np.errstate(divide="ignore", invalid="ignore"):
        power = 1.0 / one.coherence
        T = H * (1.0 + np.conj(back) * power) / (1.0 + np.conj(back))
        left = np.abs(H) ** 2 * power - 2.0 * (T.conj() * H).real + np.abs(T) ** 2
        asked = 1.0 + 2.0 * back.real + np.abs(back) ** 2 * power
        more = np.sqrt(left * asked / (power - 1.0)) / np.abs(H * (1.0 + np.conj(back)))
        bound = np.hypot(one.bound * more, NORMAL_95 * np.abs(T / H - 1.0))
    bound = np.where(np.isfinite(bound), bound, one.bound)
    return replace(one, bound=np.where(np.abs(1.0 + back) > STEADY, bound, np.inf))


def modeled_loop(
    flown: flights.FrequencyResponse, conditions: Sequence[Condition], loops: Sequence[Mapping[str, AxisLoop]]
) -> ModelResponse:
    """Return the response of the logged rate to its setpoint by the models of all conditions, the estimate at the middle one."""
    w, found = flown.frequency, []
    for condition, own in zip(conditions, loops, strict=True):
        lanes = slice(0, DRAWS + 1)
        inner = [replace(loop.part(lanes), attitude=0.0) for loop in own.values()]
        i, moved = list(own).index(flown.input), motion(condition.plants.part(lanes), w)
        found.append(followed(moved, inner, w)[i] * inner[i].gyro(w))
    draws = np.concatenate([one[1:] for one in found])
    return ModelResponse(flown.input, flown.output, w, found[len(found) // 2][0], draws)


def disagreement(flown: flights.FrequencyResponse, model: ModelResponse, full: float) -> list[Notice]:
    """Return whether a flown response differs from a model's by more than both errors, and which is not to be trusted.

    Log magnitudes and phases over their errors are squared and summed over the frequencies at which the flown response is
    known; errors at neighboring frequencies are correlated (Satterthwaite).

    Parameters
    ----------
    full : share of the samples with a full command
    """
    good = known(flown)
    w, m = flown.frequency[good], int(good.sum())
    if not m:
        return [notice("tune-loop-unknown", axis=flown.input)]
    logs = (np.log(x[..., good] / model.response[good]) for x in (flown.response, model.draws))
    apart, moved = (np.concatenate([one.real, one.imag], axis=-1) for one in logs)
    random = flown.bound[good] / NORMAL_95
    covariance = moved.T @ moved / max(len(moved), 1)
    covariance += np.kron(np.eye(2), np.outer(random, random) * error_correlation(w, flown.window[good]))
    size = np.sqrt(np.diag(covariance))
    freedom = (2 * m) ** 2 / float(np.sum((covariance / np.outer(size, size)) ** 2))
    square = np.sum((apart / size).reshape(2, m) ** 2, axis=0)
    if 0.5 * float(np.mean(square)) <= chi2.ppf(LEVEL, freedom) / freedom:
        return []
    at = int(np.argmax(square))
    far = w[square >= min(chi2.ppf(INSIDE, 2), square[at])]
    return [
        notice(
            "tune-loop-saturated" if full > SATURATED else "tune-loop-contradicted",
            axis=flown.input, low=float(far[0]), high=float(far[-1]), frequency=float(w[at]), level=float(DB * apart[at]),
            phase=float(DEG * apart[m + at]), coherence=float(flown.coherence[good][at]), share=full,
        )
    ]  # fmt: skip
