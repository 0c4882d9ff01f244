"""All 14 longitudinal terms of eq. (1), and the paper's claim that the V terms catch the propulsion.

For the claim, an aircraft whose thrust falls with airspeed is flown, and models with and without that are fitted.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Run
from stoop.report.sheet import Prose, Section, Table
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.schema import ConstantThrust, Propeller
from stoop.workflow.demo import MANEUVER, TABLE_1
from stoop_studies.findings import Claim, Findings, Results, Setting, number, reproduces
from stoop_studies.problems.paper import SAMPLES, Paper, box, paper
from stoop_studies.reproduce.noise import RECOVERY_HEAD, Recovery
from stoop_studies.reproduce.suite import PaperExperiment, by_columns, fitted, minus, rms, tabulated

WORK: Final = "stoop_studies.reproduce.longitudinal:work"
TERMS: Final = ("CLV", "CDV", "CmV")
ZERO, FREE, KNOWN = "V terms zero", "V terms free", "propeller known"
#: whether V terms are free, whether the model has the propeller
MODELS: Final = {ZERO: (False, False), FREE: (True, False), KNOWN: (False, True)}
#: ours: about constant power, so that thrust falls by 6.3 N for each m/s, as thrust over airspeed does
PROPELLER: Final = {
    "kind": "propeller", "channel": "throttle", "speed_gain": 100.0, "diameter": 0.66, "CT0": 0.1937, "CT1": -0.1827,
}  # fmt: skip
FITS_HEAD: Final = ("model", "noise", "seed", "cost", "largest_error", *TABLE_1, *TERMS)
LEAD: Final = """\
The paper's model has 14 longitudinal terms, its experiment identifies ten. Here all 14 are found from the same \
maneuver, the four others at values of our own that are not zero. Then the paper's reason for the V terms is tried: \
that they catch the influence of the propulsion."""
WORDS: Final = """\
The truth flies with a propeller whose thrust falls with airspeed, as at constant power; all its V terms are zero. \
Three models are fitted to that flight: one with constant thrust and no V terms, one with constant thrust and free \
V terms, and one that knows the propeller. To first order a thrust slope T' looks like CDV = -T' V* cos(alpha) / \
(qbar S) and CLV = T' V* sin(alpha) / (qbar S); what is left after that is of second order. The ten coefficients are sought in \
box W: in box N the wrong model meets a bound."""


@functools.cache
def truth() -> Paper:
    """Return the aircraft with the propeller, all V terms zero, and its flight."""
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
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


def _key(name: str, noise: bool, seed: int) -> str:
    return f"propulsion/{name}/{'noise' if noise else 'clean'}/{seed:06d}"


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of one model."""

    clean: Mapping[str, float]  #: estimates without noise
    cost: float  #: J without noise: what the model cannot explain
    noisy: Mapping[str, FloatArray]  #: name -> (n,) estimates with noise
    costs: FloatArray  #: (n,): J with noise

    @classmethod
    def of(cls, name: str, setting: Setting, results: Results) -> Fits:
        """Return the fits of a model."""
        clean = results[_key(name, False, setting.seed)]
        seeds = [results[_key(name, True, s)] for s in setting.seeds]
        noisy = {n: np.array([r["values"][n] for r in seeds]) for n in clean["values"]}
        return cls(clean["values"], clean["cost"], noisy, np.array([r["cost"] for r in seeds]))

    @property
    def errors(self) -> FloatArray:
        """Relative errors (10,) without noise."""
        return np.array([self.clean[n] for n in TABLE_1]) / paper().truth - 1.0


class LongitudinalFull(PaperExperiment):
    """The longitudinal terms of eq. (1)."""

    name, runs, parts = "longitudinal-full", 20, ("propulsion",)

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs of the recovery; of each model one fit without noise, and one per seed with it."""
        clean = [(name, False, setting.seed) for name in MODELS]
        noisy = [(name, True, seed) for name in MODELS for seed in setting.seeds]
        return Recovery.searches(self.name, setting) + [
            Run(_key(m, noise, seed), WORK, {"model": m, "noise": noise, "seed": seed})
            for m, noise, seed in clean + noisy
        ]

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = Recovery.of(self.name, setting, results)
        fits = {name: Fits.of(name, setting, results) for name in MODELS}
        return Findings(
            f"Eq. (1): all 14 longitudinal terms, box {setting.box}",
            LEAD,
            (*found.claims, *_claims(fits)),
            (
                Section("Fourteen values from one maneuver", (found.table,)),
                Section("V terms and the propulsion", (Prose(WORDS), *_tables(fits))),
            ),
            RECOVERY_HEAD,
            found.rows(setting.seeds),
            {"propulsion": (FITS_HEAD, tuple(_rows(fits, setting)))},
        )


