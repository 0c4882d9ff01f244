"""The pages of an identification and of a validation, their verdict, and their parts for a notebook."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assessment.verdict import CONFIRMED
from stoop.assessment.verdict import verdict as judge
from stoop.base.numbers import NOTHING, count, number, window
from stoop.base.text import enumerated, nearest
from stoop.errors import StoopError
from stoop.report import sheet
from stoop.report.charts import convergence_panel
from stoop.report.estimates import (
    body_parts,
    correlation_section,
    estimates_section,
    linear_section,
    modes_section,
    nuisance_section,
    repeatability_section,
    uncertainty_section,
)
from stoop.report.extensions import decisions_section, extensions_section, responses_section
from stoop.report.maneuvers import (
    TITLES,
    air_section,
    comparison_table,
    maneuver_parts,
    overview_parts,
    prediction_verdict,
    residuals_section,
    role_section,
    segments_text,
)
from stoop.report.model import Model
from stoop.results.result import Result, Role
from stoop.results.text import determined
from stoop.results.verdict import REASONS, Grade, Verdict, grouped, shortened

ENDINGS: Final = {
    "converged": "The search converged",
    "target": "The search reached the target cost",
    "budget": "The search used up its trajectories before it converged",
    "generations": "The search used up its generations before it converged",
    "stalled": "The search stopped where no step lowered the cost, before it converged",
    "interrupted": "The search was interrupted; this is the best it had found",
}
LEVELS: Final[dict[Grade, sheet.Level]] = {"trusted": "good", "usable": "caution", "do not use": "bad"}
VALIDATION_LEAD: Final = (
    "No parameter was fitted here: the initial state is estimated with the model from the second before each window (with "
    "rotors, anew each second), and with it the sensor biases, about those of the fitted maneuvers; the wind is from outside "
    "the windows. The band holds 95 % of readings: uncertain initial state, biases and parameters, and noise. Theil’s "
    "inequality coefficient, 0 for a perfect match and 1 at worst, below 10 Hz; beneath it that of a first-order lag, which "
    "learned from the fitted maneuvers, is given all commands, and is granted a bias of its own. A model that a lag can match "
    "has shown little."
)
SAME_AGAIN: Final = "With the same versions and CPU features, this seed gives the same numbers again."


def render_validation(identification: Model) -> str:
    """Return the page of a validation as HTML: the result that was validated, with the maneuvers that were predicted."""
    result, maneuvers = identification.result, identification.result.maneuvers
    lead = f"A fitted model predicts {count(len(maneuvers), 'maneuver')} that it was not fitted to"
    figures: list[sheet.Part] = [sheet.Prose(VALIDATION_LEAD, muted=True), comparison_table(maneuvers)]
    figures += [sheet.Bullets(result.basis, "notes")] if result.basis else []
    found, more = (sheet.Bullets(result.data_notices, "notes"),), result.warnings[REASONS:]
    pairs = zip(maneuvers, identification.traces, strict=True)
    pages = [sheet.Section(m.title, maneuver_parts(identification, m, own)) for m, own in pairs]
    warned = (sheet.Bullets(more, "warnings"),)
    folded = _folded(
        sheet.Section("Further warnings", warned, "Warnings") if more else None,
        sheet.Section("Figures of merit", figures, "Figures"),
        *pages,
        sheet.Section("Found while preparing the data", found, "Data") if result.data_notices else None,
        _provenance_section(identification, validation=True),
    )
    sections = (sheet.Section("Prediction", overview_parts(identification, "validation")), *folded)
    judged = prediction_verdict(maneuvers, result.verdict.grade == "do not use")
    supports = tuple(filter(None, (_match(result, "validation"),)))
    verdict = replace(judged, against=tuple(result.warnings[:REASONS]), supports=supports)
    return sheet.render_sheet(sheet.Sheet(identification.vehicle.name, lead, sections, "validation", verdict))


def _folded(*sections: sheet.Section | None) -> tuple[sheet.Section, ...]:
    """Return the sections that are there, for the reader to open."""
    return tuple(replace(section, folded=True) for section in sections if section is not None)


def render(identification: Model) -> str:
    """Return the report as HTML."""
    return sheet.render_sheet(identification_sheet(identification))


def identification_sheet(identification: Model) -> sheet.Sheet:
    """Return the report."""
    result = identification.result
    roles = [m.role for m in result.maneuvers]
    fitted = count(roles.count("fit"), "fitted maneuver")
    predicted = f", {roles.count('validation')} predicted" if "validation" in roles else ""
    lead = f"{result.free_count} from {fitted}{predicted} · optimizer {result.optimizer}"

    # The maneuvers, what the figures rest on, the equations, and what was found in the data.
    rows = [(m.title, m.role, segments_text(m), ", ".join(m.channels)) for m in result.maneuvers]
    head, kinds = ("Maneuver", "Role", "Data used", "Channels"), ("", "", "wrap", "wrap")
    parts: list[sheet.Part] = [sheet.Table("", head, tuple(rows), kinds, label="Maneuvers")]
    parts += [sheet.Bullets(result.basis, "notes")] if result.basis else []
    if identification.equations:
        formulas = Markup("").join(sheet.mathml(latex, "block") for latex in identification.equations)
        parts += [sheet.Heading("Equations"), sheet.Drawing("equations", formulas, "Model equations")]
    parts += body_parts(identification)
    if result.data_notices:
        found = sheet.Bullets(result.data_notices, "notes")
        parts += [sheet.Heading("Found while preparing the data"), found]

    search = None
    drawn = convergence_panel(np.asarray(identification.convergence, dtype=np.float64).reshape(-1, 2))
    if drawn is not None:
        ended = number(result.cost, 6)
        text = f"Best cost against simulated trajectories, by the first estimate of the noise; by the final one it is {ended}."
        panel = sheet.Panel("Cost", drawn, meaning="against whole-trajectory equivalents")
        search = sheet.Section("Search", (sheet.Prose(text, muted=True), sheet.Panels((panel,), "large")))

    first: Role = "validation" if "validation" in roles else "fit"
    curves = overview_parts(identification, first)
    shown = [sheet.Section(TITLES[first][0], curves, "Curves")] if curves else []
    told: list[sheet.Part] = []
    for title, items in reasons(result).items():
        told += [sheet.Heading(title)] if title and items else []
        told += [sheet.Bullets(items)] if items else []
    folded = _folded(
        sheet.Section("All reasons of the verdict", told, "Reasons"),
        sheet.Section("Warnings", (sheet.Bullets(result.warnings, "warnings"),)) if result.warnings else None,
        role_section(identification, "validation"),
        role_section(identification, "fit"),
        uncertainty_section(identification),
        responses_section(identification),
        extensions_section(identification),
        decisions_section(identification),
        residuals_section(identification),
        sheet.Section("What was fitted", parts),
        modes_section(identification),
        linear_section(identification),
        repeatability_section(identification),
        correlation_section(identification),
        search,
        nuisance_section(identification),
        air_section(identification),
        _provenance_section(identification, validation=False),
    )
    sections = (*shown, estimates_section(identification), *folded)
    return sheet.Sheet(identification.vehicle.name, lead, sections, "identification report", verdict(result))


def reasons(result: Result) -> dict[str, list[str]]:
    """Return by heading all reasons of the verdict, what to fly, how the search ended and how well all maneuvers are matched."""
    found = _judged(result)
    course = (*_course(result), _match(result, "fit"), _match(result, "validation"))
    return {
        "": [f"{one}." for one in grouped(found.reasons)],
        "What would settle them": [f"{one}." for one in found.advice],
        "How the fit went": [one for one in course if one],
    }


def _judged(result: Result) -> Verdict:
    return result.verdict if result.verdict.grade else judge(result, result.verdict.uses)


def _provenance_section(identification: Model, *, validation: bool) -> sheet.Section:
    """Return command, versions and hashes of the inputs."""
    result = identification.result
    spent = f"{number(result.trajectories, 4)} trajectories, {number(result.seconds, 3)} s"
    search = [("Seed", str(result.seed)), ("Optimizer", f"{result.optimizer}: {result.status}, {spent}")]
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    rows = [("Command", identification.command)] if identification.command else []
    rows += [] if validation else search
    rows += [("Versions", versions or NOTHING)]
    rows += [(name, f"sha256 {digest}") for name, digest in result.inputs.items()]
    table = sheet.Table("", ("", ""), tuple(rows), ("", "wrap mono"), label="Provenance")
    same_again = [] if validation else [sheet.Prose(SAME_AGAIN, muted=True)]
    return sheet.Section("Provenance", (*same_again, table))


def verdict(result: Result) -> sheet.Verdict:
    """Return the verdict of a result with the strongest reasons against it and for it."""
    found = _judged(result)
    against, merits = found.sides
    supports = [*(f"{shortened(one)}." for one in merits), *_successes(result)]
    shown = tuple(f"{shortened(one)}." for one in against[:REASONS])
    level, headline = LEVELS[found.grade], f"{found.headline}."
    return sheet.Verdict(level, headline, against=shown, supports=tuple(supports[:REASONS]))


def _successes(result: Result) -> Iterator[str]:
    """Yield the comparisons that the model wins, how many parameters the data determine, and a search that ended well."""
    roles: dict[Role, str] = {
        "validation": "where nothing was fitted",
        "fit": "in the maneuvers it was fitted to",
    }
    for role, where in roles.items():
        compared = _compared(result, role)
        if sum(compared) > 0.5 * len(compared):
            yield f"Better than a first-order lag in {sum(compared)} of {len(compared)} comparisons {where}."
    known = determined(result.parameters)
    if known:
        yield f"{len(known)} of {count(len(result.parameters), 'parameter')} are determined by these data."
    if result.status in CONFIRMED:
        yield f"{ENDINGS[result.status]}."


def _course(result: Result) -> tuple[str, str]:
    """Return how the search ended, and how many of the parameters the data determine."""
    parameters = result.parameters
    unknown = [name for name, one in parameters.items() if not one.identifiable]
    bounded = [name for name, one in parameters.items() if one.at_bound]
    how = ENDINGS.get(result.status, f"The search ended with status “{result.status}”")
    spent = f"{number(result.trajectories, 3)} simulated trajectories in {number(result.seconds, 2)} s"
    text = f"{count(len(parameters), 'parameter')} estimated"
    if unknown:
        text += f"; {count(len(unknown), 'of them is', 'of them are')} not identifiable ({enumerated(unknown, 8)})"
    if bounded:
        text += (
            f"; {len(bounded)} {'lies' if len(bounded) == 1 else 'lie'} at a bound ({enumerated(bounded, 8)})"
        )
    # An identifiable parameter is in doubt only where others can almost replace it.
    doubts = result.identifiability.parameters.items()
    together = sum(bool(one.doubt) and name not in unknown for name, one in doubts)
    if together:
        text += f"; {together} of them known only in combination with others"
    elif not (unknown or bounded):
        text += ", all of them identifiable"
    return f"{how}, after {spent}. {result.advice}".rstrip(), f"{text}."


def _match(result: Result, role: Role) -> str:
    """Return how well the maneuvers of a role are matched, in one sentence."""
    maneuvers = [m for m in result.maneuvers if m.role == role]
    if not maneuvers:
        return "" if role == "fit" else "No window was held back, so the prediction error is not known."
    channels = [(m, name, one) for m in maneuvers for name, one in m.channels.items()]
    known = [(one, name) for _, name, one in channels if math.isfinite(one.theil)]
    found = sorted((one.theil, name) for one, name in known if not one.below_noise)
    calm, parts = len(known) - len(found), []
    if found:
        (least, best), (most, worst) = found[0], found[-1]
        span = f"from {least:.3f} ({best}) to {most:.3f} ({worst})"
        parts.append(f"Theil’s coefficient runs {span}, 0 being perfect and 1 worst")
    if calm:
        moves = count(calm, "channel moves", "channels move")
        parts.append(f"{moves} less than the noise and cannot judge the model")
    compared = _compared(result, role)
    if compared:
        lost = [f"{name} ({window(m.start, m.stop)})" for m, name, one in channels if one.lost]
        better = sum(compared)
        comparisons = count(len(compared), "comparison")
        text = f"the model beats a trivial first-order lag in {better} of {comparisons}"
        drawn = len(compared) - better - len(lost)
        text += f" and leaves only noise in {drawn} more" if drawn else ""
        parts.append(f"{text}, not in {enumerated(lost, 8)}" if lost else text)
    opening = "In the maneuvers it was fitted to" if role == "fit" else "Where nothing was fitted"
    return f"{opening}, {'; '.join(parts)}." if parts else ""


def _compared(result: Result, role: Role) -> list[bool]:
    """Return for each channel that has a baseline whether the model beats it."""
    channels = [one for m in result.maneuvers if m.role == role for one in m.channels.values()]
    return [one.better for one in channels if one.compared]


@dataclass(frozen=True, eq=False, repr=False)
class Plots:
    """Plots of an identification, such as ``result.plot.maneuvers()``."""

    identification: Model

    def __repr__(self) -> str:
        """Return the names of the plots on one line."""
        return "<Plots: maneuvers, residuals, estimates, uncertainty, correlation, modes, report>"

    def __call__(self, role: Role = "fit") -> sheet.Page:
        """Return the maneuvers, as :meth:`maneuvers` does."""
        return self.maneuvers(role)

    def maneuvers(self, role: Role = "fit") -> sheet.Page:
        """Return measured and simulated readings of the fitted maneuvers, or of those of ``"validation"``."""
        if role not in ("fit", "validation"):
            raise StoopError(f"plot: no role '{role}'; {nearest(role, ('fit', 'validation'))}")
        return self._page(role_section(self.identification, role), f"no maneuver of role {role}")

    def residuals(self) -> sheet.Page:
        """Return the autocorrelation of the residuals of each channel."""
        return self._page(residuals_section(self.identification), "no residuals")

    def estimates(self) -> sheet.Page:
        """Return the estimates with their 95 % intervals."""
        return self._page(estimates_section(self.identification), "no estimates")

    def uncertainty(self) -> sheet.Page:
        """Return standard errors by method, and which parameters the data identify."""
        return self._page(uncertainty_section(self.identification), "no uncertainty analysis")

    def correlation(self) -> sheet.Page:
        """Return the correlation of the estimates."""
        return self._page(correlation_section(self.identification), "no correlation")

    def modes(self) -> sheet.Page:
        """Return the natural modes of the identified vehicle."""
        return self._page(modes_section(self.identification), "no modes")

    def report(self) -> sheet.Page:
        """Return the whole report."""
        return sheet.Page(identification_sheet(self.identification))

    def _page(self, section: sheet.Section | None, missing: str) -> sheet.Page:
        if section is None:
            raise StoopError(f"plot: {missing} in this result")
        return sheet.Page(sheet.Sheet(self.identification.vehicle.name, "", (section,), "plot"))
