"""Stock aircraft of an independent simulator identified from their outputs, against that simulator's own tables.

Stoop is given mass properties, geometry and surfaces at trim, but no aerodynamic number. True are the derivatives that
JSBSim's own aerodynamics has at a flight condition, by finite differences through it: JSBSim is put into states about
the trim, one variable off at a time (two where a term is a product), and its aerodynamic force and moment are read. The
terms of the model are fitted to them: where a table is straight that is the central difference; where it bends, the mean
over what was flown (parts of a variable's range, by how long it was there), which is all that a flight can tell.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, SLUG
from stoop.flight import Flight, from_columns
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import fit
from stoop_studies.findings import Claim, Findings, Setting, counted, holds, number
from stoop_studies.verify import jsbsim_flight, study

SIGMAS: Final = 3.0  #: an estimate agrees within so many standard errors,
SHARE: Final = 0.02  #: or within this of the true value, whichever is larger
AGREEING_SHARE: Final = 0.99  #: of single estimates; of normal ones 0.9973 lie within three standard errors
MEAN_SQUARES: Final = (0.75, 1.5)  #: of the differences in standard errors; 1 without any error of the model
ZERO: Final = 1e-9  #: what is below is rounding in JSBSim
NOISE: Final = {
    "V": 0.2, "alpha": 0.005, "beta": 0.005, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.05,
}  #: one standard deviation of the white noise on each channel: m/s, rad, rad/s, m/s2  # fmt: skip
VARIABLES: Final = ("V", "alpha", "beta", "p", "q", "r", "elevator", "aileron", "rudder")  #: of the terms
PARTS: Final = 24  #: of the range of a variable
CORNERS: Final = (-1.0, 1.0)  #: standard deviations, of both factors of a product
CENTER, REFERENCE = "inertia/cg-{}-in", "metrics/aero-rp-{}-in"


def vehicle_of(
    aircraft: jsbsim_flight.Aircraft, trim: jsbsim_flight.Trim, moments: Mapping[str, float] | None = None
) -> Vehicle:
    """Return the vehicle with every aerodynamic parameter at zero.

    Deflections count from trim, so that the constant terms are the coefficients there; ``moments`` of inertia are JSBSim's
    unless others are given, kg m2.
    """
    stock = aircraft.stock
    text = study.data_text("jsbsim.toml.in").format(
        title=stock.title, mass=aircraft["inertia/mass-slugs"] * SLUG, center=list(aircraft.point(CENTER)),
        **(moments or inertia(aircraft)), area=aircraft["metrics/Sw-sqft"] * FOOT**2, chord=aircraft["metrics/cbarw-ft"] * FOOT,
        span=aircraft["metrics/bw-ft"] * FOOT, airspeed=stock.airspeed, alpha=stock.alpha,
        moment_point=list(aircraft.point(REFERENCE)), gravity=aircraft.apparent_gravity,
        eye=list(aircraft.point("metrics/eyepoint-{}-in")),
    )  # fmt: skip
    sensors = [f"[sensors.{channel}]\nsigma = {sigma!r}" for channel, sigma in NOISE.items()]
    controls = [f"[controls.{c}]\noffset = {-value!r}" for c, value in trim.deflections.items()]
    parts = [text, *sensors, *controls]
    if stock.throttle is not None:  # thrust is recorded; it acts on the line of the engines' force and moment
        arm = aircraft["moments/m-prop-lbsft"] / aircraft["forces/fbx-prop-lbs"] * FOOT
        x, y, z = aircraft.point(CENTER)
        parts.append(
            f'[propulsion]\nkind = "channel"\nscale = {{ value = 1.0, free = false }}\nposition = {[x, y, z + arm]}'
        )
    for coefficient in ("CD", "CL", "CQ", "Cl", "Cm", "Cn"):
        gone, added = stock.dropped.get(coefficient, ()), stock.added.get(coefficient, {})
        wide = {"CDalpha2": "alpha^2"} if coefficient == "CD" and "CDalpha2" not in gone else {}
        parts += [f"[aerodynamics.{coefficient}]", *(f"{name} = false" for name in gone)]
        # boxes are wide, for tables may bend more than eq. (1) allows
        parts += [
            f'{n} = {{ term = "{term}", bounds = [-20.0, 20.0] }}' for n, term in {**wide, **added}.items()
        ]
    return parse_vehicle("\n".join(parts), f"jsbsim {stock.model}")


def inertia(aircraft: jsbsim_flight.Aircraft) -> dict[str, float]:
    """Return moments and products of inertia, kg m2.

    The property of xz is the element of the inertia matrix, which is minus the product; those of xy and yz
    are the products.
    """
    axes = ("xx", "yy", "zz", "xy", "xz", "yz")
    raw = {a: aircraft[f"inertia/i{a}-slugs_ft2"] * SLUG * FOOT**2 for a in axes}
    return {**raw, "xz": -raw["xz"]}


def derivatives(
    aircraft: jsbsim_flight.Aircraft,
    trim: jsbsim_flight.Trim,
    vehicle: Vehicle,
    flown: jsbsim_flight.Recording,
) -> dict[str, float]:
    """Return the true value of every aerodynamic term of a vehicle, at the mean altitude of a flight."""
    altitude = float(flown.columns["altitude"].mean())
    middle = replace(trim, state=replace(trim.state, altitude=altitude, phi=0.0))
    offsets, shares = zip(*_offsets(aircraft, vehicle, flown), strict=True)
    root = np.sqrt(shares)
    places = [_place(aircraft, middle, offset) for offset in offsets]
    # what is left of one variable is a constant in its places: those of the others do not count as places of it
    alone = [[float(offset.keys() == {v}) for offset in offsets] for v in VARIABLES]
    known = set(places[0][0])
    out: dict[str, float] = {}
    for coefficient, group in vehicle.terms.items():
        parsed = [terms.parse(text, known, text) for text in group.values()]
        columns = [[float(terms.convert(term, variables)) for variables, _ in places] for term in parsed]
        required = [values[coefficient] for _, values in places]
        found = np.linalg.lstsq((root * [*columns, *alone]).T, root * required, rcond=None)[0]
        own = dict(zip(group, map(float, found), strict=False))
        constants = [name for name, text in group.items() if text == "1"]
        out |= own | {name: own[name] + float(found[len(own) :].sum()) for name in constants}
    return out


def _lengths(aircraft: jsbsim_flight.Aircraft) -> dict[str, float]:
    """Return the length that makes each rate dimensionless, m."""
    names = {"p": "metrics/bw-ft", "q": "metrics/cbarw-ft", "r": "metrics/bw-ft"}
    return {a: aircraft[name] * FOOT for a, name in names.items()}


def _offsets(
    aircraft: jsbsim_flight.Aircraft, vehicle: Vehicle, flown: jsbsim_flight.Recording
) -> Iterator[tuple[dict[str, float], float]]:
    """Give changes of term variables from the trim with their shares: none, each one as flown, and corners of products."""
    columns, speed = flown.columns, float(np.mean(flown.columns["V"]))
    units = {a: 2.0 * speed / length for a, length in _lengths(aircraft).items()}
    units["V"] = vehicle.value("reference.airspeed")
    changes = {n: (columns[n] - np.mean(columns[n])) / units.get(n, 1.0) for n in VARIABLES}
    yield {}, 1.0
    for name, values in changes.items():
        counts, edges = np.histogram(values, PARTS)
        sums = np.histogram(values, edges, weights=values)[0]
        for total, count in zip(sums[counts > 0].tolist(), counts[counts > 0].tolist(), strict=True):
            yield {name: total / count}, count / len(values)
    known = set(VARIABLES)
    texts = {text for group in vehicle.terms.values() for text in group.values()}
    for used in sorted({tuple(sorted(terms.variables(terms.parse(t, known, t)))) for t in texts}):
        if len(used) > 1:
            for levels in itertools.product(CORNERS, repeat=len(used)):
                steps = {n: level * float(np.std(changes[n])) for n, level in zip(used, levels, strict=True)}
                yield steps, 1.0 / len(CORNERS)


def _place(
    aircraft: jsbsim_flight.Aircraft, trim: jsbsim_flight.Trim, offset: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Put JSBSim off the trim; return its term variables, and its coefficients: force in wind axes, moment in body axes."""
    state, stock, lengths = trim.state, aircraft.stock, _lengths(aircraft)
    speed = state.V * (1.0 + offset.get("V", 0.0))
    rates = {a: offset.get(a, 0.0) * 2.0 * speed / length for a, length in lengths.items()}
    angles = {a: getattr(state, a) + offset.get(a, 0.0) for a in ("alpha", "beta")}
    deflections = {c: value + offset.get(c, 0.0) for c, value in trim.deflections.items()}
    aircraft.put(replace(state, V=speed, **rates, **angles), deflections)
    airspeed = aircraft["velocities/vt-fps"] * FOOT
    variables = {
        "V": airspeed / stock.airspeed - 1.0,
        "alpha": aircraft["aero/alpha-rad"] - stock.alpha,
        "beta": aircraft["aero/beta-rad"],
        **{a: aircraft[f"velocities/{a}-aero-rad_sec"] * n / (2.0 * airspeed) for a, n in lengths.items()},
        **{c: aircraft.deflection(c) - value for c, value in trim.deflections.items()},
    }
    pressure_area = aircraft["aero/qbar-psf"] * aircraft["metrics/Sw-sqft"]
    wind = aircraft.read([f"forces/fw{a}-aero-lbs" for a in "xyz"]) / pressure_area
    arms = aircraft.read(["metrics/bw-ft", "metrics/cbarw-ft", "metrics/bw-ft"])
    moment = moment_at_reference(aircraft) / (pressure_area * arms)
    return variables, dict(
        zip(("CD", "CQ", "CL", "Cl", "Cm", "Cn"), map(float, (*wind, *moment)), strict=True)
    )


