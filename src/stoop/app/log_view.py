"""The log: dropped or picked, its mapping asked where its columns have no known meaning, and seen."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Final

import panel as pn
import param

from stoop.app import parts
from stoop.app.folder import LOOK, MAPPING, log_of
from stoop.app.places import reading
from stoop.app.steps import OUTPUT, Step
from stoop.app.uploads import size
from stoop.app.view import View
from stoop.errors import StoopError

ENDINGS: Final = (
    ".ulg", ".bin", ".log", ".usd", ".bbl", ".bfl", ".mat", ".parquet", ".bag", ".mcap", ".csv", ".csv.gz", ".nc",
)  # fmt: skip
MAX_FOUND: Final = 12  #: logs of the folder around that are offered
UNSURE: Final = re.compile(r"^(?P<line>[^#]*\S)\s*#\s*unsure:\s*(?P<doubt>.*)$")


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
    """Choose a log, answer what is unsure in its mapping, see it."""

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
            mapping = parts.button("Draft a mapping", self.act(project.draft_mapping))
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
            self.project.open_log(path.value.strip())

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
        lines = step.text(MAPPING).splitlines()
        found = {i: match for i, line in enumerate(lines) if (match := UNSURE.match(line))}
        wide = {"sizing_mode": "stretch_width", "margin": (2, 0)}
        asked = {
            i: pn.widgets.TextInput(label=f"unsure: {match['doubt']}", value=match["line"], **wide)
            for i, match in found.items()
        }
        text = pn.widgets.TextAreaInput(value="\n".join(lines), rows=14, max_length=1_000_000, **parts.CODE)
        before = text.value

        def taken() -> None:
            answers = {i: field.value.strip() for i, field in asked.items()}
            kept = "\n".join([*(answers.get(i, line) for i, line in enumerate(lines)), ""])
            self.project.take_mapping(kept if text.value == before else text.value)

        lead = (
            "Nothing in this kind of log says what its columns mean; this was drafted by names, units and the size of the "
            f"numbers. {len(asked)} lines are unsure: correct them, or empty a line to leave the column out."
        )
        return [
            parts.html(f"<h2>What the columns mean</h2><p>{lead}</p>"),
            *asked.values(),
            parts.button("Use this mapping", self.act(taken), "primary"),
            parts.html(parts.soft("or edit the whole draft")),
            text,
            parts.html(parts.command(step)),
        ]

    def _flight(self, step: Step) -> list[Any]:
        info = self.project.info
        with reading(step.file(OUTPUT)):
            size = f"{info['rate']:g} Hz grid, {len(info['channels'])} channels"
            span = f"{info['start']:.1f} to {info['stop']:.1f} s on the log's own clock, {size}"
            faults = [fault["message"] for fault in info["faults"] if "message" in fault]
        findings = f"<h3>Suspected faults</h3>{parts.bullets(faults)}" if faults else ""
        return [
            parts.html(f"<p>{parts.escaped(span)}</p>"),
            parts.button("Next: the vehicle", lambda: self.go("Vehicle"), "primary"),
            parts.html(findings + parts.frame(f"{step.name}/{LOOK}", "the flight")),
            parts.html(parts.command(step)),
            parts.card("Another log", *self._choice()),
        ]
