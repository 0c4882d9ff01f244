"""Numbers of a law, from the parameters of an autopilot."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stoop.extend.errors import StoopError
from stoop.extend.files import read_bounded
from stoop.extend.recordings import read
from stoop_tune.control_laws.rate_law import AXES

ENDINGS: Final = frozenset({".params", ".parm", ".param", ".config"})
MOST: Final = 2**22  #: bytes of a file of parameters
COLUMNS: Final = 5  #: of a line of QGroundControl
#: names in Betaflight's commands -> in the header of its logs
COMMANDS: Final = {
    **{f"{term}_{axis}": f"{axis}PID[{k}]" for axis in AXES for k, term in enumerate("pid")},
    **{f"d_{end}_{axis}": f"d_{end}[{k}]" for k, axis in enumerate(AXES) for end in ("min", "max")},
    **{f"f_{axis}": f"ff_weight[{k}]" for k, axis in enumerate(AXES)},
    **{f"gyro_notch{k + 1}_{end}": f"gyro_notch_{end}[{k}]" for k in (0, 1) for end in ("hz", "cutoff")},
    **{f"{of}_lpf1_dyn_min_hz": f"{of}_lpf1_dyn_hz[0]" for of in ("gyro", "dterm")},
    **{f"dyn_lpf_{of}_min_hz": f"{of}_lpf1_dyn_hz[0]" for of in ("gyro", "dterm")},  # of 4.2
    "dterm_lowpass_type": "dterm_lpf1_type",
    "dterm_lowpass2_type": "dterm_lpf2_type",
}
#: of Betaflight's commands -> numbers in the header of its logs
WORDS: Final = {
    "OFF": 0.0, "ON": 1.0, "PT1": 0.0, "BIQUAD": 1.0, "PT2": 2.0, "PT3": 3.0, "RP": 1.0, "RPY": 2.0, "RP_INC": 3.0,
    "RPY_INC": 4.0, "2_POINT": 1.0, "3_POINT": 2.0, "4_POINT": 3.0, "SMOOTH": 0.0, "STEP": 1.0,
}  # fmt: skip
DECIMAL_COMMA: Final = re.compile(r"(?:^|\s)(-?\d+,\d+)(?=\s|$)")


@dataclass(frozen=True)
class Parameters:
    """Parameters by name; one that is missing has the firmware's own default, which is given where it is read."""

    values: Mapping[str, float]
    autopilot: str

    def number(self, name: str, default: float | None = None, least: float = 0.0) -> float:
        """Return a parameter.

        Raises
        ------
        StoopError
            It is missing and has no default, it is no number, or it is less than `least`.
        """
        value = float(self.values.get(name, math.nan if default is None else default))
        if name not in self.values and default is None:
            raise StoopError(
                f"{self.autopilot}: the parameter {name} is missing; take them from a log of this autopilot, or from its file "
                "of parameters"
            )
        if not (math.isfinite(value) and value >= least):
            raise StoopError(
                f"{self.autopilot}: {name} = {value:g}: it must be a number of at least {least:g}"
            )
        return value

    def rising(self, low: tuple[str, float], high: tuple[str, float]) -> tuple[float, float]:
        """Return the values of two parameters, given by name and value, of which the second must be the larger."""
        if high[1] <= low[1]:
            raise StoopError(f"{self.autopilot}: {high[0]} = {high[1]:g} is not above {low[0]} = {low[1]:g}")
        return low[1], high[1]

    def named(self, pattern: str, defaults: Mapping[str, float | None]) -> dict[str, float]:
        """Return parameters of one pattern with a ``{}`` in it, by what stands there; without a default one must be given."""
        return {name: self.number(pattern.format(name), value) for name, value in defaults.items()}


def is_log(path: Path) -> bool:
    """Return whether a file is a log by its name, and no file of parameters."""
    return path.suffix.lower() not in ENDINGS


def read_parameters(*sources: str | Path | Mapping[str, float]) -> Mapping[str, float]:
    """Return parameters by name, those of a log, or of a file: `ENDINGS` of QGroundControl, ArduPilot, Betaflight's commands.

    Those of a later source count over those before, as of a file of few gains over the log that they change.

    Raises
    ------
    StoopError
        There is no such file, it cannot be read, or it holds no parameters.
    """
    each = (one if isinstance(one, Mapping) else _parameters(Path(one)) for one in sources)
    return {name: x for values in each for name, x in values.items()}


def _parameters(path: Path) -> Mapping[str, float]:
    if not is_log(path):
        try:
            text = read_bounded(path, MOST).decode("utf-8", "replace")
        except OSError as error:
            raise StoopError(f"{path}: cannot be read ({error.strerror or error}); check the file") from None
        if not text:
            raise StoopError(f"{path}: the file is empty; save the parameters again")
        values: dict[str, float] = {}
        for line in text.splitlines():
            if (found := _parameter(line)) is None:
                continue
            name, value = found
            if "=" in line and abs(values.get(name, value) - value) > 0.0:
                raise StoopError(
                    f"{path}: {name} is set to {values[name]:g} and to {value:g}: keep the commands of the profile that flew"
                )
            values[name] = value
    else:
        values = dict(read(path).parameters)
    if not values:
        endings = ", ".join(sorted(ENDINGS))
        raise StoopError(
            f"{path}: holds no parameters of an autopilot; give a file of those that it flew with, as a ground station saves it "
            f"({endings})"
        )
    return values


def _parameter(line: str) -> tuple[str, float] | None:
    """Return name and value of a line: of a Betaflight command, ``NAME,VALUE``, or vehicle, component, name, value and type."""
    text = line.partition("#")[0].strip().removeprefix("set ")
    if (wrong := DECIMAL_COMMA.search(text)) is not None:
        raise StoopError(f"'{line.strip()}': write the number with a point, {wrong[1].replace(',', '.')}")
    words = text.replace(",", " ").replace("=", " ").split()
    name, value = words[2:4] if len(words) == COLUMNS else words[:2] if len(words) > 1 else ("", "")
    try:
        return (COMMANDS.get(name, name), float(WORDS.get(value.upper(), value))) if name else None
    except ValueError:
        return (COMMANDS.get(name, name), math.nan) if "=" in text else None  # refused by a law that reads it
