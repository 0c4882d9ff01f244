"""The pages of an identification and of a validation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup

from stoop.base.numbers import NOTHING, count, number
from stoop.report.charts import convergence_panel
from stoop.report.estimates import correlation_section, estimates_section, nuisance_section
from stoop.report.formula import mathml
from stoop.report.maneuvers import (
    air_section,
    comparison_table,
    maneuver_parts,
    maneuver_title,
    prediction_verdict,
    residuals_section,
    role_section,
    segments_text,
)
from stoop.report.modes import modes_section, repeatability_section
from stoop.report.sheet import (
    Bullets,
    Details,
    Drawing,
    Heading,
    Panel,
    Panels,
    Part,
    Prose,
    Section,
    Sheet,
    Table,
    render_sheet,
    write_sheet,
)
from stoop.report.uncertainty import uncertainty_section
from stoop.report.verdict import prediction, verdict
from stoop.results.result import Identification

VALIDATION_LEAD = (
    "Nothing was fitted here: the initial state comes from the first 0.2 s of measurements (with rotors, anew each second "
    "from what is measured there), the sensor biases from the fitted maneuvers, the wind from outside the windows. Theil’s "
    "inequality coefficient, 0 for a perfect match and 1 at worst, below 10 Hz; beneath it that of a first-order lag, which "
    "learned from the fitted maneuvers, is given all commands, and is granted a bias of its own. A model that a lag can match "
    "has shown little."
)


def write_report(identification: Identification, path: Path) -> None:
    """Write the report whole or not at all.

    Parameters
    ----------
    identification : Identification
        The result and its traces.
    path : Path
        The HTML file; its folder must exist.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    write_sheet(identification_sheet(identification), path)


def write_validation(identification: Identification, path: Path) -> None:
    """Write the page of a validation: the result that was validated, with the maneuvers that were predicted.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    write_sheet(validation_sheet(identification), path)


def render(identification: Identification) -> str:
    """Return the report as HTML."""
    return render_sheet(identification_sheet(identification))


def identification_sheet(identification: Identification) -> Sheet:
    """Return the report."""
    result = identification.result
    roles = [m.role for m in result.maneuvers]
    fitted = count(roles.count("fit"), "fitted maneuver")
    predicted = f", {roles.count('validation')} predicted" if "validation" in roles else ""
    lead = f"{count(len(result.parameters), 'parameter')} from {fitted}{predicted} · optimizer {result.optimizer}"
    sections = (
        Section("Warnings", (Bullets(result.warnings, "warnings"),)) if result.warnings else None,
        _fitted_section(identification),
        estimates_section(identification),
        uncertainty_section(identification),
        role_section(identification, "fit"),
        role_section(identification, "validation"),
        residuals_section(identification),
        modes_section(identification),
        repeatability_section(identification),
        correlation_section(identification),
        _search_section(identification),
        nuisance_section(identification),
        air_section(identification),
        _provenance_section(identification, validation=False),
    )
    there = tuple(section for section in sections if section is not None)
    return Sheet(identification.vehicle, lead, there, "identification report", verdict(result))


def validation_sheet(identification: Identification) -> Sheet:
    """Return the page of a validation."""
    result = identification.result
    maneuvers = result.maneuvers
    lead = f"A fitted model predicts {count(len(maneuvers), 'maneuver')} that it was not fitted to"
    sentences = tuple(filter(None, (prediction(result), *result.warnings)))
    overview: list[Part] = [
        Prose(VALIDATION_LEAD, muted=True),
        comparison_table(maneuvers),
        *_basis(identification),
    ]
    if result.data_notices:
        summary = f"Found while preparing the data ({len(result.data_notices)})"
        overview.append(Details(summary, (Bullets([*map(str, result.data_notices)], "notes"),)))
    pages = [
        Section(maneuver_title(m), maneuver_parts(identification, m, trace))
        for m, trace in zip(maneuvers, identification.traces, strict=True)
    ]
    sections = (Section("Overview", overview), *pages, _provenance_section(identification, validation=True))
    return Sheet(
        identification.vehicle, lead, sections, "validation", prediction_verdict(maneuvers, sentences)
    )


def _basis(identification: Identification) -> list[Part]:
    found = [str(one) for one in identification.result.basis]
    return [Bullets(found, "notes")] if found else []


def _fitted_section(identification: Identification) -> Section:
    """Return the maneuvers, what the figures rest on, the equations, and what was found in the data."""
    rows = tuple(
        (maneuver_title(m), m.role, segments_text(m), ", ".join(m.channels))
        for m in identification.result.maneuvers
    )
    head = ("Maneuver", "Role", "Data used", "Channels")
    parts: list[Part] = [Table("", head, rows, ("", "", "wrap", "wrap"), label="Maneuvers")]
    parts += _basis(identification)
    if identification.equations:
        formulas = Markup("").join(mathml(latex, "block") for latex in identification.equations)
        parts += [Heading("Equations"), Drawing("equations", formulas, "Model equations")]
    found = [str(one) for one in identification.result.data_notices]
    if found:
        parts += [Heading("Found while preparing the data"), Bullets(found, "notes")]
    return Section("What was fitted", parts)


def _search_section(identification: Identification) -> Section | None:
    history = np.asarray(identification.convergence, dtype=np.float64).reshape(-1, 2)
    drawn = convergence_panel(history)
    if drawn is None:
        return None
    cost = number(identification.result.cost, 6)
    lead = Prose(f"Best cost against simulated trajectories. It ended at {cost}.", muted=True)
    panel = Panel("Cost", drawn, meaning="against whole-trajectory equivalents")
    return Section("Search", (lead, Panels((panel,), "large")))


def _provenance_section(identification: Identification, *, validation: bool) -> Section:
    """Return command, versions and hashes of the inputs."""
    result = identification.result
    spent = f"{number(result.trajectories, 4)} trajectories, {number(result.seconds, 3)} s"
    search = [("Seed", str(result.seed)), ("Optimizer", f"{result.optimizer}: {result.status}, {spent}")]
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    rows = [
        *([("Command", identification.command)] if identification.command else []),
        *([] if validation else search),
        ("Versions", versions or NOTHING),
        *((name, f"sha256 {digest}") for name, digest in result.inputs.items()),
    ]
    table = Table("", ("", ""), tuple(rows), ("", "wrap mono"), label="Provenance")
    lead = Prose(
        "With the same versions and CPU features, this seed gives the same numbers again.", muted=True
    )
    return Section("Provenance", (table,) if validation else (lead, table))
