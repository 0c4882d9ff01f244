"""The page: a bar of steps above, below it the step that is shown; one page a browser tab, all of one folder."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Final

import panel as pn

from stoop.extend.errors import StoopError
from stoop_app import parts
from stoop_app.columns_view import ColumnsView
from stoop_app.compare_view import CompareView
from stoop_app.fit_view import FitView
from stoop_app.fleet_view import FleetView
from stoop_app.folder import Project
from stoop_app.gains_view import GainsView
from stoop_app.log_view import LogView
from stoop_app.places import MAX_BYTES, tail_of
from stoop_app.steps import COMMANDS
from stoop_app.use_view import UseView
from stoop_app.vehicle_view import VehicleView
from stoop_app.view import BUG, View
from stoop_app.windows_view import WindowsView

ENDED: Final = "The app has ended or cannot be reached. Runs go on; start it again with the same command."
PERIOD: Final = 500  #: ms between two looks at the folder
VIEWS: Final = (
    LogView, ColumnsView, VehicleView, WindowsView, FitView, CompareView, UseView, GainsView, FleetView,
)  # fmt: skip


class Page:
    """One browser tab."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.views: dict[str, View] = {kind.title: kind(project, self.go) for kind in VIEWS}
        self.buttons = {
            title: parts.button(f"{i} {title}", partial(self.go, title), css_classes=["step"])
            for i, title in enumerate(self.views, 1)
        }
        self.shown = ""
        self._signature: Any = None
        self._stale: set[str] = set()
        self.stage = pn.Column(**parts.FILLING)
        self.trouble = parts.html()  #: what is wrong with the folder itself
        self.commands = parts.html(margin=(24, 0, 8, 0))
        head = f"<header><h1>stoop</h1><span class='soft'>{parts.escaped(project.root)}</span></header>"
        bar = pn.FlexBox(*self.buttons.values(), sizing_mode="stretch_width", margin=(6, 0))
        self.panel = pn.Column(
            parts.html(head),
            bar,
            self.trouble,
            self.stage,
            self.commands,
            sizing_mode="stretch_both",
            styles={"height": "auto", "min-height": "calc(100vh - 24px)"},
            margin=(12, 20),
            max_width=1400,
        )
        self.tick()
        self.go(self.start)

    @property
    def start(self) -> str:
        """The step to begin with: the last that has something to show."""
        project = self.project
        with suppress(StoopError):  # the view says it
            if project.steps("runs"):
                return "Fit"
            if project.steps("fleets") and not project.log:
                return "Fleet"
            if project.vehicle and project.info:
                return "Windows"
        return "Log"

    def go(self, title: str) -> None:
        """Show a step."""
        self.shown = title
        for name, one in self.buttons.items():
            one.button_type = "primary" if name == title else "default"
        if title in self._stale:
            self._refresh(title)
        self.stage[:] = [self.views[title].panel]

    def tick(self) -> None:
        """Show what has changed in the folder."""
        self.trouble.object = self._guarded("Log", self.project.tend)
        signature = self.project.signature
        if signature != self._signature:
            self._signature = signature
            self._stale = set(self.views)
            if self.shown:
                self._refresh(self.shown)
            self.commands.object = self._all_commands()
        elif self.shown:  # what was just put on the page is changed at the next look: a browser takes one step after the other
            said = self._guarded(self.shown, self.views[self.shown].tick)
            self.trouble.object = said or self.trouble.object

    def _refresh(self, title: str) -> None:
        self._stale.discard(title)
        view = self.views[title]
        if said := self._guarded(title, view.refresh):
            view.body[:] = [parts.html(said)]

    def _guarded(self, title: str, what: Callable[[], object]) -> str:
        """Read the folder; return in one line why that failed, such as a file that was edited; empty where it did not."""
        try:
            what()
        except (StoopError, OSError) as error:
            return parts.error(error)
        except Exception:
            logging.getLogger("stoop_app").exception(title)
            return parts.error(BUG)
        return ""

    def _all_commands(self) -> str:
        text = tail_of(self.project.root, COMMANDS, MAX_BYTES)
        if not text:
            return ""
        folder = parts.escaped(self.project.root)
        lead = f"<p class='soft'>In {folder}, where {COMMANDS} holds them too:</p>"
        return f"<details><summary>all commands of this folder</summary>{lead}<pre>{parts.escaped(text)}</pre></details>"


def page_of(project: Project) -> Callable[[], Any]:
    """Return what makes the page of a browser tab."""
    pn.extension(
        "tabulator",
        raw_css=[parts.style("style.css")],
        inline=False,
        notifications=True,
        loading_color="#1f5fa8",
        disconnect_notification=ENDED,
    )
    for kind in (pn.widgets.Button, pn.widgets.Select):
        kind.stylesheets = [parts.style("widgets.css")]

    def made() -> Any:
        page = Page(project)
        # a browser that is still loading the page loses what is changed in it meanwhile
        pn.state.onload(partial(pn.state.add_periodic_callback, page.tick, PERIOD))
        return page.panel

    return made
