"""The columns of the log: what each means, in a table that can be gone back to, and corrections that the log confirms."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any, Final

import pandas as pd
import panel as pn

from stoop.extend.errors import StoopError
from stoop.extend.text import count
from stoop.extend.variables import VARIABLES
from stoop_app import columns, parts
from stoop_app.columns import FIELDS, Row
from stoop_app.folder import BEFORE, MAPPING, ChangedError, version
from stoop_app.places import document_of, reading
from stoop_app.steps import OUTPUT, Step
from stoop_app.view import View

HEADS: Final = {"column": "column", "stream": "of", "variable": "variable", "unit": "unit", "scale": "sign, scale",
                "offset": "offset", "values": "samples (range)", "doubt": "why, and doubts"}  # fmt: skip
WIDTHS: Final = dict(zip(HEADS, (150, 170, 130, 80, 95, 75, 300, 420), strict=True))
PAGE: Final = 200  #: rows of a table that are shown at once
LEAD: Final = (
    "A row for each column of the log. Click a cell to choose the variable that it holds and the unit in which it was recorded; "
    "a negative scale turns the sign. Empty the variable to leave a column out. Corrections compare signs, units and axes with "
    "one another in flight, and change those that contradict the others where the log then agrees."
)
ELSEWHERE: Final = f"{MAPPING} was changed in another tab or editor. Your edits are kept in the table; saving puts them on top."


class ColumnsView(View):
    """Say what the columns mean."""

    title = "Columns"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._shown = ("", "")  #: log and version of the mapping that the table was filled from
        self._rows: list[Row] = []
        self._table: Any = None
        self._text: Any = None
        self._corrections = pn.Column(margin=0, sizing_mode="stretch_width")

    def refresh(self) -> None:
        """Show the table; one with unsaved edits stays as it is."""
        project = self.project
        if not project.log:
            self.body[:] = [
                parts.html("<p>Open a log first.</p>"),
                parts.button("Go to the log", lambda: self.go("Log")),
            ]
            return
        step = project.listing or project.list_columns()
        if step.state != "done":
            self._shown = ("", "")
            again = parts.button("Again", self.act(project.list_columns))
            doing = self.waiting(step, "reading the columns of the log")
            self.body[:] = doing if step.running else [parts.failed(step), again]
            return
        text = project.mapping or step.text(MAPPING)
        now = (step.name, version(text))
        if self._shown[0] == now[0] and self._shown != now and (self.edits or self._text_edited):
            self.say(ELSEWHERE)
        elif self._shown != now:
            self._fill(step, text)
        self._show_corrections()

    @property
    def edits(self) -> list[tuple[Row, dict[str, Any]]]:
        """What was changed in the table and not saved: a row as it was, its new fields."""
        if self._table is None:
            return []
        out = []
        for row, now in zip(self._rows, self._table.value.to_dict("records"), strict=True):
            given = {f: now[f] if f in columns.USUAL else (now[f] or "") for f in FIELDS}
            given |= {f: usual for f, usual in columns.USUAL.items() if pd.isna(given[f])}
            changed = {f: x for f, x in given.items() if x != getattr(row, f)}
            out += [(row, changed)] if changed else []
        return out

    @property
    def _text_edited(self) -> bool:
        return self._text is not None and version(self._text.value) != self._shown[1]

    def _fill(self, step: Step, text: str) -> None:
        self._shown, self._table = (step.name, version(text)), None
        self._text = pn.widgets.TextAreaInput(value=text, **parts.CODE)
        source = parts.card(
            "The mapping as text", parts.button("Save the text", self.act(self._save_text)), self._text
        )
        try:
            with reading(step.file(OUTPUT)):
                self._rows = columns.rows_of(text, document_of(step.folder, OUTPUT)["columns"])
        except StoopError as error:  # a file that was edited elsewhere
            self.body[:] = [parts.html(parts.error(error)), source]
            return
        self._table = self._made_table()
        unsaved = parts.html(margin=(12, 0), sizing_mode=None)

        def told(event: Any) -> None:
            edits = sum(len(fields) for _, fields in self.edits)
            unsaved.object = f"<span class='soft'>{count(edits, 'edit')} not saved</span>" if edits else ""

        self._table.on_edit(told)
        unknown = sum(not row.variable and row.doubt != columns.CLOCK for row in self._rows)
        doubts = sum("unsure" in row.doubt for row in self._rows)
        about = f"{count(len(self._rows), 'row')}, {unknown} without a variable, {doubts} unsure."
        buttons = pn.FlexBox(
            parts.button("Use these columns", self.act(self.save), "primary"),
            parts.button("Apply corrections", self.act(self._correct)),
            parts.button("Discard edits", self.act(lambda: self._fill(step, text))),
            unsaved,
        )
        lead = parts.html(f"<h2>What the columns mean</h2><p>{LEAD}</p>{parts.soft(about)}")
        self.body[:] = [
            lead,
            buttons,
            self._corrections,
            self._table,
            source,
            parts.html(parts.command(step)),
        ]

    def _made_table(self) -> Any:
        frame = pd.DataFrame([{key: getattr(row, key) for key in HEADS} for row in self._rows])
        names = [{"value": name, "label": columns.meaning(name)} for name in VARIABLES]
        find = {"type": "input", "func": "like", "placeholder": "find"}
        many = len(self._rows) > PAGE
        single = len({row.stream for row in self._rows} - {""}) < 2
        filters = dict.fromkeys(("column", "stream", "variable"), find)
        number = {"type": "number"}
        choice = {
            "type": "list",
            "autocomplete": True,
            "listOnEmpty": True,
            "allowEmpty": True,
            "clearable": True,
        }
        editors = {
            **dict.fromkeys(("column", "stream", "values", "doubt")),
            **dict.fromkeys(columns.USUAL, number),
            "variable": {**choice, "values": names},
            "unit": {"type": "nested", "options": columns.units_of(), "lookup_order": ["variable"]},
        }
        table = pn.widgets.Tabulator(
            frame, show_index=False, hidden_columns=["stream"] if single else [], titles=HEADS, widths=WIDTHS,
            layout="fit_data_stretch", sortable=False, editors=editors, text_align=dict.fromkeys(columns.USUAL, "right"),
            sizing_mode="stretch_width", margin=(4, 0), pagination="local" if many else None, page_size=PAGE,
            header_filters=filters if many else None, stylesheets=[parts.style("form.css")],
        )  # fmt: skip
        table.frozen_columns = ["column"]
        return table

    def save(self) -> None:
        """Keep the mapping with the edits, and read the log by it."""
        if not self.edits and self.project.mapping:
            self.say("Nothing was changed", good=True)
            return
        self._keep(self._edited())
        self.go("Log")

    def _edited(self) -> str:
        """Return the mapping with the edits of the table."""
        return columns.edited(self.project.mapping or self._text.value, self.edits)

    def _save_text(self) -> None:
        columns.parsed(self._text.value)
        self._keep(self._text.value)
        self.go("Log")

    def _keep(self, text: str) -> None:
        try:
            self.project.save_mapping(text, self._shown[1])
        except ChangedError:
            self._shown = (self._shown[0], version(self.project.mapping))  # saving again is then a decision
            raise
        self._table = self._text = None
        self.refresh()

    def _correct(self) -> None:
        if self.edits or not self.project.mapping:
            self._keep(self._edited())
        self.project.correct_mapping()

    def _show_corrections(self) -> None:
        """Show what the last corrections changed, as long as the mapping is what they made of it."""
        step = self.project.corrections
        shown: list[Any] = []
        if step is not None and step.running:
            shown = self.waiting(step, "comparing the columns with one another")
        elif step is not None and step.state == "failed":
            shown = [parts.failed(step)]
        elif step is not None and step.text(MAPPING) == self.project.mapping:
            shown = self._corrected(step)
        self._corrections[:] = shown

    def _corrected(self, step: Step) -> list[Any]:
        before, after = step.text(BEFORE), step.text(MAPPING)
        with reading(step.file(OUTPUT)):
            found: Mapping[str, Any] = document_of(step.folder, OUTPUT)
            said = parts.note(found["said"][0]) + parts.bullets(found["said"][1:])
        lines = difflib.ndiff(before.splitlines(), after.splitlines())
        changed = "\n".join(line for line in lines if line.startswith(("- ", "+ ")))
        shown: list[Any] = [parts.html(said + (f"<pre>{parts.escaped(changed)}</pre>" if changed else ""))]
        if changed:
            shown.append(
                parts.button("Undo the corrections", self.act(lambda: self.project.take_mapping(before)))
            )
        return [*shown, parts.html(parts.command(step))]
