"""Coverage of propagated intervals over fitted flights and known covariances; marks of priors; and a naive twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.simulation import linearize, trim
from stoop.simulation.linearize import modes_of
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import fit as fit_model
from stoop_analysis.draws import Draws, from_covariance, truncated_normal
from stoop_analysis.propagation.propagation import propagate_draws
from stoop_analysis.propagation.quantities import ON_PRIOR
from stoop_analysis.propagation.rotor_figures import rotor_figures
from stoop_analysis.propagation.wing_figures import Domain, wing_figures
from stoop_analysis.propagation.wings import level_flight, linear_flights, steady_flights
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import scenes, study

DRAWS: Final = 500  #: of each interval
REPEATS: Final = 2  #: estimates from a known covariance, a seed
SPREAD: Final = 0.08  #: standard error of a number of a known covariance, over its value
LEAST_SPREAD: Final = 0.002  #: of one that is zero
CORRELATION: Final = 0.4  #: between neighbors
POOLED: Final = (0.93, 0.97)
MAX_DIFFERENCE: Final = 1e-6  #: relative, from the naive twin
TWINS: Final = 4  #: draws, a seed
STILL: Final = ("rudder", "aileron")  #: the control that never moves, in turn
SINGLES: Final = 150  #: draws that are trimmed one at a time, twice
RIGHTLY: Final = 0.95  #: share of the figures that are marked as by single trims
WING: Final = Domain((32.0, 38.0), 35.0, 200.0, 1.20165, (0.0, 0.2))
ROTOR: Final = Domain((0.0, 8.0), 0.0, 200.0, 1.20165)
ROTOR_NUMBERS: Final = ("mass.mass", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "rotors.T1", "rotors.T2",
                        "rotors.lag", "rotors.drag", "rotors.torque_ratio")  # fmt: skip
NAMES: Final[Mapping[str, str]] = {
    "fits": "fitted flights of the aircraft",
    "known": "known covariance, aircraft",
    "rotors": "known covariance, quadrotor",
}


def carried(vehicle: Vehicle, truth: Vehicle, draws: Draws, domain: Domain) -> dict[str, list[bool]]:
    """Return which intervals of the estimates hold the truth, by figure; of a curve those at every airspeed."""
    found = propagate_draws(vehicle, draws, domain)
    study_of = rotor_figures if vehicle.rotors else wing_figures
    true = study_of(truth, np.repeat(truth.parameter_rows(), 2, axis=1), domain)
    values = {one.name: one.estimate for _, one in true.figures}
    out = {
        f.name: [bool(f.ci95_lower <= values[f.name] <= f.ci95_upper)]
        for f in found.figures
        if np.isfinite(values.get(f.name, np.nan)) and np.isfinite(f.ci95_upper) and f.std_error > 0.0
    }
    curves = {one.name: one.estimate for one in true.curves}
    for one in found.curves:
        inside = (one.bands[0] <= curves[one.name]) & (curves[one.name] <= one.bands[-1])
        varies = one.bands[-1] > one.bands[0]
        if (there := np.isfinite(curves[one.name]) & varies).any():
            out[f"{one.name} over the airspeed"] = inside[there].tolist()
    return out


def known_covariance(vehicle: Vehicle, names: Sequence[str]) -> FloatArray:
    """Return a covariance (k, k) of numbers of a vehicle."""
    values = np.array([vehicle.value(n) for n in names])
    sigma = np.maximum(SPREAD * np.abs(values), LEAST_SPREAD)
    place = np.arange(len(names))
    return np.asarray(np.outer(sigma, sigma) * CORRELATION ** np.abs(place[:, None] - place))


def drawn(truth: Vehicle, names: Sequence[str], rng: np.random.Generator) -> tuple[Vehicle, Draws]:
    """Return a vehicle at estimates about the truth, and draws about them."""
    covariance, endless = known_covariance(truth, names), np.full(len(names), np.inf)
    center = np.array([truth.value(n) for n in names])
    estimate = rng.multivariate_normal(center, covariance)
    values = truncated_normal(estimate, covariance, -endless, endless, DRAWS, rng)
    numbers = {n: {"value": float(v)} for n, v in zip(names, estimate, strict=True)}
    return truth.with_numbers(numbers), Draws(tuple(names), values, "covariance")


def fitted(seed: int) -> tuple[Vehicle, Vehicle, Draws]:
    """Return the estimates of a flight, its truth, and draws from the covariance of the fit."""
    scene = scenes.in_white_noise(seed)
    options = Options(seed=seed, method="output-error")
    fit = methods.find("output-error").fitter()(
        scene.start, scene.flights, scene.windows, options, None, None
    )
    bars, names = ErrorBars.of(fit), tuple(scene.truth)
    k = len(names)
    estimates = np.array([fit.estimates[n] for n in names])
    own = {p.name: p for p in fit.problem.layout.parameters}
    low, high = (np.array([getattr(own[n], end) for n in names]) for end in ("lower", "upper"))
    rng = np.random.default_rng(seed)
    values = truncated_normal(estimates, bars.covariance[:k, :k], low, high, DRAWS, rng)
    truth = scenes.aircraft()
    numbers = {n: {"value": float(v)} for n, v in zip(names, estimates, strict=True)}
    return truth.with_numbers(numbers), truth, Draws(names, values, "covariance")


def twin(seed: int) -> float:
    """Return the largest relative difference from single trims and linear models, over angles, controls and eigenvalues."""
    truth, rng = scenes.aircraft(), np.random.default_rng(seed)
    vehicle, draws = drawn(truth, tuple(scenes.coefficients(truth)), rng)
    some = draws.values[:TWINS]
    rows = vehicle.parameter_rows(dict(zip(draws.names, some.T, strict=True)), TWINS)
    flight = level_flight(vehicle, rows, WING.altitude, WING.density)
    at = steady_flights(flight, {"V": np.full(TWINS, WING.reference)})
    linear, worst = linear_flights(flight, at), 0.0
    for i, one in enumerate(some):
        numbers = {n: {"value": float(v)} for n, v in zip(draws.names, one, strict=True)}
        single = vehicle.with_numbers(numbers)
        point = trim(single, WING.reference, WING.altitude, 0.0, WING.density)
        pairs = [(point.start[n], float(at.start[n][i])) for n in ("alpha", "theta", "phi")]
        pairs += [(v, float(at.deflections[c][i])) for c, v in point.deflections.items()]
        theirs = linearize(single, point)
        modes = zip(theirs.modes, modes_of(linear.A[i], linear.names), strict=True)
        pairs += [(a.frequency, b.frequency) for a, b in modes]
        worst = max(worst, *(abs(a - b) / max(abs(a), 1e-3) for a, b in pairs))
    return worst


def marks(seed: int) -> list[dict[str, Any]]:
    """Return the figures of a fit in which one control never moves, with their share of priors by draws and by single trims."""
    scene = scenes.in_white_noise(seed, still=STILL[seed % len(STILL)])
    model = fit_model(
        scene.start, list(scene.flights.values()), scene.windows, seed=seed,
        method="output-error", strategy="textbook",
    )  # fmt: skip
    found = propagate_draws(model.vehicle, from_covariance(model.result, DRAWS, seed), WING)
    own = {f.name: f for f in found.figures}
    single = single_shares(model, seed + 1)
    return [
        {"figure": n, "marked": own[n].rests_on_prior, "share": own[n].prior_share, "single": s}
        for n, s in single.items()
        if n in own and own[n].std_error > 0.0
    ]


def single_shares(model: FittedModel, seed: int) -> dict[str, float]:
    """Return the share of the variance of figures that vanishes with the undetermined numbers at their estimates.

    Draws are trimmed and linearized one at a time, those that the propagation trims as well (it counts the others apart);
    the other numbers follow from the covariance (conditional normal distribution).
    """
    draws, covariance = from_covariance(model.result, SINGLES, seed), model.result.covariance.matrix
    estimates = np.array([model.vehicle.value(n) for n in draws.names])
    finite, held = np.isfinite(np.diag(covariance)), np.isin(draws.names, draws.undetermined)
    joint, rest = held & finite, ~held
    given = np.where(held, estimates, draws.values)
    if joint.any():
        gain = np.linalg.solve(covariance[np.ix_(joint, joint)], covariance[np.ix_(joint, rest)])
        given[:, rest] += (estimates[joint] - draws.values[:, joint]) @ gain
    trims = np.isfinite(propagate_draws(model.vehicle, draws, WING).samples["alpha"])
    every, left = (
        [single_figures(model.vehicle, dict(zip(draws.names, row, strict=True))) for row in values[trims]]
        for values in (draws.values, given)
    )
    out = {}
    for name in single_figures(model.vehicle, {}):
        pairs = [(a[name], b[name]) for a, b in zip(every, left, strict=True) if name in a and name in b]
        total, remaining = np.var(np.array(pairs), axis=0)
        out[name] = 1.0 - float(remaining / total)
    return out


def single_figures(vehicle: Vehicle, values: Mapping[str, float]) -> dict[str, float]:
    """Return angles, controls, thrust and modes of a vehicle with some numbers replaced; none where it does not trim."""
    changed = vehicle.with_numbers({n: {"value": float(v)} for n, v in values.items()})
    try:
        point = trim(changed, WING.reference, WING.altitude, 0.0, WING.density)
    except StoopError:
        return {}
    out = {n: point.start[n] for n in ("alpha", "phi")} | dict(point.deflections)
    if max(map(abs, out.values())) >= np.pi / 2.0:
        return {}
    for mode in linearize(changed, point).modes:
        if mode.eigenvalue.imag:
            out |= {f"{mode.name}, frequency": mode.frequency, f"{mode.name}, damping": mode.damping}
        else:
            out[f"{mode.name}, eigenvalue"] = mode.eigenvalue.real
    return out | {"thrust": float(point.thrust["propulsion.thrust"])}


@study.work
def carry(case: str, seed: int) -> dict[str, Any]:
    """Return which intervals hold the truth, or how far the naive twin is off."""
    if case == "twin":
        return {"difference": twin(seed)}
    if case == "marks":
        return {"marks": marks(seed)}
    if case == "fits":
        vehicle, truth, draws = fitted(seed)
        return {"held": [carried(vehicle, truth, draws, WING)]}
    truth = scenes.aircraft() if case == "known" else load_vehicle("quad-x")
    names = tuple(scenes.coefficients(truth)) if case == "known" else ROTOR_NUMBERS
    rng, out = np.random.default_rng([seed, 1]), []
    for _ in range(REPEATS):
        vehicle, draws = drawn(truth, names, rng)
        out.append(carried(vehicle, truth, draws, WING if case == "known" else ROTOR))
    return {"held": out}


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return coverage by case and figure."""
    records, claims, summary = list[dict[str, Any]](), list[Claim](), list[dict[str, Any]]()
    for case, words in NAMES.items():
        every = [held for r in samples[case] for held in r["held"]]
        shares = []
        for name in dict.fromkeys(name for held in every for name in held):
            shares.append(float(np.mean([x for held in every for x in held.get(name, ())])))
            row = {"case": case, "words": words, "figure": name}
            records.append({**row, "intervals": sum(name in held for held in every), "coverage": shares[-1]})
        pooled = float(np.mean(shares))
        figures = f"over {len(shares)} figures of {len(every)} estimates"
        claims.append(study.within(f"For {words} the intervals hold the truth in", POOLED, pooled, figures))
        summary.append({"words": words, "figure": "all", "intervals": len(every), "coverage": pooled})
    marked = [one for r in samples["marks"] for one in r["marks"]]
    right = [one["marked"] == (one["single"] >= ON_PRIOR) for one in marked]
    words, rightly = "figures marked as resting on priors, one control never moves", float(np.mean(right))
    for name in dict.fromkeys(one["figure"] for one in marked):
        own = [ok for one, ok in zip(marked, right, strict=True) if one["figure"] == name]
        row = {"case": "marks", "words": words, "figure": name}
        records.append({**row, "intervals": len(own), "coverage": float(np.mean(own))})
    statement = f"Where a control never moves, figures are marked as resting on priors rightly in {100 * RIGHTLY:.0f} %"
    figures = (
        f"{100 * rightly:.1f} % of {len(marked)} figures of {len(samples['marks'])} fits, by single trims"
    )
    claims.append(holds(statement, rightly >= RIGHTLY, figures))
    summary.append({"words": words, "figure": "all", "intervals": len(marked), "coverage": rightly})
    worst, twins = max(r["difference"] for r in samples["twin"]), TWINS * len(samples["twin"])
    statement = "Trims and modes of single draws by SciPy's root finding differ by less than"
    claim = holds(
        f"{statement} {MAX_DIFFERENCE:g}, relative",
        worst < MAX_DIFFERENCE,
        f"at most {worst:.1e} over {twins} draws",
    )
    last = {
        "case": "twin",
        "words": "largest relative difference",
        "figure": "twin",
        "intervals": twins,
        "coverage": worst,
    }
    title = "What the uncertainty means: intervals of derived figures"
    return Findings.of(title, [*claims, claim], [*records, last], summary=summary)


EXPERIMENT: Final = study.Verification(
    "propagate", show, runs=60, work="carry", cases=(*NAMES, "marks", "twin")
)
