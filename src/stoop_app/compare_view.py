"""Two runs side by side: estimates, intervals, predictions, curves."""

from __future__ import annotations

from typing import Any, Final

import panel as pn

from stoop import load_vehicle
from stoop.extend.files import write_files
from stoop.extend.reports import sheet
from stoop_app import parts
from stoop_app.comparison import Compared, comparison_sheet
from stoop_app.fit_view import finished, result
from stoop_app.folder import PROGRESS, VEHICLE, modified
from stoop_app.places import inside, reading
from stoop_app.progress_curves import read_curves
from stoop_app.steps import Step
from stoop_app.view import View

TOO_FEW: Final = "Two runs with a result are needed; change a number or a window and run again."
PAGES: Final = "comparisons"  #: folder of the pages


class CompareView(View):
    """Choose two runs, see what differs."""

    title = "Compare"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._picks = [
            pn.widgets.Select(label=name, margin=(0, 12, 8, 0), width=150) for name in ("run A", "run B")
        ]
        self._shown = pn.Column(**parts.FILLING)
        self._wanted = ""  #: place of a page that is not made yet
        for pick in self._picks:
            pick.param.watch(lambda e: self._turn(), "value")

    def refresh(self) -> None:
        """Offer the runs that are done; the last two are compared."""
        names = list(finished(self.project))
        if len(names) < 2:
            self.body[:] = [parts.html(parts.soft(TOO_FEW))]
            return
        for pick, last in zip(self._picks, names[-2:], strict=True):
            kept = pick.value if pick.value in names else last
            pick.param.update(options=names, value=kept)
        self.body[:] = [pn.FlexBox(*self._picks), self._shown]
        self._turn()

    @property
    def _both(self) -> list[Step]:
        runs = finished(self.project)
        return [runs[pick.value] for pick in self._picks if pick.value in runs]

    def _turn(self) -> None:
        """Show the page of the two; one that is not there is made at the next look, and that it is made is shown meanwhile."""
        both = self._both
        if len(both) < 2:
            return
        place = f"{PAGES}/{'-'.join(step.folder.name for step in both)}.html"
        made = modified(self.project.root / place)
        self._wanted = place if made < max(modified(step.file("result.json")) for step in both) else ""
        self._shown[:] = [parts.html(parts.BAR) if self._wanted else parts.framed(place, "comparison")]

    def tick(self) -> None:
        """Make the page that is wanted."""
        if self._wanted:
            wanted, self._wanted = self._wanted, ""

            def made() -> None:
                place = inside(self.project.root, wanted)
                page = sheet.render_sheet(comparison_sheet(*map(compared, self._both)))
                write_files(place.parent, {place.name: page})
                self._turn()

            self.act(made)()


def compared(step: Step) -> Compared:
    """Return a run with the numbers of its vehicle, and its curves."""
    vehicle = load_vehicle(step.file(VEHICLE))
    values = {p.name: p.value for p in vehicle.parameters}
    with reading(step.file(PROGRESS)):
        return Compared(step.name, result(step), values, read_curves(step.file(PROGRESS)))