def _claims(fits: Mapping[str, Fits]) -> list[Claim]:
    zero, free, wanted = fits[ZERO], fits[FREE], expected()
    share = 1.0 - free.cost / zero.cost
    before, after = float(np.abs(zero.errors).max()), float(np.abs(free.errors).max())
    return [
        reproduces(
            "The V terms catch the propulsion's dependence on airspeed",
            share > 0.9,
            f"they take up {100 * share:.1f} % of the misfit, J falls from {number(zero.cost, 4)} to {number(free.cost)}",
        ),
        reproduces(
            "What they catch is the thrust slope, within 10 % of its first-order value",
            abs(free.clean["CDV"] / wanted["CDV"] - 1.0) < 0.1,
            f"CDV {free.clean['CDV']:.4f}, expected {wanted['CDV']:.4f}; "
            f"CLV {free.clean['CLV']:.4f}, expected {wanted['CLV']:.4f}",
        ),
        reproduces(
            "They keep the propulsion out of the other coefficients",
            after < 0.2 * before,
            f"largest of ten errors {100 * after:.1f} % with them, {100 * before:.0f} % without",
        ),
    ]


def _tables(fits: Mapping[str, Fits]) -> tuple[Table, ...]:
    """Return misfit, V terms, and errors of the ten coefficients."""
    count = 6 * SAMPLES
    free, wanted = fits[FREE], expected()
    noisy = {n: (v.mean(), v.std(ddof=min(1, len(v) - 1))) for n, v in free.noisy.items()}
    columns: dict[str, Sequence[str]] = {"parameter": TABLE_1}
    true = np.array([fits[KNOWN].clean[n] for n in TABLE_1])
    for name, fit in fits.items():
        scatter = rms((np.array([fit.noisy[n] for n in TABLE_1]) / true[:, None] - 1.0).T)
        columns[name] = [minus(f"{100.0 * v:+.2f} %") for v in fit.errors]
        columns[f"{name}, with noise"] = [f"{100.0 * v:.2f} %" for v in scatter]
    return (
        tabulated(
            f"What the models leave unexplained; {count} readings, so that noise alone costs about as much",
            {
                "model": lambda m: m,
                "J without noise": lambda m: number(fits[m].cost),
                "mean J with noise": lambda m: number(float(fits[m].costs.mean()), 5),
                "per reading": lambda m: f"{fits[m].costs.mean() / count:.3f}",
            },
            fits,
        ),
        tabulated(
            minus(
                f"What the V terms take up of a thrust slope of {thrust(35.5) - thrust(34.5):.2f} N per m/s"
            ),
            {
                "term": lambda n: n,
                "expected": lambda n: minus(f"{wanted[n]:.4f}"),
                "without noise": lambda n: minus(f"{free.clean[n]:.4f}"),
                "with noise, mean and scatter": lambda n: minus(f"{noisy[n][0]:.4f} ± {noisy[n][1]:.4f}"),
            },
            TERMS,
        ),
        by_columns("Errors of the ten coefficients; with noise the root mean square over seeds", columns),
    )


def _rows(fits: Mapping[str, Fits], setting: Setting) -> Iterator[tuple[Cell, ...]]:
    """Give what is expected to first order, then one row per fit; nothing stands for what is not free."""

    def cells(values: Mapping[str, float]) -> tuple[Cell, ...]:
        """Return the largest relative error of the ten, and all estimates."""
        off = np.array([values[n] for n in TABLE_1]) / paper().truth - 1.0
        estimates = (float(values[n]) if n in values else None for n in (*TABLE_1, *TERMS))
        return (float(np.abs(off).max()), *estimates)

    yield ("first order", *[None] * (4 + len(TABLE_1)), *(expected()[n] for n in TERMS))
    for name, fit in fits.items():
        yield (name, False, setting.seed, fit.cost, *cells(fit.clean))
        for i, (seed, cost) in enumerate(zip(setting.seeds, fit.costs, strict=True)):
            yield (name, True, seed, float(cost), *cells({n: v[i] for n, v in fit.noisy.items()}))
