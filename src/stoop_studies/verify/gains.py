"""Margins and gains of vehicles that are known: each identified by the defaults from its own log, then judged and tuned.

The made-up vehicles of `defaults` fly under their pilot or autopilot in calm air and gusts and write a log of PX4. The gains that
"flew" are drawn: crossovers at a share of what the true servos or motors allow, lowered until the true loops are stable.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.variables import RATES
from stoop.errors import SimulationError, StoopError
from stoop.flight import load_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.fitted_model import FittedModel
from stoop_analysis.draws import Draws
from stoop_analysis.workflow.propagation import flown_domain
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify import defaults, pilots, study
from stoop_studies.verify.autotune import backed_off, minimum_variance
from stoop_studies.verify.made_up import KINDS, WINGED
from stoop_studies.verify.scenes import LOG_GRID
from stoop_tune.closed_loop import fly_under_law
from stoop_tune.control_laws.table import Firmware, firmwares
from stoop_tune.gain_search import SLACK, Design, Specification, propose
from stoop_tune.judgment import AxisMargins, commands_of
from stoop_tune.loops import MOTION, motion
from stoop_tune.tuning import conditions_of, tune

CASES: Final = {"wings": "aeroplanes", "rotors": "multirotors"}
#: numbers in `KINDS` of each case
OF_CASE: Final = {
    case: [i for i, kind in enumerate(KINDS) if (kind[0] in WINGED) == (case == "wings")] for case in CASES
}
FIRST: Final = 2  #: rounds of `KINDS` that are left to `defaults`
NONE: Final = Draws(("mass.mass",), np.empty((0, 1)), "covariance")  #: of a vehicle that is known
FIGURES: Final = ("gain margin", "phase margin", "delay margin", "disk margin", "crossover")
LOWERED: Final = 12  #: times that gains are lowered
STABLE: Final = 1.6  #: least gain margin of what flew, a factor
MARGINS: Final = 3  #: first of what is left of a specification; the last is noise
DRAWS: Final = 1000
#: ways to gains, and what the others than the proposal are called
WAYS: Final = {
    "proposed": "", "estimates": "at the estimates alone", "back_off": "these less 25 %",
    "minimum_variance": "PX4's minimum variance",
}  # fmt: skip
INTERVAL: Final = (0.93, 0.97)  #: coverage of 95 % intervals of margins
KEPT: Final = 0.95  #: share of the proposals that keep the specification
REJECTION: Final = 0.85  #: of that of gains by the truth
#: steps of bank and pitch, of the wind, and one that actuators cannot follow, rad and m/s, flown in the strongest of the gusts
FLIGHT: Final = """
duration = 60.0
input = [
  { control = "phi", shape = "doublet", start = 5.0, step = 5.0, amplitude = 0.35 },
  { control = "theta", shape = "doublet", start = 17.0, step = 3.0, amplitude = 0.15 },
  { control = "wind_e", shape = "pulse", start = 25.0, duration = 10.0, amplitude = 3.0 },
  { control = "wind_d", shape = "pulse", start = 37.0, duration = 5.0, amplitude = -2.0 },
  { control = "phi", shape = "pulse", start = 45.0, duration = 5.0, amplitude = 0.8 },
]
"""


def flown_gains(
    truth: Vehicle, firmware: Firmware, airspeed: float, known: Mapping[str, float], rng: np.random.Generator
) -> dict[str, float]:
    """Return parameters of PX4: crossovers below what lags allow, lowered until the true loops are stable.

    Parameters
    ----------
    known : parameters of the log, which allocate its outputs
    """
    lag = truth.value("rotors.lag") if firmware.rotors else truth.value("controls.elevator.lag")
    fastest = float(rng.uniform(0.1, 0.3)) / (lag + 0.02)
    slower = float(rng.uniform(0.2, 0.4)) * fastest
    values = {
        **known,
        **dict.fromkeys((n for a in firmware.axes for n in firmware.gains(a, known).values()), 0.0),
    }
    if firmware.rotors:
        values |= dict.fromkeys(("MC_ROLL_P", "MC_PITCH_P"), slower) | {"MC_YAW_P": 0.5 * slower}
    else:
        values |= {
            "FW_AIRSPD_TRIM": airspeed,
            "FW_AIRSPD_MAX": 2.0 * airspeed,
            "FW_AIRSPD_STALL": 0.4 * airspeed,
        }
        values |= dict.fromkeys(("FW_R_TC", "FW_P_TC"), 1.0 / slower)
    (condition,) = conditions_of(truth, firmware, values, [airspeed], pilots.ALTITUDE, NONE)
    axes = commands_of(truth, firmware, values).axes
    for i, axis in enumerate(axes):
        crossover = np.array([fastest * (0.5 if axis == "yaw" else 1.0)])
        gain = float(1.0 / np.abs(motion(condition.plants, crossover)[MOTION[axis][0]][0, i, 0]))
        drawn = {"P": 1.0, "I": rng.uniform(0.3, 1.0), "FF": 0.5}
        drawn |= {"D": rng.uniform(0.005, 0.02)} if firmware.rotors and axis != "yaw" else {}
        values |= {n: gain * drawn[term] for term, n in firmware.gains(axis, known).items() if term in drawn}
    design = Design(firmware, values, axes, [condition], Specification(), {})
    for _ in range(LOWERED):
        if min(one.margins.gain[0] for one in design.judged(values)[0]) >= STABLE:
            return values
        values |= {n: 0.7 * values[n] for axis in axes for n in firmware.gains(axis, known).values()}
    raise StoopError("no lower gains make the true loops stable")


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a vehicle, identify it by the defaults, judge gains and propose better ones; what stops the chain is recorded."""
    kinds = OF_CASE[case]
    number = (FIRST + seed // len(kinds)) * len(KINDS) + kinds[seed % len(kinds)]
    with tempfile.TemporaryDirectory(prefix="stoop-gains-") as name:
        gusts = list(defaults.GUSTS)[seed % len(defaults.GUSTS)]
        flown = defaults.fly(2 * number + seed // len(kinds) % 2, Path(name), seed, "px4", gusts)
        about = {"vehicle": number, "template": flown.vehicle.template, "gusts": flown.gusts}
        try:
            job = defaults.identified(
                load_flight(flown.path, rate=LOG_GRID), defaults.drafted_file(flown), Path(name) / "result"
            )
            return {**about, "stopped": "", **judged(flown, job, seed)}
        except StoopError as error:
            return {**about, "stopped": str(error)}


def judged(flown: defaults.Flown, job: FittedModel, seed: int) -> dict[str, Any]:
    """Return margins and gains by the model beside those by the truth."""
    rng = np.random.default_rng([47, seed])
    # an autopilot acts on what its gyros and its pitot read
    scales: dict[tuple[str, ...], float] = {
        ("sensors", n, "scale"): x for n, x in flown.defect.scale.items() if n in (*RATES, "V")
    }
    truth = with_entries(defaults.known_file(flown), scales)
    known = "MC_ROLLRATE_P" if truth.rotors else "FW_RR_P"
    (firmware,) = firmwares({known: 1.0})
    values = flown_gains(truth, firmware, flown.airspeed, job.flights[0].parameters, rng)
    found = tune(job, values, draws=DRAWS)
    speeds = [c.airspeed for c in found.design.conditions]
    real = conditions_of(
        truth,
        firmware,
        values,
        speeds,
        flown_domain(job).altitude,
        NONE,
        flown.defect.scale.get("V", 1.0),
    )
    true = replace(found.design, conditions=real)
    best, proposed, central = gains(true), gains(found.design), found.design.part(1)
    estimates = gains(central)
    ways = {
        "proposed": proposed, "estimates": estimates, "back_off": backed_off(central, estimates),
        "minimum_variance": minimum_variance(central),
    }  # fmt: skip
    return {
        "grade": job.result.verdict.grade, "against": [one.code for one in found.against],
        "intervals": intervals(found.axes, [one for at in true.judged(values) for one in at]),
        **{name: kept(true, best, own) for name, own in ways.items()},
        "lost": proposed and lost(truth, firmware, proposed, seed),
    }  # fmt: skip


def gains(design: Design) -> dict[str, float] | None:
    """Return the parameters of a design, with those that change; None where no gains keep the specification."""
    try:
        return {**design.flown, **propose(design)}
    except StoopError:
        return None


def intervals(model: Sequence[AxisMargins], truth: Sequence[AxisMargins]) -> list[list[Any]]:
    """Return axis, figure, ends of the 95 % interval by the model, and truth."""
    rows = []
    for own, real in zip(model, truth, strict=True):
        for name in FIGURES:
            drawn, value = own.values()[name][1][1:], float(real.values()[name][1][0])
            if np.isfinite(drawn).all() and math.isfinite(value):
                low, high = np.quantile(drawn, [0.025, 0.975]).tolist()
                rows.append([own.axis, name, low, high, value])
    return rows


def lost(truth: Vehicle, firmware: Firmware, values: Mapping[str, float], seed: int) -> bool:
    """Return whether the true vehicle is lost in a minute of gusts, steps and a saturation under the law with some parameters."""
    rough = defaults.gusty(truth, defaults.GUSTS["moderate"])
    try:
        fly_under_law(rough, parse_maneuver(FLIGHT, "flight"), firmware, values, seed)
    except SimulationError:
        return True
    return False


def kept(
    true: Design, best: Mapping[str, float] | None, own: Mapping[str, float] | None
) -> dict[str, Any] | None:
    """Return what the truth leaves of the specification with some parameters, and their rejection over the best."""
    if own is None:
        return None
    left = true.left(own)[0]
    ratios = rejections(true, own, best) if best else []
    return {"left": float(left[..., :MARGINS].min()), "ratios": ratios}


def rejections(true: Design, own: Mapping[str, float], best: Mapping[str, float]) -> list[float]:
    """Return by axis the rejection with gains over that with others, at the worst airspeed, where the others have one."""
    a, b = (
        np.array([[one.margins.rejection[0] for one in at] for at in true.judged(values)])
        for values in (own, best)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = a / b
    return [float(x) for x in ratios.min(axis=0) if np.isfinite(x)]


def figures(case: str, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of a case; kept and missed specifications are those of models that nothing speaks against."""
    done = [r for r in records if not r["stopped"]]
    rows = [row for r in done for row in r["intervals"]]
    trusted = [r for r in done if not r["against"]]
    out: dict[str, Any] = {
        "case": case, "vehicles": len(records), "stopped": len(records) - len(done),
        "spoken_against": len(done) - len(trusted), "intervals": len(rows),
        "coverage": float(np.mean([low <= x <= high for *_, low, high, x in rows])) if rows else None,
        "wide": float(np.mean([low * 0.98 <= x <= high * 1.02 for *_, low, high, x in rows])) if rows else None,
    }  # fmt: skip
    flown = [r["lost"] for r in done if r["lost"] is not None]
    out |= {"flown": len(flown), "lost": sum(flown)}
    for name in WAYS:
        made = [r[name] for r in trusted if r[name] is not None]
        ratios = [x for one in made for x in one["ratios"]]
        out |= {
            name: len(made), f"{name}_kept": sum(one["left"] >= -SLACK for one in made),
            f"{name}_worst": min((one["left"] for one in made), default=None),
            f"{name}_rejection": float(np.median(ratios)) if ratios else None,
        }  # fmt: skip
    return out


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return whether margins and gains by the model are those of the truth."""
    table = [figures(case, samples[case]) for case in CASES]
    claims = []
    for row in table:
        words, made = CASES[row["case"]], row["proposed"]
        claims += [
            study.within(
                f"{words}: 95 % intervals of the margins of the flown gains hold the truth in", INTERVAL,
                row["coverage"] or 0.0, f"of {row['intervals']}",
            ),
            holds(
                f"{words}: the true margins of proposed gains keep the specification in {100 * KEPT:.0f} %",
                made > 0 and row["proposed_kept"] >= KEPT * made,
                f"{row['proposed_kept']} of {made}; "
                + ", ".join(f"{words} {row[f'{n}_kept']} of {row[n]}" for n, words in WAYS.items() if words),
            ),
            holds(
                f"{words}: their rejection is at least {REJECTION:g} of that of gains by the truth, in the median",
                (row["proposed_rejection"] or 0.0) >= REJECTION, f"{row['proposed_rejection'] or 0.0:.2f}",
            ),
            holds(
                f"{words}: none is lost in a minute of moderate gusts, steps and a saturation under the proposed gains",
                row["flown"] > 0 and row["lost"] == 0, f"{row['lost']} of {row['flown']}",
            ),
        ]  # fmt: skip
    each = [
        {
            "case": case, **{n: r[n] for n in ("vehicle", "template", "gusts", "stopped")},
            "lost": r.get("lost"), "grade": r.get("grade", ""), "against": " ".join(r.get("against", [])),
            **{n: (r.get(n) or {}).get("left") for n in WAYS},
        }
        for case in CASES
        for r in samples[case]
    ]  # fmt: skip
    return Findings.of("Margins and gains of known vehicles", claims, table, {"vehicles": each})


EXPERIMENT: Final = study.Verification(
    "gains", show, runs=100, work="examine", cases=tuple(CASES), parts=("vehicles",)
)
