"""The fits: several side by side, each with its progress, its report, and what its notices suggest to change."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final

import panel as pn

from stoop import read_result
from stoop.extend.fits import DECISIONS, Result, methods
from stoop.extend.text import number
from stoop.extend.verbs import Option, verbs
from stoop_app import numbers, parts
from stoop_app.folder import PROGRESS, VEHICLE, Project, modified
from stoop_app.places import document_of, reading
from stoop_app.plots import drawn_costs, drawn_curves
from stoop_app.steps import COMMAND, Step
from stoop_app.view import View

MAX_CHIPS: Final = 12  #: of one kind
USUAL: Final = "chosen by the data"
RUNNING: Final = "Stop keeps the best so far. The run goes on when this page or the app is closed. Grey is measured, blue fitted."


@lru_cache(maxsize=16)
def result_of(path: Path, changed: int) -> Result:
    """Return a result; `changed` is the file's time."""
    return read_result(path)


def result(step: Step) -> Result:
    """Return the result of a run that is done."""
    file = step.file("result.json")
    return result_of(file, file.stat().st_mtime_ns)


def finished(project: Project) -> dict[str, Step]:
    """Return the runs that have a result, by name."""
    return {s.name: s for s in project.steps("runs") if s.state == "done"}


def describe(found: Result) -> str:
    """Return a result in a few words."""
    windows = sum(m.role == "fit" for m in found.maneuvers)
    return f"{len(found.parameters)} parameters, {windows} windows, {found.method}, {found.status}"


