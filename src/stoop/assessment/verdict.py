"""Verdict on a result: trusted, usable for some uses, or not to be used; see ``docs/validation.md``.

Rules stand in `_refusals` and `_contradictions` (for every use), `_judged` (for one use), `_doubts` (usable, but not trusted) and
`_merits`.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 11 (model validation).
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapter 11.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import binom

from stoop.base.notices import Notice, distinct, notice, of_severity, paragraph
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.results.result import MIN_SIGNAL_TO_NOISE, GoodnessOfFit, ManeuverResult, NoiseCovariance, Result
from stoop.results.uncertainty import SCATTER_LEVEL
from stoop.results.verdict import Grade, Need, Use, Verdict
from stoop.vehicle import Vehicle, terms


class Limits:
    """Limits of the verdict; `docs/validation.md` shows them."""

    moved_errors: Final = 3.0  #: standard errors by which an extension moves a needed parameter, and ...
    moved_share: Final = 0.05  #: ... share of its size, from which the form of the model is contradicted
    error: Final = 0.2  #: standard error of a needed parameter that a use allows, over its size
    minor: Final = 0.1  #: share of the largest effect on its axis, which is the least size of a parameter
    #: of the error of a ratio by the priors alone, below which the flight has shown it
    prior_share: Final = 0.5
    unknown: Final = 0.5  #: share of parameters at a bound or not identifiable that a result may have
    not_predicted: Final = 0.5  #: share of curves matched no better than trivially that a result may have
    #: share of readings within the 95 % band of a prediction that a trusted model has at least
    inside: Final = 0.75
    #: of a channel's motion over its noise from which it judges a model. Slow errors and gusts of one maneuver, of one or two
    #: degrees of freedom, are up to three times (99.7 %) what they are in all
    motion: Final = 3.0
    size: Final = 1e3  #: rms error over the noise of the fit, beyond which a simulation has diverged
    #: probability below which scatter of maneuvers, or color of innovations, is no chance
    chance: Final = 0.01


#: notices that refuse a result: the search, the sensors, the samples
REFUSING: Final = frozenset({"no-confirmed-optimum", "sensor-fault", "too-few-samples", "estimates-diverge"})
#: notices that speak against one use: what it needs was not excited, or not measured
AGAINST: Final = {
    "control-still": "control design",
    "contribution-in-doubt": "control design",
    "axis-not-excited": "control design",
    "rates-not-recorded": "control design",
    "lift-not-excited": "performance",
    "airspeed-not-measured": "performance",
    "low-airspeed": "performance",
}
#: notices of what the verdict judges itself
JUDGED: Final = REFUSING | {
    "lag-not-beaten",
    "model-lacks",
    "model-lacks-one-of",
    "at-bound",
    "not-identifiable",
}
CONFIRMED: Final = frozenset({"converged", "target"})  #: a search that ended so has found its optimum
#: coefficient -> axis, its rate, the flow angle that makes it stable
MOMENTS: Final = {"Cl": ("roll", "p", "beta"), "Cm": ("pitch", "q", "alpha"), "Cn": ("yaw", "r", "beta")}
INERTIA: Final = {"roll": "mass.inertia.xx", "pitch": "mass.inertia.yy", "yaw": "mass.inertia.zz"}


def uses(vehicle: Vehicle, sizes: Mapping[str, float] | None = None) -> tuple[Use, ...]:
    """Return the requirements of each use: free parameters by their part in the equations, and channels.

    `sizes` are those of :class:`stoop.assessment.flown_model.FlownModel`.
    """
    of_effect = sizes or {}
    free = [p.name for p in vehicle.parameters if p.free]
    known = set(terms.STATE_VARIABLES) | set(vehicle.file.controls)
    parts: dict[str, tuple[str, str | None]] = {}  # coefficient, and the variable that a term is linear in
    for coefficient, group in vehicle.terms.items():
        for name in (n for n in group if n in free):
            tree = terms.parse(group[name], known, vehicle.where)
            constant = None if terms.variables(tree) else ""
            parts[name] = coefficient, tree.id if isinstance(tree, ast.Name) else constant

    def coefficients(coefficient: str, variable: str = "") -> list[str]:
        return [name for name, part in parts.items() if part == (coefficient, variable)]

    def turning(coefficient: str) -> list[str]:
        """Return the effectiveness of controls about an axis; none if each acts more on the other lateral axis (adverse yaw)."""
        other = {"Cl": "Cn", "Cn": "Cl"}.get(coefficient, "")

        def size(which: str, control: str) -> float:
            return max((abs(vehicle.value(n)) for n in coefficients(which, control)), default=0.0)

        acting = {c: names for c in vehicle.file.controls if (names := coefficients(coefficient, c))}
        meant = any(size(coefficient, c) >= size(other, c) for c in acting)
        return [name for names in acting.values() for name in names] if meant else []

    def begins(*prefixes: str) -> list[str]:
        return [name for name in free if name.startswith(prefixes)]

    dynamics: list[tuple[str, Sequence[str]]] = []
    # what a flight shows over a moment of inertia, unless coefficients hold for a stated one
    over: dict[str, str] = {}
    stated = "reference.inertia.x" in vehicle.rows
    for coefficient, (axis, rate, angle) in MOMENTS.items():
        about = [
            (f"damping in {axis}", coefficients(coefficient, rate)),
            (f"static stability in {axis}", coefficients(coefficient, angle)),
            (f"control effectiveness in {axis}", turning(coefficient)),
        ]
        # moments of the air count over the moment of inertia, which is judged with each of them
        alone = [] if any(names for _, names in about) else begins(INERTIA[axis])
        dynamics += [*about, (f"inertia in {axis}", alone)]
        over |= {} if stated else dict.fromkeys((what for what, _ in about), INERTIA[axis])
    rotors = {"thrust": ("rotors.T",), "torque": ("rotors.torque", "rotors.Q"), "lag": ("rotors.lag",)}
    dynamics += [(f"{what} of the rotors", begins(*rows)) for what, rows in rotors.items()]
    power: list[tuple[str, Sequence[str]]] = [
        ("lift at the reference condition", coefficients("CL")), ("lift slope", coefficients("CL", "alpha")),
        ("drag at the reference condition", coefficients("CD")), ("thrust", begins("propulsion.", "rotors.T")),
        ("drag of body and rotors", begins("body_drag.", "rotors.drag", "rotors.inflow")),
    ]  # fmt: skip

    def use(name: str, channels: Iterable[str], needs: Iterable[tuple[str, Sequence[str]]] = ()) -> Use:
        wanted = [(what, tuple(names)) for what, names in needs if names]
        sized = (Need(w, n, tuple(of_effect.get(p, 0.0) for p in n), over.get(w, "")) for w, n in wanted)
        return Use(name, tuple(c for c in channels if c in vehicle.outputs), tuple(sized))

    return (
        use("control design", (*RATES, *(EULER if vehicle.positions else ())), dynamics),
        use("simulation", vehicle.outputs),
        use("performance", ("V", "alpha", *VELOCITY, *SPECIFIC_FORCE, *vehicle.positions), power),
    )


def verdict(result: Result, needed: Sequence[Use]) -> Verdict:
    """Return the verdict on a result; `needed` are the uses of its vehicle, see :func:`uses`."""
    sizes = _sizes(result, needed)
    refusals = [*_refusals(result), *_contradictions(result, sizes)]
    judged = tuple(_judged(result, use, sizes) for use in needed)
    doubts = list(_doubts(result))
    grade: Grade = "usable"
    if refusals or (needed and not any(use.justified for use in judged)):
        grade, judged = "do not use", tuple(replace(use, justified=False) for use in judged)
    elif not doubts and not _lost(_judging(result)):
        grade = "trusted"
    # with what they move
    said = {found.subject for found in refusals if found.code.startswith("verdict-form")}
    doubts = [found for found in doubts if found.code != "verdict-lacks" or found.subject not in said]
    against = [*refusals, *(found for use in judged for found in use.against), *doubts]
    named: dict[str, None] = {}  # parameters of the reasons, in their order
    for found in against:
        several = found.values.get("parameters", ())
        names = (*(several if isinstance(several, tuple) else ()), found.values.get("parameter", ""))
        named |= dict.fromkeys(str(name) for name in names if name)
    known = result.identifiability.parameters
    shared: dict[str, list[str]] = {}
    for name in (name for name in named if name in known and known[name].advice):
        shared.setdefault(paragraph(known[name].advice), []).append(name)
    advice = (notice("verdict-advice", parameters=tuple(ns), advice=text) for text, ns in shared.items())
    return Verdict(grade, judged, distinct([*against, *_merits(result)]), tuple(advice))


def _refusals(result: Result) -> Iterator[Notice]:
    """Yield the reasons that refuse a result for every use."""
    yield from (found for found in result.notices if found.code in REFUSING)
    if result.status not in CONFIRMED and not any(n.code == "no-confirmed-optimum" for n in result.notices):
        yield notice("no-confirmed-optimum", advice=result.advice or result.status)
    if not math.isfinite(result.cost):
        yield notice("verdict-no-cost")
    for m in result.maneuvers:
        if gone := diverged(m, result.noise_covariance):
            yield notice("simulation-diverges", m.window, channels=gone)
    unknown = _unknown(result)
    if len(unknown) > Limits.unknown * len(result.parameters):
        yield _notice_of_unknown(result, unknown)
    held_back, fitted = _by_role(result)
    figures = [(c, one) for c, several in (held_back or fitted).items() for one in several]
    beaten = [c for c, one in figures if _beaten(one)]
    if len(beaten) > Limits.not_predicted * len(figures):
        names = tuple(dict.fromkeys(beaten))
        yield notice("verdict-trivial", lost=len(beaten), compared=len(figures), channels=names)


def _sizes(result: Result, needed: Sequence[Use]) -> dict[str, float]:
    """Return the size of each estimated parameter that a use needs, by which its errors are judged.

    A derivative near zero has no size of its own: then it is a share of the value that would matter most on its axis.
    """
    least: dict[str, float] = {}
    for need in (need for use in needed for need in use.needs):
        least |= dict(zip(need.parameters, need.sizes or (0.0,) * len(need.parameters), strict=True))
    known = {n: abs(result.parameters[n].estimate) for n in least if n in result.parameters}
    return {n: max(value, Limits.minor * least[n]) for n, value in known.items()}


def _contradictions(result: Result, sizes: Mapping[str, float]) -> Iterator[Notice]:
    """Yield the strongest extension that would change required parameters beyond their error bars, or a number of the vehicle."""
    for test in result.extensions.standing:
        moves = {n: moved for n, moved in test.moves.items() if n in sizes}
        shares = {n: _share(result, n, moved, sizes[n]) for n, moved in moves.items()}
        present = test.value - test.change
        if test.kind == "number" and present != 0.0 and not test.name.startswith("sensors."):
            moves[test.name], shares[test.name] = test.change / test.std_error, abs(test.change / present)
        far = [n for n in shares if abs(moves[n]) > Limits.moved_errors and shares[n] > Limits.moved_share]
        if far:
            name = max(far, key=lambda n: abs(moves[n]))
            if name == test.name:  # a number of the file, which may have been measured
                yield notice(
                    "verdict-form-number", name, statistic=test.statistic, value=test.value, present=present,
                    line=test.line,
                )  # fmt: skip
                return
            code = "verdict-form-one-of" if test.rivals else "verdict-form"
            yield notice(
                code, test.name, statistic=test.statistic, parameter=name, shift=moves[name], share=shares[name],
                line=test.line, rivals=test.rivals,
            )  # fmt: skip
            return


def _share(result: Result, name: str, shift: float, size: float) -> float:
    """Return a shift of a parameter, in standard errors, relative to its size."""
    return abs(shift) * result.parameters[name].std_error / size if size > 0.0 else math.nan


def _inertia(result: Result, need: Need, name: str) -> str:
    """Return the estimated moment of inertia that a moment counts over; empty where there is none."""
    known = {name, need.inertia} <= set(result.covariance.names) & set(result.parameters)
    return need.inertia if known and result.parameters[name].estimate else ""


def _error(result: Result, need: Need, name: str, size: float) -> float:
    """Return the standard error of a parameter over its size; of a moment, that of its ratio to the moment of inertia.

    A flight determines moments relative to moments of inertia, and a controller needs no more: a wrong inertia scales both.
    """
    own, inertia = result.parameters[name], _inertia(result, need, name)
    if not inertia:
        return _share(result, name, 1.0, size)
    used = [result.covariance.names.index(n) for n in (name, inertia)]
    gradient = np.array([1.0 / own.estimate, -1.0 / result.parameters[inertia].estimate])
    variance = float(gradient @ result.covariance.matrix[np.ix_(used, used)] @ gradient)
    share = math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else math.inf
    return share * abs(own.estimate) / size if size > 0.0 else math.nan


def _seen(result: Result, need: Need, name: str) -> bool:
    """Whether the flight determines a parameter, or its ratio to a moment of inertia, beyond their priors."""
    own, inertia = result.parameters[name], _inertia(result, need, name)
    if name not in _unknown(result) or own.at_bound or not inertia:
        return name not in _unknown(result)
    pair = own, result.parameters[inertia]
    before = math.hypot(*(p.prior_std / p.estimate for p in pair))
    return _error(result, need, name, abs(own.estimate)) < Limits.prior_share * before


def _judged(result: Result, use: Use, sizes: Mapping[str, float]) -> Use:
    """Return a use with the reasons against it."""
    against = [n for n in result.notices if AGAINST.get(n.code) == use.name]
    estimated = [(need, [n for n in need.parameters if n in result.parameters]) for need in use.needs]
    needs = [(need, names) for need, names in estimated if names]
    for need, names in needs:
        effect = dict(zip(need.parameters, need.sizes, strict=False))
        largest = max(names, key=lambda n: abs(result.parameters[n].estimate) / (effect.get(n) or 1.0))
        error = _error(result, need, largest, sizes[largest])
        if not _seen(result, need, largest):
            unseen = tuple(n for n in names if not _seen(result, need, n))
            against.append(notice("verdict-need-unknown", need.subject, use=use.name, parameters=unseen))
        elif not error <= Limits.error:
            values, inertia = {"use": use.name, "parameter": largest}, _inertia(result, need, largest)
            against.append(
                notice("verdict-ratio-inaccurate", need.subject, **values, inertia=inertia, error=error)
                if inertia
                else notice("verdict-need-inaccurate", need.subject, **values, error=error)
            )
    if not needs and use.name != "simulation":
        against.append(notice("verdict-not-estimated", use.name))
    judging = {c: own for c, own in _judging(result).items() if c in use.channels}
    if lost := _lost(judging):
        against.append(notice("verdict-channels", use.name, channels=lost))
    elif use.channels and not judging and not result.process_noise.filtered:
        against.append(notice("verdict-still", use.name, channels=use.channels))
    if use.name == "control design":
        against += _missed_responses(result)
    return replace(use, justified=not against, against=tuple(against))


def _missed_responses(result: Result) -> Iterator[Notice]:
    """Yield of each rate the response of the flights to an input that the model misses most, beyond random error."""
    for output in dict.fromkeys(one.output for one in result.response_misfits):
        own = [one for one in result.response_misfits if one.output == output]
        worst = max(own, key=lambda one: one.least)
        if worst.least > Limits.error:
            figures = {"share": worst.share, "low": worst.low, "high": worst.high}
            yield notice("verdict-response", output, input=worst.input, **figures)


def _lost(judging: Mapping[str, Sequence[GoodnessOfFit]]) -> tuple[str, ...]:
    """Return the channels in which, for most maneuvers, a first-order lag or the mean is as good as the model."""
    found = {c: sum(map(_beaten, own)) / len(own) for c, own in judging.items()}
    return tuple(c for c, share in found.items() if share > Limits.not_predicted)


def _beaten(one: GoodnessOfFit) -> bool:
    """Whether a trivial model matches as well; not where only noise is left.

    A filter predicts from sample to sample: its innovations must agree with the covariance that it computes.
    """
    if one.innovations.known:
        return one.within < Limits.inside
    return one.lost or one.worse_than_mean


def _moving(
    maneuvers: Iterable[ManeuverResult], motion: float = Limits.motion
) -> dict[str, list[GoodnessOfFit]]:
    """Return the figures by channel that can judge a model: those of channels whose motion far exceeds their noise.

    Innovations judge a model in any motion.
    """
    found: dict[str, list[GoodnessOfFit]] = {}
    for c, one in (item for m in maneuvers for item in m.channels.items()):
        if one.innovations.known or not one.signal_to_noise < motion:
            found.setdefault(c, []).append(one)
    return found


def _by_role(result: Result) -> tuple[dict[str, list[GoodnessOfFit]], dict[str, list[GoodnessOfFit]]]:
    """Return the figures that judge each channel, of held-back and of fitted maneuvers; the latter not for a filter.

    Fitted curves of a filter omit the estimated gusts, or are predictions from sample to sample.
    """
    fitted = (m for m in result.maneuvers if m.role == "fit" and not result.process_noise.filtered)
    return _moving(m for m in result.maneuvers if m.role == "validation"), _moving(fitted)


def _judging(result: Result) -> dict[str, list[GoodnessOfFit]]:
    """Return the figures that judge each channel: of held-back maneuvers in which it moves, else of fitted ones.

    Beside these count held-back maneuvers in which it only exceeds its noise, which are not what the model was made of.
    """
    held_back, fitted = _by_role(result)
    seen = _moving((m for m in result.maneuvers if m.role == "validation"), MIN_SIGNAL_TO_NOISE)
    return {c: [*own, *seen.get(c, ())] for c, own in fitted.items()} | held_back


def diverged(maneuver: ManeuverResult, noise: NoiseCovariance) -> tuple[str, ...]:
    """Return the channels whose simulation diverged, beyond what noise and initial state explain."""
    positive = np.where(np.diag(noise.matrix) > 0.0, np.diag(noise.matrix), np.nan)
    most = dict(zip(noise.channels, (Limits.size * np.sqrt(positive)).tolist(), strict=True))
    channels = maneuver.channels.items()
    return tuple(c for c, one in channels if not math.isfinite(one.rmse) or one.rmse > most.get(c, math.nan))


def _unknown(result: Result) -> tuple[str, ...]:
    return tuple(n for n, one in result.parameters.items() if one.at_bound or not one.identifiable)


def _notice_of_unknown(result: Result, unknown: tuple[str, ...]) -> Notice:
    return notice("verdict-unknown", parameters=unknown, count=len(unknown), total=len(result.parameters))


def _doubts(result: Result) -> Iterator[Notice]:
    """Yield the reasons why a usable result is not trusted."""
    for t in result.extensions.standing:
        yield notice("verdict-lacks", t.name, statistic=t.statistic, line=t.line)
    if unknown := _unknown(result):
        yield _notice_of_unknown(result, unknown)
    held_back, fitted = _by_role(result)
    unseen = tuple(c for c in RATES if c in fitted and c not in held_back)  # axes that are not predicted
    if not any(m.role == "validation" for m in result.maneuvers):
        yield notice("verdict-no-held-back")
    elif unseen:
        yield notice("verdict-not-held-back", channels=unseen)
    for m in result.maneuvers:
        outside = {c: one.within for c, one in m.channels.items() if one.within < Limits.inside}
        if outside:
            yield notice("verdict-outside", m.window, channels=tuple(outside), least=min(outside.values()))
    white = [(c, one.innovations.whiteness) for m in result.maneuvers for c, one in m.channels.items()]
    known = [(c, one) for c, one in white if one.verdict]
    colored = [c for c, one in known if one.p_value < Limits.chance]
    if known and binom.sf(len(colored) - 1, len(known), Limits.chance) < Limits.chance:
        names = tuple(dict.fromkeys(colored))
        yield notice("verdict-innovations", channels=names, colored=len(colored), compared=len(known))
    if not result.extensions.tested:
        yield notice("verdict-not-tested", result.method)
    if sum(m.role == "fit" for m in result.maneuvers) < 2:
        yield notice("verdict-one-maneuver")
    others = [n.code for n in of_severity(result.notices, "warning") if n.code not in JUDGED]
    if others:
        yield notice("verdict-warnings", codes=tuple(dict.fromkeys(others)), count=len(others))
    compared, scatter = _compared(result)
    if binom.sf(scatter - 1, compared, SCATTER_LEVEL) < Limits.chance:
        expected, ratio = SCATTER_LEVEL * compared, result.repeatability.scatter_ratio
        yield notice("verdict-scatter", compared=compared, scatter=scatter, by_chance=expected, ratio=ratio)


def _compared(result: Result) -> tuple[int, int]:
    """Return how many parameters maneuvers fitted alone compare, and how many of them scatter."""
    found = [one.verdict for one in result.repeatability.parameters.values() if one.verdict]
    return len(found), found.count("scatter")


def _merits(result: Result) -> Iterator[Notice]:
    """Yield the reasons for a result."""
    if result.extensions.tested and not result.extensions.found:
        yield notice("verdict-form-holds", tested=result.extensions.tested)
    if result.extensions.unresolved:
        yield notice("verdict-unresolved", numbers=result.extensions.unresolved, share=Limits.moved_share)
    for m in result.maneuvers:
        moving = _moving([m])
        if m.role == "validation" and moving and not _lost(moving):
            yield notice("verdict-predicted", m.window, count=len(moving), channels=len(m.channels))
    if result.response_misfits and not any(_missed_responses(result)):
        worst = max(result.response_misfits, key=lambda one: one.share)
        yield notice(
            "verdict-responses", outputs=tuple(dict.fromkeys(one.output for one in result.response_misfits)),
            low=min(one.low for one in result.response_misfits),
            high=max(one.high for one in result.response_misfits), share=worst.share,
            pair=f"{worst.output} over {worst.input}",
        )  # fmt: skip
    (compared, scatter), fitted = _compared(result), sum(m.role == "fit" for m in result.maneuvers)
    if compared:
        yield notice("verdict-agree-alone", compared=compared, scatter=scatter)
    elif fitted > 1:
        yield notice("verdict-agree", maneuvers=fitted)
