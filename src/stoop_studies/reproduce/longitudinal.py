"""All 14 longitudinal terms of eq. (1), and the paper's claim that the V terms catch the propulsion.

For the claim, an aircraft whose thrust falls with airspeed is flown, and models with and without that are fitted.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.schema import ConstantThrust, Propeller
from stoop.workflow.demo import MANEUVER, TABLE_1
from stoop_studies.findings import Claim, Findings, Results, Setting, number, reproduces
from stoop_studies.problems.paper import Paper, box, paper
from stoop_studies.reproduce.recovery import Fits, ModelFits, ModelStudy, Recovery, fitted

WORK: Final = "stoop_studies.reproduce.longitudinal:work"
TERMS: Final = ("CLV", "CDV", "CmV")
ZERO, FREE, KNOWN = "V terms zero", "V terms free", "propeller known"
#: whether V terms are free, whether the model has the propeller
MODELS: Final = {ZERO: (False, False), FREE: (True, False), KNOWN: (False, True)}
#: ours: about constant power, so that thrust falls by 6.3 N for each m/s, as thrust over airspeed does
PROPELLER: Final = {
    "kind": "propeller", "channel": "throttle", "speed_gain": 100.0, "diameter": 0.66, "CT0": 0.1937, "CT1": -0.1827,
}  # fmt: skip


@functools.cache
def truth() -> Paper:
    """Return the aircraft with the propeller, all V terms zero, and its flight."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    file = vehicle.file.model_copy(update={"propulsion": Propeller.model_validate(PROPELLER)})
    vehicle = replace(vehicle, file=file)
    return Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "propulsion")))


@functools.cache
def model(free: bool, propeller: bool) -> Paper:
    """Return what is fitted to the truth's flight.

    `free`: whether the V terms are searched with the ten coefficients. `propeller`: whether the thrust falls as it truly
    does; otherwise it stays at its trimmed value.
    """
    case, names = truth(), (*TABLE_1, *TERMS) if free else TABLE_1
    if propeller:
        return replace(case, names=names)
    propulsion = ConstantThrust.model_validate({"kind": "constant", "thrust": thrust(35.0)})
    vehicle = replace(case.vehicle, file=case.vehicle.file.model_copy(update={"propulsion": propulsion}))
    elevator = case.vehicle.inputs.index("elevator")  # the only input of this model
    return Paper(vehicle, replace(case.flown, inputs=case.flown.inputs[:, [elevator]]), names)


def thrust(airspeed: float) -> float:
    """Return the propeller's thrust at the trimmed throttle, N."""
    case = truth()
    value = case.vehicle.value
    speed = value("propulsion.speed_gain") * case.flown.trim.thrust["throttle"]
    diameter, density = value("propulsion.diameter"), value("environment.density")
    form = value("propulsion.CT0") * speed**2 + value("propulsion.CT1") * speed * airspeed / diameter
    return density * diameter**4 * form


def expected() -> dict[str, float]:
    """Return what the V terms should take up, to first order in the change of airspeed.

    A thrust T + T' (V - V*) along the body's x axis has the drag -T' (V - V*) cos(alpha) and the lift
    T' (V - V*) sin(alpha); over qbar S (V - V*) / V* these are CDV and CLV. Its line passes the center of gravity.
    """
    case = truth()
    value, alpha = case.vehicle.value, case.flown.trim.start["alpha"]
    airspeed = value("reference.airspeed")
    slope = (thrust(airspeed + 0.5) - thrust(airspeed - 0.5)) / 1.0
    pressure = 0.5 * value("environment.density") * airspeed**2
    unit = slope * airspeed / (pressure * value("reference.area"))
    return {"CLV": unit * float(np.sin(alpha)), "CDV": -unit * float(np.cos(alpha)), "CmV": 0.0}