class FitView(View):
    """Run, watch, stop, read, change."""

    title = "Fit"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._chosen = ""  #: name of the run that is shown
        self._known: list[str] = []
        self._seen: Any = None
        self._curves = parts.html()
        self._clock = parts.html()
        self._told = ""  #: what the run does
        self._values = parts.html()
        self._head = pn.Column(margin=0, sizing_mode="stretch_width")
        self._stage = pn.Column(**parts.FILLING)
        self._detail: tuple[str, str] = ("", "")
        self._method = pn.widgets.Select(
            label="method",
            options=[USUAL, *methods.names()],
            width=190,
            margin=(0, 8, 4, 0),
            description=parts.spoken(Option.plain(verbs()["identify"].option("method").meaning)),
        )
        self._decisions = {
            one.name: pn.widgets.Checkbox(
                label=f"{one.name}: {one.question}", value=one.default, margin=(0, 12, 0, 0)
            )
            for one in DECISIONS
        }
        self._why = parts.html()
        self._start = parts.button("Run the fit", self.act(self._run), "primary", align="end")
        self.body[:] = [
            pn.FlexBox(self._method, self._start, align_items="flex-end"),
            parts.card("Decisions of the fit", pn.Column(*self._decisions.values(), margin=0)),
            self._why,
            self._head,
            self._stage,
        ]

    def refresh(self) -> None:
        """Show the runs, and the one that is chosen; a new run is chosen when it begins."""
        lacking = self.project.lacking
        self._start.disabled, self._why.object = bool(lacking), parts.soft(lacking)
        runs = self.project.steps("runs")
        names = [s.name for s in runs]
        fresh = [name for name in names if name not in self._known]
        self._known = names
        if fresh or self._chosen not in names:
            self._chosen = names[-1] if names else ""
        self._show_runs(runs)

    def _show_runs(self, runs: list[Step]) -> None:
        self._head[:] = [pn.FlexBox(*(self._choice(s) for s in runs))] if runs else []
        step = next((s for s in runs if s.name == self._chosen), None)
        if step is None:
            self._detail = ("", "")
            text = "No fit was run yet. It takes the vehicle and the windows as they are, and keeps copies of both."
            self._stage[:] = [parts.html(f"<p class='soft'>{text}</p>")]
        elif self._detail != (step.name, step.state):
            self._detail = (step.name, step.state)
            show = {"running": self._running, "done": self._done, "failed": self._failed}
            self._stage[:] = show[step.state](step)

    def _choice(self, step: Step) -> pn.widgets.Button:
        def chosen() -> None:
            self._chosen = step.name
            self._show_runs(self.project.steps("runs"))

        name = f"{step.name} · {parts.STATES[step.state]}"
        return parts.button(
            name, chosen, "primary" if step.name == self._chosen else "default", button_style="outline"
        )

    def tick(self) -> None:
        """Show the progress of the run that is shown."""
        if self._detail[1] != "running":
            return
        folder = self.project.root / self._chosen
        seconds = max(time.time() - 1e-9 * modified(folder / COMMAND), 0.0)
        self._clock.object = f"<p><b>{parts.escaped(self._told)} · {seconds:.0f} s</b></p>"
        changed = modified(folder / PROGRESS)
        if (self._chosen, changed) == self._seen:
            return
        self._seen = (self._chosen, changed)
        with reading(folder / PROGRESS):
            progress = document_of(folder, PROGRESS)
            if progress:
                self._show_progress(progress)

    def _show_progress(self, progress: Mapping[str, Any]) -> None:
        known = progress.get("cost") is not None and "cost" not in progress["work"]
        self._told = " · ".join([progress["work"], *([f"cost {progress['cost']:g}"] if known else [])])
        rows = [
            (n, number(p["value"]), p["unit"] if p["unit"] != "1" else "")
            for n, p in progress.get("parameters", {}).items()
        ]
        shown = parts.table(("", "now", "unit"), rows)
        self._values.object = parts.fold(f"{len(rows)} parameters", shown, is_open=True) if rows else ""
        self._curves.object = drawn_costs(progress["costs"]) + drawn_curves(progress.get("curves", ()))

    def _running(self, step: Step) -> list[Any]:
        self._seen = None
        self._told, self._curves.object, self._values.object = "reading", "", ""
        stop = parts.button("Stop", self.act(step.stop))
        lead = [self._clock, parts.html(parts.BAR), stop, parts.html(parts.soft(RUNNING))]
        return [*lead, self._curves, self._values, parts.html(parts.command(step))]

    def _failed(self, step: Step) -> list[Any]:
        return [parts.html(parts.error(step.error) + parts.printed(step.output) + parts.command(step))]

    def _done(self, step: Step) -> list[Any]:
        found = result(step)
        about = parts.soft(f"{describe(found)}, {found.seconds:.0f} s")
        head = f"<h2>{parts.escaped(found.verdict.headline)}</h2>{about}"
        onward = pn.FlexBox(
            parts.button("Begin from these estimates", self.act(lambda: self._continue(step))),
            parts.button("Export or design", lambda: self.go("Use")),
            parts.button("Judge the autopilot's gains", lambda: self.go("Gains")),
        )
        changes = self._suggestions(found)
        rest = pn.Column(
            *changes, onward, parts.html(parts.command(step)), margin=(8, 0), sizing_mode="stretch_width"
        )
        report = parts.framed(f"{step.name}/report.html", f"report of {step.name}")
        return [parts.html(head), pn.Tabs(("Report", report), ("What to do next", rest), **parts.FILLING)]

    def _suggestions(self, found: Result) -> list[Any]:
        """Return buttons that fix what the data do not tell, and free or add what they ask for."""
        doubtful = [name for name, p in found.parameters.items() if not p.identifiable or p.at_bound]
        standing = found.extensions.standing
        lacking = [test.name for test in standing if test.kind not in ("number", "gain")]
        contradicted = [test.name for test in standing if test.kind in ("number", "gain")]
        out: list[Any] = []
        for what, names, free in (
            ("at a bound or not identifiable: fix at the value of the file", doubtful, False),
            ("the model lacks, by the data: free", lacking, True),
            ("contradicted by the data: measure again, or free", contradicted, True),
        ):
            if names:
                chips = pn.FlexBox(margin=0)
                for i, name in enumerate(names[:MAX_CHIPS]):
                    act = self.act(partial(self._change, free, name, chips, i))
                    chips.append(parts.button(name, act, button_style="outline"))
                out += [parts.html(parts.soft(what)), chips]
        return out

    def _change(self, free: bool, name: str, chips: Any, i: int) -> None:
        """Free a number, or fix it."""
        text = self.project.vehicle
        text = numbers.freed(text, name) if free else numbers.edited(text, {name: {"free": False}})
        self.project.save_vehicle(text, None)
        done = f"{name} is {'free' if free else 'fixed'}"
        self.say(f"{done} in {VEHICLE}; run the fit again to see what it changes", good=True)
        chips[i].disabled = True

    def _continue(self, step: Step) -> None:
        self.project.take_vehicle(step.text(VEHICLE))
        self.say(
            f"The estimates of {step.name} stand in {VEHICLE}; the file before is kept beside it", good=True
        )

    def _run(self) -> None:
        method = [] if self._method.value == USUAL else ["--method", str(self._method.value)]
        self.project.identify(
            [*method, *switches({n: bool(box.value) for n, box in self._decisions.items()})]
        )


def switches(chosen: Mapping[str, bool]) -> list[str]:
    """Return the options of ``stoop identify`` with which a fit takes the chosen decisions."""
    if not any(chosen.values()):
        return ["--textbook"]
    off = [one.name for one in DECISIONS if one.default and not chosen[one.name]]
    extended = ["--extend"] if chosen["extensions"] else []
    return [*extended, *(word for name in off for word in ("--without", name))]
