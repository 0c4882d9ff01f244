"""The log: dropped or picked, and seen."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Final

import panel as pn
import param

from stoop.extend.errors import StoopError
from stoop_app import parts
from stoop_app.folder import LOOK, log_of
from stoop_app.places import reading
from stoop_app.steps import OUTPUT, Step
from stoop_app.uploads import size
from stoop_app.view import View

ENDINGS: Final = (
    ".ulg", ".bin", ".log", ".usd", ".bbl", ".bfl", ".mat", ".parquet", ".bag", ".mcap", ".csv", ".csv.gz", ".nc",
)  # fmt: skip
MAX_FOUND: Final = 12  #: logs of the folder around that are offered


def near() -> list[Path]:
    """Return the logs in the folder where the app was started."""
    with suppress(OSError):
        every = sorted(p for p in Path.cwd().absolute().iterdir() if not p.name.startswith("."))
        return [p for p in every if p.name.lower().endswith(ENDINGS)][:MAX_FOUND]
    return []


class DropZone(pn.custom.JSComponent):
    """A place to drop a log on, or a folder of tables; the browser streams it to the app."""

    placed = param.String(doc="place of the log in the project's folder")
    failed = param.String(doc="why it was not kept")

    _esm = parts.style("drop.js")
    _stylesheets: ClassVar = [parts.style("content.css")]


class LogView(View):
    """Choose a log, see it."""

    title = "Log"

    def refresh(self) -> None:
        """Show the choice, the mapping, or the flight."""
        project, shown = self.project, self.body
        step, refused = project.reading, project.refused
        try:
            _ = project.log_file
        except StoopError as error:
            shown[:] = [parts.html(parts.error(error)), *self._choice()]
            return
        if not project.log:
            shown[:] = self._choice()
        elif step is None:
            shown[:] = [self._head(), parts.button("Read the log", self.act(project.read_log), "primary")]
        elif step.running:
            shown[:] = [self._head(), *self.waiting(step, "reading the log")]
        elif step.state == "failed":
            again = parts.button("Read again", self.act(project.read_log))
            mapping = parts.button("The columns", lambda: self.go("Columns"))
            shown[:] = [self._head(), parts.failed(step), pn.Row(again, mapping), *self._choice()]
        elif step.kind == "map":
            shown[:] = [self._head(), *self._mapping(step)]
        else:
            shown[:] = [self._head(), *self._flight(step)]
        if refused is not None:
            name = log_of(refused)
            draft = self.act(lambda: project.open_log(name, draft=True))
            text = f"{Path(name).name} was not taken, {Path(project.log).name} stays: {refused.error}"
            said = parts.html(parts.error(text) + parts.command(refused))
            shown[:] = [said, parts.button("Draft a mapping for it", draft), *shown]

    def _head(self) -> pn.pane.HTML:
        path = self.project.root / self.project.log
        amount = f", {size(path.stat().st_size)}" if path.is_file() else ""
        return parts.html(
            f"<h2>{parts.escaped(path.name)}</h2><p class='soft'>{parts.escaped(self.project.log)}{amount}</p>"
        )

    def _choice(self) -> list[Any]:
        zone = DropZone(sizing_mode="stretch_width", margin=(8, 0))
        zone.param.watch(lambda e: e.new and self.act(lambda: self.project.open_log(e.new))(), "placed")
        zone.param.watch(lambda e: self.say(e.new), "failed")
        path = pn.widgets.TextInput(label="or the path of a log on this machine", placeholder="/home/me/flights/log_5.ulg",
                                    sizing_mode="stretch_width", margin=(4, 8, 4, 0))  # fmt: skip

        def opened() -> None:
            if not path.value.strip():
                raise StoopError("Write the path of a log, or drop one")
            if self.project.open(Path(path.value.strip())):
                self.go("Fleet")

        path.param.watch(lambda e: self.act(opened)(), "enter_pressed")
        offers = {
            "logs of this folder: use": [Path(name) for name in self.project.former],
            "logs in the folder where the app was started": near(),
        }
        found = [
            one
            for title, paths in offers.items()
            if paths
            for one in (parts.html(parts.soft(title)), pn.FlexBox(*map(self._offer, paths)))
        ]
        return [zone, pn.Row(path, parts.button("Open", self.act(opened), align="end")), *found]

    def _offer(self, path: Path) -> pn.widgets.Button:
        return parts.button(path.name, self.act(lambda: self.project.open_log(path)), description=str(path))

    def _mapping(self, step: Step) -> list[Any]:
        lead = (
            "Nothing in this kind of log says what its columns mean. A mapping was drafted by names, units and the size of the "
            "numbers: look at it, choose what is missing, and the log is read."
        )
        onward = parts.button("Next: the columns", lambda: self.go("Columns"), "primary")
        return [parts.html(f"<p>{lead}</p>"), onward, parts.html(parts.command(step))]

    def _flight(self, step: Step) -> list[Any]:
        info = self.project.info
        with reading(step.file(OUTPUT)):
            size = f"{info['rate']:g} Hz grid, {len(info['channels'])} channels"
            span = f"{info['start']:.1f} to {info['stop']:.1f} s on the log's own clock, {size}"
            faults = [fault["message"] for fault in info["faults"] if "message" in fault]
        findings = f"<h3>Suspected faults</h3>{parts.bullets(faults)}" if faults else ""
        return [
            parts.html(f"<p>{parts.escaped(span)}</p>"),
            pn.FlexBox(
                parts.button("Next: the vehicle", lambda: self.go("Vehicle"), "primary"),
                parts.button("What the columns mean", lambda: self.go("Columns")),
            ),
            parts.html(findings),
            parts.card("Another log", *self._choice(), parts.html(parts.command(step))),
            parts.framed(f"{step.name}/{LOOK}", "the flight"),
        ]
