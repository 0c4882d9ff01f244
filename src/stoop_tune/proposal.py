"""Gains that are proposed beside those that flew, the trial flights that lead to them, and their files of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop import Notice
from stoop.extend.errors import StoopError
from stoop.extend.files import check_targets, write_files
from stoop.extend.notices import notice
from stoop_tune.control_laws.table import Firmware
from stoop_tune.gain_search import FARTHEST, FEW, SLACK, Design, propose
from stoop_tune.judgment import AxisMargins, worst
from stoop_tune.physical_parameters import PhysicalParameter

if TYPE_CHECKING:
    import pandas as pd

LADDER: Final = (0.25, 0.5, 0.75, 1.0)  #: shares of the way to the proposal, of trial flights
#: of a trial flight
SHOWN: Final[tuple[str, ...]] = ("gain margin", "phase margin", "disk margin", "rejection")


@dataclass(frozen=True, eq=False)
class Step:
    """Gains between those that flew and those that are proposed, for a trial flight."""

    share: float  #: of the way, of the logarithms
    values: Mapping[str, float]
    judged: tuple[AxisMargins, ...]


@dataclass(frozen=True, eq=False)
class Proposal:
    """Gains that are proposed, beside those that flew, with the trial flights that lead to them."""

    design: Design
    changes: Mapping[str, tuple[float, float]]  #: parameter -> flown, proposed
    ladder: tuple[Step, ...]  #: the last is the proposal
    against: tuple[Notice, ...]  #: why no file is written without being told to
    physics: tuple[PhysicalParameter, ...] = ()  #: of the same files

    def __repr__(self) -> str:
        """Return the size on one line."""
        return f"<Proposal for {self.design.firmware.title}: {len(self.changes)} parameters, {len(self.ladder)} steps>"

    @property
    def after(self) -> tuple[AxisMargins, ...]:
        """Margins with the gains that are proposed."""
        return self.ladder[-1].judged

    def trials(self) -> list[dict[str, Any]]:
        """Return a row for each trial flight and axis: margins and rejection, 5th percentile at the worst airspeed.

        ``watch`` is the frequency, rad/s, near which a loop with too much gain swings.
        """
        return [
            {
                "share": 100.0 * step.share, "axis": axis, **{n: worst(step.judged, axis, n) for n in SHOWN},
                "watch": max(float(one.margins.limit[0]) for one in step.judged if one.axis == axis),
            }
            for step in self.ladder
            for axis in self.design.axes
        ]  # fmt: skip

    def document(self) -> dict[str, Any]:
        """Return parameters and trial flights for JSON."""
        return {
            "parameters": {n: {"flown": old, "proposed": new} for n, (old, new) in self.changes.items()},
            "trials": self.trials(),
            "notices": [one.to_dict() for one in (*self.against, *self.limited)],
        }

    @property
    def limited(self) -> list[Notice]:
        """The parameters at the end of the range that is searched."""
        names = tuple(
            n for n, (old, new) in self.changes.items() if max(new / old, old / new) > 0.99 * FARTHEST
        )
        return [notice("tune-gains-limited", parameters=names, factor=FARTHEST)] if names else []

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each parameter that changes: flown, proposed."""
        import pandas as pd

        rows = [{"parameter": n, "flown": old, "proposed": new} for n, (old, new) in self.changes.items()]
        return pd.DataFrame(rows, columns=["parameter", "flown", "proposed"])

    def files(self) -> dict[str, str]:
        """Return the files of parameters in the autopilot's own form, by name: flown values, then each trial flight's.

        What is physics is the same in all trial flights.
        """
        firmware, after = self.design.firmware, {p.name: p.value for p in self.physics}
        flown = {n: old for n, (old, _) in self.changes.items()} | {p.name: p.flown for p in self.physics}
        steps = (flown, *({**step.values, **after} for step in self.ladder))
        return {
            name: "".join(firmware.line(n, x) for n, x in values.items())
            for name, values in zip(file_names(firmware), steps, strict=True)
        }

    def save(self, folder: str | Path, overwrite: bool = False, anyway: bool = False) -> list[Path]:
        """Write the files of parameters.

        Raises
        ------
        StoopError
            Something speaks against the proposal, unless `anyway`.
        OutputError
            The folder holds such files, unless `overwrite`, or cannot be written.
        """
        folder, files = Path(folder), self.files()
        check_proposal(folder, self.design.firmware, self.against, overwrite, anyway)
        write_files(folder, files)
        return [folder / name for name in files]


def file_names(firmware: Firmware) -> list[str]:
    """Return the names of the files of parameters: flown values, then each trial flight's."""
    stem, _, ending = firmware.file[0].partition(".")
    return [f"{stem}-{step}.{ending}" for step in ("flown", *(f"{100.0 * share:.0f}" for share in LADDER))]


def check_proposal(
    folder: Path, firmware: Firmware, against: Sequence[Notice], overwrite: bool, anyway: bool
) -> None:
    """Refuse to write a proposal: something speaks against it, or the folder cannot take it."""
    if against and not anyway:
        raise StoopError(
            f"tune: {'. '.join(map(str, against))}; no file is written without --anyway (in Python anyway=True)"
        )
    check_targets(folder, file_names(firmware), overwrite)


def proposal(design: Design, before: tuple[AxisMargins, ...]) -> Proposal:
    """Search gains, and return them with the way to them; steps speak against it that keep less than the flown gains."""
    new = propose(design)
    changes = {n: (design.flown[n], value) for n, value in new.items()}
    ladder = []
    for share in LADDER:
        values = {
            n: design.firmware.settable(old ** (1.0 - share) * value**share)
            for n, (old, value) in changes.items()
        }
        own = design if share == LADDER[-1] else design.part(FEW)
        judged = own.judged({**design.flown, **values})
        ladder.append(Step(share, values, tuple(one for at in judged for one in at)))
    kept = design.specification.left
    floor = min(0.0, float(kept(before)[1].min())) - 10.0 * SLACK
    weak = tuple(f"{100.0 * step.share:.0f} %" for step in ladder if kept(step.judged)[1].min() < floor)
    against = (notice("tune-step-weak", steps=weak),) if weak else ()
    return Proposal(design, changes, tuple(ladder), against)
