"""The vehicle: a built-in one, a file, or a draft from a few numbers; then its numbers in a form, and its equations."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd
import panel as pn

from stoop import load_vehicle
from stoop.extend.errors import StoopError
from stoop.extend.reports import sheet
from stoop.extend.text import count
from stoop.extend.vehicles import BUILT_IN, parse_vehicle
from stoop.extend.verbs import verbs
from stoop_app import numbers, parts
from stoop_app.folder import VEHICLE, ChangedError, modified, version
from stoop_app.numbers import WHERE, Row
from stoop_app.steps import COMMAND
from stoop_app.view import View
from stoop_draft.vehicle_draft.power import ENGINES
from stoop_draft.vehicle_draft.request import TEMPLATES

BY_LOG: Final = "by the log"
ELSEWHERE: Final = (
    "The file was changed in another tab or editor. Your edits are kept in the form; saving puts them on top."
)
HEADS: Final = {"name": "number", "value": "value", "unit": "unit", "free": "free", "prior": "prior ±", "low": "lower",
                "high": "upper", "help": "what it is"}  # fmt: skip
WIDTHS: Final = dict(zip(HEADS, (165, 84, 60, 48, 80, 100, 100, 420), strict=True))


class VehicleView(View):
    """Get or make a vehicle, and edit its numbers."""

    title = "Vehicle"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._shown = ""  #: version of the file that the form was filled from
        self._before: list[Row] = []
        self._form: Any = None
        self._text: Any = None
        self._choose: Any = None
        self._checks, self._below = (pn.Column(margin=0, sizing_mode="stretch_width") for _ in range(2))

    def refresh(self) -> None:
        """Show the choice, or the vehicle; a form with unsaved edits stays as it is."""
        text = self.project.vehicle
        if not text:
            self._shown = ""
            draft = self.project.latest("drafts")
            if self._choose is None:
                self._choose = self._choice()
            begun = [] if draft is None else [self._draft(draft)]
            if self.body.objects[-1:] != [self._choose] or begun:
                self.body[:] = [parts.html("<h2>Which vehicle flew?</h2>"), *begun, self._choose]
            return
        if self._shown and self._shown != version(text) and (self.edits or self._text_edited):
            self.say(ELSEWHERE)
        elif self._shown != version(text):
            self._fill(text)
        self._show_checks()

    @property
    def edits(self) -> dict[str, dict[str, Any]]:
        """What was changed in the form and not saved: number -> field -> value."""
        if self._form is None:
            return {}
        out: dict[str, dict[str, Any]] = {}
        for before, now in zip(self._before, self._form.value.to_dict("records"), strict=True):
            for field in numbers.FIELDS:
                old, new = getattr(before, field), now[field]
                if field == "free":
                    new = bool(new)
                else:
                    new = None if new is None or new == "" or math.isnan(float(new)) else float(new)
                    old = None if old is None or not math.isfinite(old) else old
                if new != old:
                    out.setdefault(before.name, {})[field] = new
        return out

    @property
    def _text_edited(self) -> bool:
        return (
            self._text is not None
            and self._text.value != self.project.vehicle
            and version(self._text.value) != self._shown
        )

    def take(self, text: str) -> None:
        """Use a vehicle; its numbers are shown before the work goes on."""
        vehicle = parse_vehicle(text, WHERE)
        self.project.take_vehicle(vehicle.text)
        self.say(f"{vehicle.name} is now {VEHICLE}: look at its numbers, then go on", good=True)

    # Where there is none.

    def _choice(self) -> Any:
        path = pn.widgets.TextInput(label="path of a vehicle file on this machine", placeholder="/home/me/vtail.toml",
                                    sizing_mode="stretch_width", margin=(4, 8, 4, 0))  # fmt: skip

        def opened() -> None:
            if not path.value.strip():
                raise StoopError("Write the path of a vehicle file, or choose one below")
            self.take(load_vehicle(Path(path.value.strip()).expanduser()).text)

        path.param.watch(lambda e: self.act(opened)(), "enter_pressed")
        sent = pn.widgets.FileInput(accept=".toml", multiple=False, margin=(4, 0))
        sent.param.watch(
            lambda e: self.act(lambda: self.take(e.new.decode("utf-8", "replace")))() if e.new else None,
            "value",
        )
        built = [
            pn.Row(
                parts.button(
                    name, self.act(partial(lambda n: self.take(load_vehicle(n).text), name)), width=110
                ),
                parts.html(parts.escaped(load_vehicle(name).name), margin=(8, 0)),
            )
            for name in BUILT_IN
        ]
        return pn.Column(
            parts.html("<h3>A file</h3>"),
            pn.Row(path, parts.button("Use", self.act(opened), "primary", align="end")),
            parts.html("<p class='soft'>or one that the browser sends</p>"), sent,
            parts.html("<h3>A draft from a few numbers</h3>"), self._request(),
            parts.html("<h3>A vehicle that comes with stoop</h3>"), *built,
            sizing_mode="stretch_width", margin=0,
        )  # fmt: skip

    def _request(self) -> Any:
        """Return the form of `stoop vehicle new`."""
        kind = pn.widgets.Select(label="kind", options=[BY_LOG, *TEMPLATES], width=150)
        engine = pn.widgets.Select(label="engine", options=[BY_LOG, *ENGINES], width=120)
        new = verbs()["vehicle new"]
        fields = {
            key: parts.field(new.option(key), width=150, step=0.01)
            for key in ("mass", "span", "chord", "area")
        }

        def drafted() -> None:
            words = ["vehicle", "new", *(self.project.source if self.project.log else [])]
            for key, one in {"template": kind, "engine": engine, **fields}.items():
                words += parts.given(new.option(key), None if one.value == BY_LOG else one.value)
            self.project.start("drafts", lambda at: [*words, "-o", f"{at}/{VEHICLE}"])
            self.say("The draft is shown below as soon as it is made", good=True)

        help_text = "<p class='soft'>Of a multirotor the span is the largest distance between motors; it has no chord.</p>"
        return pn.Column(pn.FlexBox(kind, *fields.values(), engine), parts.html(help_text),
                         parts.button("Draft", self.act(drafted)), sizing_mode="stretch_width", margin=0)  # fmt: skip

    def _draft(self, step: Any) -> Any:
        if step.running:
            return pn.Column(*self.waiting(step, "drafting the vehicle from the log and the numbers"))
        if step.state == "failed":
            return parts.failed(step)
        text = step.text(VEHICLE)
        shown = f"<div class='note'><pre>{parts.escaped(parts.spoken(step.findings))}</pre></div>{parts.command(step)}"
        return pn.Column(
            parts.html(shown), parts.button("Use this draft", self.act(lambda: self.take(text)), "primary")
        )

    # Where there is one.

    def _fill(self, text: str) -> None:
        self._shown = version(text)
        try:
            vehicle = parse_vehicle(text, WHERE)
        except StoopError as error:  # a file that was edited elsewhere
            self.body[:] = [parts.html(parts.error(error)), self._text_editor(text)]
            return
        self._before = numbers.rows_of(vehicle)
        frame = pd.DataFrame([{"part": r.group, **{k: getattr(r, k) for k in HEADS}} for r in self._before])
        for column in ("prior", "low", "high"):
            frame[column] = [
                v if v is not None and math.isfinite(v) else None for v in frame[column].astype(object)
            ]
        number = {"type": "number"}
        self._form = pn.widgets.Tabulator(
            frame, groupby=["part"], hidden_columns=["part"], show_index=False, titles=HEADS, widths=WIDTHS,
            layout="fit_data_stretch",
            editors={"name": None, "unit": None, "help": None, "value": number, "prior": number, "low": number, "high": number,
                     "free": {"type": "tickCross"}},
            formatters={"free": {"type": "tickCross", "crossElement": False}}, text_align={"value": "right", "prior": "right",
                     "low": "right", "high": "right", "free": "center"},
            sortable=False, sizing_mode="stretch_width", margin=(4, 0), stylesheets=[parts.style("form.css")],
        )  # fmt: skip
        self._form.frozen_columns = ["name"]
        unsaved = parts.html(margin=(12, 0))

        def told(event: Any) -> None:
            edits = sum(map(len, self.edits.values()))
            unsaved.object = f"<span class='soft'>{count(edits, 'edit')} not saved</span>" if edits else ""

        self._form.on_edit(told)
        free = len(vehicle.free_parameters)  # as reports count: biases of sensors are of a window
        biases = sum(r.free for r in self._before) - free
        anew = f", and {count(biases, 'bias', 'biases')} of sensors anew for each window" if biases else ""
        lead = (
            f"<h2>{parts.escaped(vehicle.name)}</h2>"
            f"<p>{len(self._before)} numbers, SI units and radians. A fit estimates {free} free parameters of the vehicle{anew}. "
            "Click a cell to edit it, the tick to free or fix a number.</p>"
        )
        rest = [
            parts.card("The file as text", self._text_editor(text)),
            parts.card("Another vehicle", self._choice()),
        ]
        buttons = pn.FlexBox(
            parts.button("Save", self.act(self.save), "primary"),
            parts.button("Discard edits", self.act(self._discard)),
            parts.button(
                "Check by trim", self.act(lambda: self.project.start("trims", lambda at: ["trim", VEHICLE]))
            ),
            parts.button("Next: the windows", self.act(self._onward)),
            unsaved,
        )
        self.body[:] = [parts.html(lead), buttons, self._checks, self._form, self._below, *rest]

    def _text_editor(self, text: str) -> Any:
        self._text = pn.widgets.TextAreaInput(value=text, **parts.CODE)

        def saved() -> None:
            self._keep(parse_vehicle(self._text.value, WHERE).text)

        return pn.Column(
            parts.button("Save the text", self.act(saved)), self._text, sizing_mode="stretch_width"
        )

    def _discard(self) -> None:
        self._fill(self.project.vehicle)
        self.say("The form shows the file again", good=True)

    def save(self) -> None:
        """Write the edits into the file, unless it was changed meanwhile: then say so, once."""
        edits = self.edits
        if not edits:
            self.say("Nothing was changed", good=True)
            return
        self._keep(numbers.edited(self.project.vehicle, edits))

    def _keep(self, text: str) -> None:
        try:
            self.project.save_vehicle(text, self._shown)
        except ChangedError:
            self._shown = version(self.project.vehicle)  # saving again is then a decision
            raise
        self._fill(text)
        self.say(f"{VEHICLE} is saved", good=True)

    def _onward(self) -> None:
        if self.edits:
            self.save()
        if self.project.info and not self.project.windows and self.project.latest("maneuvers") is None:
            self.project.propose_windows()
        self.go("Windows")

    def _show_checks(self) -> None:
        """Show the trim above the numbers, and the equations below them."""
        shown: list[Any] = []
        below: list[Any] = []
        draft = self.project.latest("drafts")
        if draft is not None and modified(draft.file(COMMAND)) > modified(self.project.root / VEHICLE):
            shown.append(self._draft(draft))
        trim, written = self.project.latest("trims"), self._equations()
        if trim is not None and modified(trim.file(COMMAND)) > modified(self.project.root / VEHICLE):
            done = (
                parts.error(trim.error)
                or f"<details open><summary>trim</summary><pre>{parts.escaped(trim.findings)}</pre></details>"
            )
            busy = parts.busy(trim, "looking for a steady flight")
            shown.append(parts.html(busy if trim.running else done + parts.command(trim)))
        if written is not None and written.running:
            below = [parts.html(parts.busy(written, "writing the equations"))]
        elif written is not None:
            lines = "".join(map(str, (sheet.mathml(line, "block") for line in written.output.splitlines())))
            box = f"<div class='scroll equations' tabindex='0'><div>{lines}</div></div>"
            below = [parts.html(f"<h3>Equations</h3>{parts.error(written.error) or box}")]
        self._checks[:], self._below[:] = shown, below

    def _equations(self) -> Any:
        """Return the step that writes the equations of the file as it is; it is begun if there is none."""
        try:
            wanted = parse_vehicle(self.project.vehicle, WHERE).structure
            last = self.project.latest("equations")
            if last is None or parse_vehicle(last.text("start.toml"), WHERE).structure != wanted:
                inputs = {"start.toml": self.project.vehicle}
                last = self.project.start(
                    "equations", lambda at: ["vehicle", f"{at}/start.toml", "--equations"], inputs
                )
        except StoopError:
            return None
        return last
