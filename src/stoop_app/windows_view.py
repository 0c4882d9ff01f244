"""The windows: proposed by their information, or brushed on the flight; to fit, to predict, or not used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import panel as pn
from pydantic import ValidationError

from stoop.extend.errors import StoopError
from stoop_app import parts, steps
from stoop_app.folder import WINDOWS
from stoop_app.places import text_of
from stoop_app.plots import Strips, read_flight
from stoop_app.view import View
from stoop_plan.input_design.windows_file import Entry

#: as shown -> as in the file; empty: not accepted
USES: Final = {"fit": "fit", "predict": "validate", "not used": ""}
HINT: Final = "Drag across the strips to brush a window; Ctrl and the wheel zoom. Blue is fitted, orange predicted, grey unused."
WHY: Final = "why these windows, and what to expect of them"
BRUSHED: Final = "brushed"  #: why such a window is there


class WindowsView(View):
    """Choose what is fitted and what is predicted."""

    title = "Windows"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._plot: Strips | None = None
        self._plotted: Any = None
        self._pane: Any = None
        self._new = pn.FlexBox(margin=0)
        self._above = pn.Column(margin=0, sizing_mode="stretch_width")
        self._hint = parts.html(parts.soft(HINT))

    def refresh(self) -> None:
        """Show the flight, the windows on it, and what may be done with them."""
        project, info = self.project, self.project.info
        if not info:
            lead = "Open a log first" if not project.log else "The log is not read yet"
            self.body[:] = [
                parts.html(f"<p>{lead}.</p>"),
                parts.button("Go to the log", lambda: self.go("Log")),
            ]
            return
        step = project.flight
        file = step.file(steps.PRODUCTS["info"]) if step is not None else None
        if file is not None and self._plotted != (file, file.stat().st_mtime_ns):
            self._plotted = (file, file.stat().st_mtime_ns)
            self._plot = Strips(read_flight(*self._plotted), self._brushed)
            self._pane = self._plot.panel
        entries = project.windows
        self._mark()
        rows = [self._row(e) for e in entries]
        lacking = project.lacking
        run = parts.button("Run the fit", self.act(self._run), "primary", disabled=bool(lacking))
        why = parts.soft(lacking)
        head = pn.FlexBox(run, parts.button("Propose windows", self.act(self._propose)))
        table = [pn.Column(*rows, margin=(8, 0), sizing_mode="stretch_width")] if rows else []
        self._above[:] = [head, parts.html(why), *self._proposals(), *table]
        shown = [self._above, self._new, self._hint, self._pane]
        if self.body.objects != shown:  # figures stay where they are while what is above them changes
            self.body[:] = shown

    def _mark(self, *pending: tuple[float, float, str]) -> None:
        """Mark the windows on the plot, and one whose use is not chosen yet."""
        if self._plot is not None:
            known = [(e.start, e.stop, e.use if e.accept else "") for e in self.project.windows]
            self._plot.mark([*known, *pending])

    def _proposals(self) -> list[Any]:
        step = self.project.latest("maneuvers")
        if step is None:
            return []
        if step.running:
            return self.waiting(step, "choosing windows by their information about the free numbers")
        if step.state == "failed":
            return [parts.failed(step)]
        page = parts.html(parts.opened(f"{step.name}/windows.html", WHY))
        if step.text(WINDOWS) == text_of(self.project.root, WINDOWS):
            return [page]
        note = parts.html(parts.note(f"{step.name} proposes other windows than those below"))
        take = parts.button("Take the proposal", self.act(lambda: self.project.take_proposal(step)))
        return [note, take, page]

    def _row(self, entry: Entry) -> Any:
        shown = next(name for name, use in USES.items() if use == (entry.use if entry.accept else ""))
        use = pn.widgets.Select(options=list(USES), value=shown, width=115, margin=(2, 8, 2, 0))
        use.param.watch(
            lambda e: self._change(entry, accept=bool(USES[e.new]), use=USES[e.new] or "fit"), "value"
        )
        ends = []
        for key, value in (("start", entry.start), ("stop", entry.stop)):
            field = pn.widgets.FloatInput(
                value=value, step=0.1, width=100, margin=(2, 6, 2, 0), format="0[.]000"
            )
            field.param.watch(lambda e, key=key: self._change(entry, **{key: e.new}), "value")
            ends.append(field)
        remove = parts.button("Remove", lambda: self._replace(entry, None), margin=(2, 8, 2, 0))
        loading = f"loading {entry.loading}" if entry.loading else ""
        why = " · ".join(filter(None, (entry.axis, entry.why, loading)))
        text = parts.html(
            f"<span class='soft'>{parts.escaped(why)}</span>",
            margin=(7, 0),
            styles={"flex": "1 1 280px"},
            sizing_mode=None,
        )
        return pn.FlexBox(*ends, use, remove, text, sizing_mode="stretch_width", margin=0)

    def _change(self, entry: Entry, **fields: Any) -> None:
        def changed() -> None:
            if any(value is None for value in fields.values()):
                raise StoopError("Write a time in seconds")
            try:
                by = Entry.model_validate({**entry.model_dump(), **fields})
            except ValidationError as error:
                self.refresh()  # the field shows what the file has
                raise StoopError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None
            self._replace(entry, by)

        self.act(changed)()

    def _replace(self, entry: Entry, by: Entry | None) -> None:
        """Put a window in the place of one, or nothing; other windows are as the file has them now."""

        def done() -> None:
            if entry not in self.project.windows:
                self.refresh()
                raise StoopError(
                    "This window was changed in another tab or editor, and is shown as it is now"
                )
            others = [e for e in self.project.windows if e != entry]
            self.project.save_windows(others if by is None else [*others, by])

        self.act(done)()

    def _brushed(self, start: float, stop: float) -> None:
        """Ask what the brushed window is for."""
        start, stop = round(start, 2), round(stop, 2)
        if not start < stop:
            return
        self._mark((start, stop, ""))

        def add(use: str) -> Callable[[], None]:
            def added() -> None:
                window = Entry(flight=self.project.flight_name, start=start, stop=stop, use=use, why=BRUSHED)  # type: ignore[arg-type]
                self._new[:] = []
                self.project.save_windows([*self.project.windows, window])

            return self.act(added)

        text = parts.html(
            f"<b>{start:g} to {stop:g} s</b> ({stop - start:.2f} s)",
            sizing_mode="fixed",
            width=220,
            margin=(9, 0),
        )
        fit, predict = parts.button("Fit", add("fit"), "primary"), parts.button("Predict", add("validate"))
        self._new[:] = [text, fit, predict, parts.button("Discard", self._discard)]

    def _discard(self) -> None:
        self._new[:] = []
        self._mark()

    def _propose(self) -> None:
        if not self.project.vehicle:
            raise StoopError(
                "Choose a vehicle first: windows are proposed by how well they determine its free numbers"
            )
        self.project.propose_windows()

    def _run(self) -> None:
        self.project.identify()
        self.go("Fit")
