"""A fleet: a folder of logs instead of one log, and what changed in it."""

from __future__ import annotations

from pathlib import Path

import panel as pn

from stoop.extend.errors import StoopError
from stoop_app import parts
from stoop_app.folder import source_of, store_of
from stoop_app.steps import ERRORS
from stoop_app.view import View
from stoop_fleet.store import PAGE

LEAD = (
    "Logs of several vehicles: what changed, in which vehicle, since which flight, and which part explains it. Figures of "
    "rotors, trims and drag need the vehicle of step 3; parts.csv and flights.csv are taken from the folder of the logs."
)


class FleetView(View):
    """Choose a folder of logs, see what changed."""

    title = "Fleet"

    def refresh(self) -> None:
        """Show the choice, how far the logs are, or the page of the fleet."""
        project, step = self.project, self.project.latest("fleets")
        path = pn.widgets.TextInput(
            label="folder of logs on this machine", placeholder="/home/me/flights",
            value="" if step is None else str(source_of(step)), sizing_mode="stretch_width", margin=(4, 8, 4, 0),
        )  # fmt: skip

        def opened() -> None:
            if not path.value.strip():
                raise StoopError("Write the path of a folder of logs")
            project.open_fleet(Path(path.value.strip()))

        button = parts.button("What changed", self.act(opened), "primary", align="end")
        lacking = "" if project.vehicle else "No vehicle is chosen yet."
        choice = [parts.html(f"<p>{parts.escaped(LEAD)}</p>{parts.soft(lacking)}"), pn.Row(path, button)]
        self._far = parts.html()
        if step is None:
            self.body[:] = choice
        elif step.running:
            waiting = self.waiting(step, f"reading the logs of {source_of(step)}")
            self.body[:] = [*waiting, self._far]
            self.tick()
        elif step.state == "failed":
            self.body[:] = [parts.failed(step), *choice]
        else:
            shown = parts.html(f"<pre>{parts.escaped(step.findings)}</pre>{parts.command(step)}")
            made = parts.framed(f"{store_of(source_of(step))}/{PAGE}", "the fleet")
            self.body[:] = [shown, parts.card("Another folder, or again", *choice), made]

    def tick(self) -> None:
        """Show how many logs are read."""
        step = self.project.latest("fleets")
        if step is not None and step.running:
            self._far.object = parts.soft(next(reversed(step.text(ERRORS).splitlines()), ""))
