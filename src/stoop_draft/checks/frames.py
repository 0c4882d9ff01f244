"""Edits of axes: a body whose axes point to the left and up, a ground whose axes point to the east, or up, by sensor and for all.

Axes as in `stoop.flight.conversion`: "flu" is a body of forward, left, up; "enu" a ground of east, north, up; "nwu" one of
north, west, up; "neu" is north, east, up, which is left-handed but usual. An attitude between such frames keeps its
bank, reverses its pitch, and counts its heading to the left from north ("nwu") or from east ("enu"); some estimators count
the pitch nose up all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from stoop.extend.variables import FAMILIES
from stoop_draft.checks.engine import Edit
from stoop_draft.checks.entries import Lines
from stoop_draft.checks.lines import ODDS, Assignment, LineEdit, counted_from_east, exchanged, multiplied

Apply: TypeAlias = Callable[[Assignment], Assignment]
RATES, EULER, SPECIFIC_FORCE, VELOCITY, POSITION = (
    FAMILIES[name] for name in ("rates", "euler", "specific force", "velocity", "position")
)
_BODY: Final = (RATES, SPECIFIC_FORCE)
_GROUND: Final = (VELOCITY, POSITION)
#: sensors whose axes may be wrong together: those of one instrument or estimator, and all
_TOGETHER: Final = (
    (RATES,), (SPECIFIC_FORCE,), (EULER,), (VELOCITY,), (POSITION,), (RATES, SPECIFIC_FORCE), (VELOCITY, POSITION),
    (EULER, VELOCITY, POSITION), (RATES, SPECIFIC_FORCE, EULER), (RATES, SPECIFIC_FORCE, EULER, VELOCITY, POSITION),
)  # fmt: skip


def frame_edits(lines: Lines) -> Iterator[Edit[Assignment]]:
    """Yield the edits that take sensors for ones with other axes, where the user wrote all their lines."""
    seen = set()
    for sensors in _TOGETHER:
        there = tuple(sensor for sensor in sensors if set(sensor) & lines.keys())
        if not there or there in seen:
            continue
        seen.add(there)
        ground = any(sensor in (EULER, *_GROUND) for sensor in there)
        for frame in ("nwu", "enu", "neu") if ground else ("flu",):
            if frame == "neu" and any(sensor not in _GROUND for sensor in there):
                continue
            body = any(sensor in (EULER, *_BODY) for sensor in there)
            axes = "-".join(("flu",) * (body and ground) + (frame,))
            for kept in ("", "theta") if ground and "theta" in lines and EULER in there else ("",):
                names, applied = _turned(there, frame, lines, kept)
                if len(names) > 1:
                    value = axes + (", its pitch nose up" if kept else "")
                    # where nothing shows the heading, any is as good: the usual axes
                    prior = ODDS.frame + ODDS.less_usual * ((frame == "nwu") + bool(kept))
                    fix = f"convert from axes {value}"
                    yield LineEdit("frame", names, fix, applied, prior=prior, value=value)


def _turned(
    there: tuple[tuple[str, ...], ...], frame: str, lines: Lines, kept: str
) -> tuple[tuple[str, ...], Apply]:
    """Return the variables that change where sensors have other axes, and the edit; one of them is ``kept`` as it is."""
    negative: list[str] = []
    steps: list[Apply] = []
    for sensor in there:
        x, y, z = sensor
        if sensor == EULER:
            negative += [y] if frame == "enu" else [y, z]
            steps += [counted_from_east] if frame == "enu" and z in lines else []
        elif sensor in _BODY or frame == "nwu":
            negative += [y, z]
        else:
            negative.append(z)
            steps += [exchanged(x, y)] if frame == "enu" and {x, y} & lines.keys() else []
    moved = {name: None for name in negative if name in lines and name != kept}
    own = {name: None for step in steps for name in step({})}
    if not own.keys() <= lines.keys():
        return (), lambda state: state

    def apply(state: Assignment) -> Assignment:
        for step in (multiplied(tuple(moved), -1.0), *steps):
            state = step(state)
        return state

    return tuple(moved | own), apply
