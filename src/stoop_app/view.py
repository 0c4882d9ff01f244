"""What the views of the page share."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final

import panel as pn

from stoop.extend.errors import StoopError
from stoop_app import parts
from stoop_app.folder import Project
from stoop_app.steps import Step

BUG: Final = (
    "this is a bug in stoop: please report it with what the terminal shows, where stoop app was started"
)


class View(ABC):
    """One step of the work on the page; it shows what the folder holds, and never knows more than that."""

    title: ClassVar[str]

    def __init__(self, project: Project, go: Callable[[str], None]) -> None:
        """Make an empty view; `go` shows another, by its title."""
        self.project, self.go = project, go
        self.said = parts.html()
        self.said.jscallback(text="if (cb_obj.text) window.scrollTo({ top: 0, behavior: 'smooth' })")
        self.body = pn.Column(**parts.FILLING)
        self.panel = pn.Column(self.said, self.body, **parts.FILLING)

    @abstractmethod
    def refresh(self) -> None:
        """Show the folder as it is now."""

    def tick(self) -> None:  # noqa: B027 (most views have nothing that moves)
        """Show how far running steps are."""

    def say(self, text: object = "", good: bool = False) -> None:
        """Say what went wrong, or was done, above the view."""
        self.said.object = (parts.note(text) if good else parts.error(text)) if text else ""

    def act(self, what: Callable[[], object]) -> Callable[[], None]:
        """Return an action that says what went wrong, and loses nothing."""

        def done() -> None:
            self.say()
            try:
                what()
            except StoopError as error:
                self.say(error)
            except OSError as error:
                self.say(f"{error.filename or 'the folder'}: {error.strerror or error}")
            except Exception:
                logging.getLogger("stoop_app").exception(self.title)
                self.say(BUG)

        return done

    def waiting(self, step: Step, doing: str, stop: str = "Stop") -> list[object]:
        """Return what is shown while a step goes on."""
        return [parts.html(parts.busy(step, doing)), parts.button(stop, self.act(step.stop))]