def work(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Fit one model to one flight, with the default optimizer to its end; one result per stop, of which each is None.

    Arguments are ``model``: of `MODELS`; ``seed``: of box, noise and search; ``noise``: whether there is any.
    """
    case, seed = model(*MODELS[str(arguments["model"])]), int(arguments["seed"])
    measured = truth().measured(seed, bool(arguments["noise"]))
    return [fitted(case.misfit(case.bounded(*bounds(case.names, seed)), measured), seed)] * len(stops)


def bounds(names: Sequence[str], seed: int) -> tuple[FloatArray, FloatArray]:
    """Return box W of the ten coefficients, and boxes of width one about zero for the V terms.

    A model that lacks something puts coefficients far off; bounds that it meets would hide how far.
    """
    low, high = box("W", seed, paper().truth)
    middles = np.random.default_rng(20_000 + seed).uniform(-0.3, 0.3, len(TERMS))
    extra = len(names) - len(TABLE_1)
    return np.append(low, (middles - 0.5)[:extra]), np.append(high, (middles + 0.5)[:extra])


def relative_errors(values: Mapping[str, float]) -> FloatArray:
    """Return the relative errors (10,) of the coefficients of Table 1."""
    return np.array([values[n] for n in TABLE_1]) / paper().truth - 1.0


class LongitudinalFull(ModelStudy):
    """The longitudinal terms of eq. (1)."""

    name, runs, parts = "longitudinal-full", 20, ("propulsion",)

    def fits(self, setting: Setting) -> dict[tuple[str, bool], ModelFits]:
        """Return of each model one fit without noise, and one per seed with it."""
        return {
            ("propulsion", noise): ModelFits(WORK, "propulsion", tuple(MODELS), noise, seeds)
            for noise, seeds in ((False, range(setting.seed, setting.seed + 1)), (True, setting.seeds))
        }

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = Recovery.of(self.name, setting, results)
        (clean,), noisy = (searches.fits(results) for searches in self.fits(setting).values())
        names = ("model", "noise", "seed", "cost", "largest_error", *TABLE_1, *TERMS)
        records: list[dict[str, Cell]] = [dict.fromkeys(names) | {"model": "first order"} | expected()]
        for m in MODELS:
            records.append(_record(m, False, setting.seed, clean))
            records += [_record(m, True, s, fit) for s, fit in zip(setting.seeds, noisy, strict=True)]
        title = f"Eq. (1): all 14 longitudinal terms, box {setting.box}"
        claims = (*found.claims, *_claims(clean))
        return Findings.of(
            title, claims, found.records(setting.seeds), {"propulsion": records}, found.summary
        )


def _record(model: str, noise: bool, seed: int, fit: Fits) -> dict[str, Cell]:
    """Return the row of one fit; nothing stands for what is not free."""
    values, cost = fit.values[model], fit.costs[model]
    largest = float(np.abs(relative_errors(values)).max())
    row: dict[str, Cell] = {"model": model, "noise": noise, "seed": seed, "cost": cost}
    row["largest_error"] = largest
    return row | {n: values.get(n) for n in (*TABLE_1, *TERMS)}


def _claims(clean: Fits) -> list[Claim]:
    free, wanted = clean.values[FREE], expected()
    share = 1.0 - clean.costs[FREE] / clean.costs[ZERO]
    before, after = (float(np.abs(relative_errors(clean.values[m])).max()) for m in (ZERO, FREE))
    return [
        reproduces(
            "The V terms catch the propulsion's dependence on airspeed",
            share > 0.9,
            f"they take up {100 * share:.1f} % of the misfit, J falls from {number(clean.costs[ZERO], 4)} to "
            f"{number(clean.costs[FREE])}",
        ),
        reproduces(
            "What they catch is the thrust slope, within 10 % of its first-order value",
            abs(free["CDV"] / wanted["CDV"] - 1.0) < 0.1,
            f"CDV {free['CDV']:.4f}, expected {wanted['CDV']:.4f}; CLV {free['CLV']:.4f}, expected {wanted['CLV']:.4f}",
        ),
        reproduces(
            "They keep the propulsion out of the other coefficients",
            after < 0.2 * before,
            f"largest of ten errors {100 * after:.1f} % with them, {100 * before:.0f} % without",
        ),
    ]
