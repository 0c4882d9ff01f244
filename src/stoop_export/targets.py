"""The table of the targets of ``stoop export``, which command line, Python, app and documentation read.

A new target is a module with a subclass of `stoop_export.exporter.Exporter`, a row of ``targets`` in ``stoop.toml``, and its row
in ``docs/export.md``; packages add theirs to their files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import StoopError
from stoop.extend.text import nearest
from stoop.extend.verbs import guarded, made

if TYPE_CHECKING:
    from stoop_analysis.known_model import Condition
    from stoop_export.exporter import Exported, Exporter, ModelData


@dataclass(frozen=True)
class Target:
    """A row of the table."""

    title: str  #: the tool, as the app and the documentation name it
    exporter: str  #: place ``module:class`` of what writes its files; imported when the target is chosen

    def load(self) -> Any:
        """Return what writes its files."""
        from stoop_export.exporter import Exporter

        return guarded(self.exporter, Exporter)


TARGETS: Final = made("targets", Target)


def export(model: ModelData, target: str, condition: Condition | None = None) -> Exported:
    """Make the files of a target.

    Raises
    ------
    StoopError
        There is no such target, the model cannot be exported so, or no steady flight is found.
    """
    if not isinstance(target, str) or target not in TARGETS:
        raise StoopError(f"there is no target {target!r} of an export; {nearest(str(target), TARGETS)}")
    exporter: Callable[..., Exporter] = TARGETS[target].load()
    return (exporter(model) if condition is None else exporter(model, condition)).export()