def moment_at_reference(aircraft: jsbsim_flight.Aircraft) -> FloatArray:
    """Return the aerodynamic moment (3,) about the aerodynamic reference point, lbf ft."""
    arm = np.subtract(aircraft.point(REFERENCE), aircraft.point(CENTER)) / FOOT
    force = aircraft.read([f"forces/fb{a}-aero-lbs" for a in "xyz"])
    about_center = aircraft.read([f"moments/{a}-aero-lbsft" for a in "lmn"])
    return np.asarray(about_center - np.cross(arm, force))


@dataclass(frozen=True, eq=False)
class Case:
    """A vehicle of JSBSim, flown once without noise, and what stoop is given of it.

    ``truth`` has JSBSim's own value of each parameter, ``noise`` the standard deviation of each channel, SI, and ``stream``
    begins the seed of the noise: no two cases share it.
    """

    name: str
    vehicle: Vehicle
    flown: jsbsim_flight.Recording
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    channels: tuple[str, ...]
    stream: int

    def flight(self, seed: int) -> Flight:
        """Return the flight as noisy instruments record it."""
        generator = np.random.default_rng([self.stream, seed])
        columns = {
            channel: (values := self.flown.columns[channel])
            + self.noise.get(channel, 0.0) * generator.standard_normal(len(values))
            for channel in self.channels
        }
        return from_columns(self.name, self.flown.time, columns, source="JSBSim")

    def estimates(self, flight: Flight) -> dict[str, dict[str, float]]:
        """Identify as a user would; return truth, estimate and standard error of every parameter."""
        window = f"0:{self.flown.time[-1]:g}"
        found = fit(self.vehicle, flight, [window]).result.parameters
        return {
            "truth": dict(self.truth),
            "estimate": {name: found[name].estimate for name in self.truth},
            "sigma": {name: found[name].std_error for name in self.truth},
        }


