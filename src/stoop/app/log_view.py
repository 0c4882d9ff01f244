"""The log: dropped or picked, its mapping asked where its columns have no known meaning, and seen."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import panel as pn
import param

from stoop.app import parts, steps
from stoop.app.folder import MAPPING
from stoop.app.plots import Strips, read_flight
from stoop.app.steps import Step
from stoop.app.uploads import size
from stoop.app.view import View
from stoop.errors import StoopError

ENDINGS: Final = (".ulg", ".bin", ".log", ".usd", ".mat", ".parquet", ".bag", ".mcap", ".csv", ".csv.gz", ".nc")
MAX_FOUND: Final = 12  #: logs of the folder around that are offered
UNSURE: Final = re.compile(r"^(?P<line>[^#]*\S)\s*#\s*unsure:\s*(?P<doubt>.*)$")


class DropZone(pn.custom.JSComponent):
    """A place to drop a log on, or a folder of tables; the browser streams it to the app."""

    placed = param.String(doc="place of the log in the project's folder")
    failed = param.String(doc="why it was not kept")

    _esm = """
    const files = async (entry) => {
      if (entry.isFile) return [await new Promise((yes, no) => entry.file(yes, no))]
      const reader = entry.createReader(), out = []
      for (;;) {
        const some = await new Promise((yes, no) => reader.readEntries(yes, no))
        if (!some.length) return out
        for (const one of some) if (one.isFile) out.push(...await files(one))
      }
    }
    export function render({ model }) {
      const zone = document.createElement("label"), input = document.createElement("input"), text = document.createElement("span")
      zone.tabIndex = 0
      zone.style.cssText = "display:block;border:1.5px dashed var(--line);border-radius:8px;padding:34px 16px;text-align:center;" +
        "cursor:pointer;color:var(--soft);background:var(--card)"
      text.textContent = "Drop a flight log here (or a folder of CSV tables), or click to choose"
      input.type = "file"; input.multiple = true; input.style.display = "none"; input.setAttribute("aria-label", "flight log")
      zone.append(text, input)
      const send = async (list, into) => {
        model.failed = ""
        let place = ""
        for (const [i, file] of list.entries()) {
          text.textContent = `sending ${file.name} (${i + 1} of ${list.length}, ${(file.size / 1e6).toFixed(1)} MB)`
          try {
            const query = new URLSearchParams({ name: file.name, into })
            const answer = await fetch("upload?" + query, { method: "POST", body: file })
            const said = await answer.text()
            if (!answer.ok) { text.textContent = "Drop a flight log here"; model.failed = file.name + ": " + said; return }
            place = said
          } catch (error) {
            text.textContent = "Drop a flight log here"
            model.failed = file.name + ": not kept; it is too large, changed while it was sent, or the app has ended"
            return
          }
        }
        text.textContent = "reading " + place
        model.placed = place
      }
      input.onchange = () => send([...input.files], input.files.length > 1 ? "tables" : "")
      zone.ondragover = (e) => { e.preventDefault(); zone.style.borderColor = "var(--accent)" }
      zone.ondragleave = () => { zone.style.borderColor = "var(--line)" }
      zone.ondrop = async (e) => {
        e.preventDefault()
        zone.style.borderColor = "var(--line)"
        const entries = [...e.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry)
        const list = (await Promise.all(entries.map(files))).flat()
        const folder = entries.find((entry) => entry.isDirectory)
        if (list.length) send(list, folder ? folder.name : list.length > 1 ? "tables" : "")
      }
      return zone
    }
    """


class LogView(View):
    """Choose a log, answer what is unsure in its mapping, see it."""

    title = "Log"

    def refresh(self) -> None:
        """Show the choice, the mapping, or the flight."""
        project, shown = self.project, self.body
        step = project.latest("map") if project.needs_mapping else project.latest("info")
        if not project.log:
            shown[:] = self._choice()
        elif step is None:
            shown[:] = [self._head(), parts.button("Read the log", self.act(project.read_log), "primary")]
        elif step.running:
            shown[:] = [self._head(), *self.waiting(step, "reading the log")]
        elif step.state == "failed":
            again = parts.button("Read again", self.act(project.read_log))
            mapping = parts.button("Draft a mapping", self.act(project.draft_mapping))
            shown[:] = [self._head(), parts.html(parts.error(step.error) + parts.command(step)), pn.Row(again, mapping), *self._choice()]
        elif step.kind == "map":
            shown[:] = [self._head(), *self._mapping(step)]
        else:
            shown[:] = [self._head(), *self._flight(step)]

    def _head(self) -> pn.pane.HTML:
        path = self.project.root / self.project.log
        amount = f", {size(path.stat().st_size)}" if path.is_file() else ""
        return parts.html(f"<h2>{parts.escaped(path.name)}</h2><p class='soft'>{parts.escaped(self.project.log)}{amount}</p>")

    def _choice(self) -> list[Any]:
        zone = DropZone(sizing_mode="stretch_width", margin=(8, 0))
        zone.param.watch(lambda e: e.new and self.act(lambda: self.project.open_log(e.new))(), "placed")
        zone.param.watch(lambda e: e.new and self.say(e.new), "failed")
        path = pn.widgets.TextInput(name="or the path of a log on this machine", placeholder="/home/me/flights/log_5.ulg",
                                    sizing_mode="stretch_width", margin=(4, 8, 4, 0))  # fmt: skip

        def opened() -> None:
            if not path.value_input.strip():
                raise StoopError("Write the path of a log, or drop one")
            self.project.open_log(path.value_input.strip())

        path.param.watch(lambda e: self.act(opened)(), "enter_pressed")
        found = [self._offer(p) for p in self._near()]
        near = [parts.html("<p class='soft'>logs in the folder where the app was started</p>"), pn.FlexBox(*found)] if found else []
        return [zone, pn.Row(path, parts.button("Open", self.act(opened), align="end")), *near]

    def _offer(self, path: Path) -> pn.widgets.Button:
        return parts.button(path.name, self.act(lambda: self.project.open_log(path.absolute())))

    def _near(self) -> list[Path]:
        try:
            every = sorted(p for p in Path.cwd().iterdir() if p.name.lower().endswith(ENDINGS) and not p.name.startswith("."))
        except OSError:
            return []
        return every[:MAX_FOUND]

    def _mapping(self, step: Step) -> list[Any]:
        lines = step.file(MAPPING).read_text("utf-8").splitlines()
        asked: dict[int, pn.widgets.TextInput] = {}
        for i, line in enumerate(lines):
            found = UNSURE.match(line)
            if found:
                asked[i] = pn.widgets.TextInput(name=f"unsure: {found['doubt']}", value=found["line"], sizing_mode="stretch_width",
                                                margin=(2, 0))  # fmt: skip
        text = pn.widgets.TextAreaInput(name="the whole draft", value="\n".join(lines), rows=14, sizing_mode="stretch_width",
                                        max_length=1_000_000, stylesheets=["textarea { font-family: ui-monospace, monospace; font-size: 12px }"])  # fmt: skip
        before = text.value

        def taken() -> None:
            if text.value_input and text.value_input != before:  # the whole text was edited
                self.project.take_mapping(text.value_input)
                return
            answers = {i: field.value_input.strip() for i, field in asked.items()}
            kept = [answers.get(i, line) for i, line in enumerate(lines)]
            self.project.take_mapping("\n".join([*kept, ""]))

        lead = (
            "<h2>What the columns mean</h2><p>Nothing in this kind of log says so; this was drafted by names, units and the size of "
            f"the numbers. {len(asked)} lines are unsure: correct them, or empty a line to leave the column out.</p>"
        )
        return [parts.html(lead), *asked.values(), parts.button("Use this mapping", self.act(taken), "primary"), text,
                parts.html(parts.command(step))]  # fmt: skip

    def _flight(self, step: Step) -> list[Any]:
        info, file = self.project.info, step.file(steps.PRODUCTS["info"])
        flight = read_flight(file, file.stat().st_mtime_ns)
        span = f"{info['start']:.1f} to {info['stop']:.1f} s on the log's own clock, {info['rate']:g} Hz grid, {len(info['channels'])} channels"
        faults = [fault["message"] for fault in info["faults"] if "message" in fault]
        plot = Strips(flight)
        plot.mark((w["start"], w["stop"], w["use"] if w["accept"] else "") for w in info["windows"])
        findings = f"<h3>Suspected faults</h3>{parts.bullets(faults)}" if faults else ""
        folded = f"<details><summary>{len(info['notes'])} notes on the log</summary>{parts.bullets(info['notes'])}</details>"
        marked = "<p class='soft'>Marked are candidate maneuvers: blue to fit, orange to predict. Drag to pan, wheel to zoom, click a name to hide it.</p>"
        return [
            parts.html(f"<p>{parts.escaped(span)}</p>"),
            parts.button("Next: the vehicle", lambda: self.go("Vehicle"), "primary"),
            parts.html(findings + folded + marked),
            pn.pane.Bokeh(plot.layout, sizing_mode="stretch_width", margin=0),
            parts.html(self._channels(info) + parts.command(step)),
            pn.Card(*self._choice(), title="Another log", collapsed=True, sizing_mode="stretch_width", margin=(8, 0)),
        ]

    @staticmethod
    def _channels(info: dict[str, Any]) -> str:
        rows = [
            (c["variable"], c["unit"], *(f"{c[k]:.4g}" if c[k] is not None else "-" for k in ("minimum", "median", "maximum")),
             f"{100 * c['missing']:.0f} %" if c["missing"] else "", c["source"], c["meaning"])
            for c in info["channels"]
        ]  # fmt: skip
        heads = ("", "unit", "lowest", "median", "highest", "missing", "source", "meaning")
        return f"<details><summary>all {len(rows)} channels</summary>{parts.table(heads, rows)}</details>"
