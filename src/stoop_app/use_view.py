"""What to do with a result: files for another tool, and the next maneuver to fly."""

from __future__ import annotations

from typing import Any, Final

import panel as pn

from stoop import Notice
from stoop.extend.verbs import verbs
from stoop_app import parts
from stoop_app.fit_view import finished
from stoop_app.folder import VEHICLE
from stoop_app.places import document_of, reading
from stoop_app.steps import Step
from stoop_app.view import View

DESIGN: Final = (
    "Inputs for which the standard errors of the free numbers are the smallest, within the limits."
)
THE_FILE: Final = "vehicle.toml, as it is"
TARGET: Final = verbs()["export"].option("target")
LIMITS: Final = tuple(map(verbs()["design"].option, ("duration", "amplitude")))


class UseView(View):
    """Export a model, design a maneuver."""

    title = "Use"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._subject = pn.widgets.Select(label="model", width=220, margin=(0, 12, 4, 0))
        self._target = parts.field(TARGET, "export to", width=190)
        self._limits = {option: parts.field(option, width=190) for option in LIMITS}
        self._shown: Any = None

    def refresh(self) -> None:
        """Show what can be done, and what was done."""
        project = self.project
        self._runs = {name: step.name for name, step in finished(project).items()}
        if project.vehicle:
            self._runs[THE_FILE] = VEHICLE
        if not self._runs:
            self.body[:] = [parts.html("<p class='soft'>A result or a vehicle is needed first.</p>")]
            return
        names = [*reversed([n for n in self._runs if n != THE_FILE]), *(self._runs.keys() & {THE_FILE})]
        self._subject.param.update(
            options=names, value=self._subject.value if self._subject.value in names else names[0]
        )
        export = pn.FlexBox(
            self._target,
            parts.button("Export", self.act(self._export), "primary", align="end"),
            align_items="flex-end",
        )
        design_button = parts.button("Design the next maneuver", self.act(self._design), "primary")
        design = pn.FlexBox(*self._limits.values(), design_button, align_items="flex-end")
        self.body[:] = [
            self._subject,
            parts.html("<h2>For another tool</h2>"),
            export,
            *self._steps("exports", "exporting"),
            parts.html(f"<h2>The next maneuver</h2>{parts.soft(DESIGN)}"),
            design,
            *self._steps("designs", "designing; this takes a minute or more"),
        ]

    def _export(self) -> None:
        words = ["export", self._runs[self._subject.value], *parts.given(TARGET, self._target.value), "-o"]
        self.project.start("exports", lambda at: [*words, at])

    def _design(self) -> None:
        limits = [word for option, one in self._limits.items() for word in parts.given(option, one.value)]
        words = ["design", self._runs[self._subject.value], *limits, "-o"]
        self.project.start("designs", lambda at: [*words, at])

    def _steps(self, kind: str, doing: str) -> list[Any]:
        return [
            pn.Column(*self._step(s, doing), margin=0, sizing_mode="stretch_width")
            for s in reversed(self.project.steps(kind))
        ]

    def _step(self, step: Step, doing: str) -> list[Any]:
        head = f"<h3>{parts.escaped(step.name)} {parts.chip(step)}</h3>"
        if step.running:
            return [parts.html(head), *self.waiting(step, doing)]
        if step.state == "failed":
            return [parts.html(head), parts.failed(step)]
        places = [str(p.relative_to(self.project.root)) for p in step.files]
        printed = parts.fold("what it printed", f"<pre>{parts.escaped(step.findings)}</pre>", is_open=True)
        pages = [p for p in places if p.endswith(".html")]
        shown = "".join(parts.opened(p, f"open {p}") for p in pages[:1])
        links = parts.downloads(places)
        return [parts.html(f"{head}{_warnings(step)}{links}{printed}{shown}{parts.command(step)}")]


def _warnings(step: Step) -> str:
    """Return what a design warns of: models that are as likely may leave the envelope."""
    with reading(step.file("design.json")):
        found = [Notice.from_dict(one) for one in document_of(step.folder, "design.json").get("notices", ())]
        return "".join(parts.note(one) for one in found if one.severity == "warning")