@functools.cache
def flown_case(model: str) -> Case:
    """Fly an aircraft of the fleet, and read its derivatives off."""
    stream, stock = next((i, s) for i, s in enumerate(jsbsim_flight.FLEET) if s.model == model)
    aircraft = jsbsim_flight.Aircraft(stock)
    trim = jsbsim_flight.trimmed(aircraft)
    aircraft.put(trim.state, trim.deflections)
    vehicle = vehicle_of(aircraft, trim)
    flown = jsbsim_flight.fly(aircraft, trim)
    truth = derivatives(aircraft, trim, vehicle, flown)
    return Case(model, vehicle, flown, truth, NOISE, tuple(flown.columns), stream)


@study.work
def identify_once(case: str, seed: int) -> dict[str, Any]:
    """Identify one aircraft from one noisy flight."""
    known = flown_case(case)
    return known.estimates(known.flight(seed))


def _digits(values: FloatArray, digits: int = 6) -> list[float]:
    """Return so many digits; what is zero but for rounding in JSBSim is zero."""
    return [0.0 if abs(v) < ZERO else float(f"{v:.{digits}g}") for v in values.tolist()]


def comparison(
    subject: jsbsim_flight.Subject, results: Sequence[Mapping[str, Any]], kind: str, what: str
) -> tuple[list[dict[str, Any]], list[Claim]]:
    """Compare the estimates of one subject over its flights with the truth.

    Results are those of `Case.estimates`, one per flight; ``kind`` is the column that names the subject, ``what`` what a
    parameter is called. Returns the records and the claims.
    """
    names = list(results[0]["truth"])
    truth = np.array([results[0]["truth"][n] for n in names])
    estimates, sigmas = (
        np.array([[r[key][n] for n in names] for r in results]) for key in ("estimate", "sigma")
    )
    errors, mean_errors = estimates - truth, (estimates - truth).mean(axis=0)
    scores = errors / sigmas  # in standard errors
    reach = np.maximum(SIGMAS * sigmas, SHARE * np.abs(truth))
    agree, mean_scores = np.abs(errors) <= reach, mean_errors / sigmas.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        percent = 100.0 * (estimates[0] / np.where(np.abs(truth) < ZERO, np.nan, truth) - 1.0)
    table = pd.DataFrame({
        kind: subject.model, "parameter": names, "flights": len(results),
        "jsbsim": _digits(truth), "estimate": _digits(estimates[0]), "sigma": _digits(sigmas[0]),
        "difference_in_sigma": scores[0].round(2), "difference_percent": _digits(percent, 3), "agrees": agree[0],
        "flights_that_agree": agree.sum(axis=0), "mean_estimate": _digits(estimates.mean(axis=0)),
        "mean_difference_in_sigma": mean_scores.round(2), "rms_difference_in_sigma": np.sqrt((scores**2).mean(axis=0)).round(2),
    })  # fmt: skip
    records = study.records_of(table)
    above = np.where(np.abs(mean_errors) > SHARE * np.abs(truth), np.abs(mean_scores), 0.0)
    worst, square = int(np.argmax(above)), float(np.mean(scores**2))
    claims = [
        holds(
            f"{subject.title}: the mean over the flights is within 3 standard errors or 2 % of JSBSim's own value, "
            f"for every {what}",
            bool((np.abs(mean_errors) <= reach.mean(axis=0)).all()),
            f"largest difference that is above 2 %: {above[worst]:.1f} standard errors, {names[worst]}",
        ),
        holds(
            f"{subject.title}: so are at least {100 * AGREEING_SHARE:.0f} % of the single estimates",
            float(agree.mean()) >= AGREEING_SHARE,
            counted(int(agree.sum()), agree.size),
        ),
        holds(
            f"{subject.title}: the differences are as large as the standard errors say",
            MEAN_SQUARES[0] <= square <= MEAN_SQUARES[1],
            f"mean square {number(square)}, which is 1 if noise is all that there is",
        ),
    ]
    return records, claims


def findings(
    title: str, kind: str, what: str, subjects: Sequence[jsbsim_flight.Subject], samples: study.Samples
) -> Findings:
    """Return how far the estimates of some subjects are off; ``kind`` and ``what`` as in `comparison`."""
    found = [comparison(subject, samples[subject.model], kind, what) for subject in subjects]
    records, claims = (list(itertools.chain(*column)) for column in zip(*found, strict=True))
    return Findings.of(title, claims, records)


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how far the derivatives are off."""
    title = "Stock aircraft of JSBSim, identified from their outputs"
    return findings(title, "aircraft", "derivative", jsbsim_flight.FLEET, samples)


EXPERIMENT: Final = study.Verification(
    "jsbsim", show, runs=10, work="identify_once", cases=tuple(stock.model for stock in jsbsim_flight.FLEET)
)
