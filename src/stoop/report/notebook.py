"""Parts of the report as objects that a notebook shows and that can be saved."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

from stoop.errors import StoopError
from stoop.report.estimates import correlation_section, estimates_section
from stoop.report.identification import identification_sheet
from stoop.report.maneuvers import residuals_section, role_section
from stoop.report.modes import modes_section
from stoop.report.sheet import Section, Sheet, render_sheet, write_sheet
from stoop.report.uncertainty import uncertainty_section
from stoop.results.result import Identification, Role

HEIGHT = 640  #: px of the frame in a notebook


@dataclass(frozen=True)
class Page:
    """A page that works offline; a notebook shows it in a frame of its own."""

    sheet: Sheet

    def save(self, path: str | Path) -> Path:
        """Write the page as HTML, whole or not at all."""
        write_sheet(self.sheet, Path(path))
        return Path(path)

    def _repr_html_(self) -> str:
        content = escape(render_sheet(self.sheet), quote=True)
        return f'<iframe srcdoc="{content}" width="100%" height="{HEIGHT}" style="border:0"></iframe>'


@dataclass(frozen=True, eq=False)
class Plots:
    """Plots of an identification, such as ``result.plot.maneuvers()``."""

    identification: Identification

    def maneuvers(self, role: Role = "fit") -> Page:
        """Return measured and simulated readings of the fitted maneuvers, or of those of ``"validation"``."""
        return self._page(role_section(self.identification, role), f"no maneuver of role {role}")

    def residuals(self) -> Page:
        """Return the autocorrelation of the residuals of each channel."""
        return self._page(residuals_section(self.identification), "no residuals")

    def estimates(self) -> Page:
        """Return the estimates with their 95 % intervals."""
        return self._page(estimates_section(self.identification), "no estimates")

    def uncertainty(self) -> Page:
        """Return standard errors by method, and which parameters the data identify."""
        return self._page(uncertainty_section(self.identification), "no uncertainty analysis")

    def correlation(self) -> Page:
        """Return the correlation of the estimates."""
        return self._page(correlation_section(self.identification), "no correlation")

    def modes(self) -> Page:
        """Return the natural modes of the identified vehicle."""
        return self._page(modes_section(self.identification), "no modes")

    def report(self) -> Page:
        """Return the whole report."""
        return Page(identification_sheet(self.identification))

    def _page(self, section: Section | None, missing: str) -> Page:
        if section is None:
            raise StoopError(f"plot: {missing} in this result")
        return Page(Sheet(self.identification.vehicle, "", (section,), "plot"))
