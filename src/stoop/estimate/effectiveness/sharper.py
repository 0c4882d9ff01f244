"""What would let a smaller loss be seen: calmer flights, more healthy ones, propellers swapped.

The least loss that is seen grows with what flights differ by, with the scatter within each, and with how little is known
of the former. Each advice is what that loss becomes when one of them is mended and the others stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.effectiveness.compare import Reference
from stoop.estimate.effectiveness.hover import Hover
from stoop.estimate.effectiveness.verdict import Verdict, needed

MANY: Final = 8  #: healthy flights after which more bring little
HELPS: Final = 0.9  #: of the least loss seen, below which an advice is worth following


def advice(
    reference: Reference, hovers: Sequence[Hover], verdicts: Sequence[Verdict], chance: float
) -> list[str]:
    """Return in words what to fly for a sharper answer, with what it would bring to the flight that shows least."""
    now, worst = max(((_least(reference, h, chance), h) for h in hovers), key=lambda pair: pair[0])
    return [*_calmer(reference, worst, chance, now), *_more(reference, worst, chance, now), *_swap(verdicts)]


def _calmer(reference: Reference, worst: Hover, chance: float, now: float) -> Iterator[str]:
    then = _seen(reference, worst, reference.between(worst, len(reference.hovers)), chance)
    if then < HELPS * now:
        yield (
            f"a plain hover: the commands vary much within these flights; with a minute of calm hover in each, without "
            f"maneuvers, {_falls(now, then)} at best"
        )


def _more(reference: Reference, worst: Hover, chance: float, now: float) -> Iterator[str]:
    count = len(reference.hovers)
    if count >= MANY:
        return
    covariance = reference.between(worst, MANY) + reference.within(worst)
    then = _seen(reference, worst, covariance, chance, MANY - count)
    if count == 1 or then < HELPS * now:
        yield (
            f"more healthy flights, on several days: with {MANY} {_falls(now, then)}"
            + ("; and each could be held against the others" if count == 1 else "")
        )


def _falls(now: float, then: float) -> str:
    return f"the least loss that would be seen falls from {100.0 * now:.0f} % to {100.0 * then:.0f} %"


def _swap(verdicts: Sequence[Verdict]) -> Iterator[str]:
    accused = list(dict.fromkeys(name for v in verdicts if v.kind != "mass" for name in v.rotors))
    if accused:
        yield (
            f"swap the propeller{'s' if len(accused) > 1 else ''} of {', '.join(accused)} with that of a rotor that turns the "
            "same way, and fly again: a weak propeller takes the loss along, a weak motor or a mass does not"
        )


def _least(reference: Reference, hover: Hover, chance: float) -> float:
    return _seen(reference, hover, reference.covariance(hover), chance)


def _seen(
    reference: Reference, hover: Hover, covariance: FloatArray, chance: float, further: int = 0
) -> float:
    """Return the loss of the best-observed rotor that is seen, with so many further healthy flights."""
    columns = reference.columns(hover)
    squares = np.einsum("ik,ij,jk->k", columns, np.linalg.inv(covariance), columns)
    smallest = float(squares.max() ** -0.5)
    return needed(reference.degrees + further, columns.shape[1], chance) * smallest
