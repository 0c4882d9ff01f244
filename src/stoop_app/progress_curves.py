"""The curves of a result in the progress file of a fit."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from stoop.extend.files import read_bounded
from stoop.extend.fits import ChannelTrace, ManeuverTrace

MAX_BYTES: Final = 2**26  #: of a progress file


def read_curves(path: Path) -> tuple[ManeuverTrace, ...]:
    """Return the curves of a result that a progress file holds; none where the fit has not ended."""
    with suppress(OSError, ValueError):
        found = json.loads(read_bounded(path, MAX_BYTES)).get("maneuvers", ())
        return tuple(
            ManeuverTrace(
                np.array(one["time"], dtype=np.float64),
                {
                    name: ChannelTrace(
                        *(np.array(c[kind], dtype=np.float64) for kind in ("measured", "simulated"))
                    )
                    for name, c in one["channels"].items()
                },
            )
            for one in found
        )
    return ()
