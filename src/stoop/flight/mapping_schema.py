"""The TOML file of a mapping, table by table, as pydantic models.

`[variables]` names one column for one variable; `[group.NAME]` names variables that belong together and their sources
in order of trust. `[calibration]`, `[surface]` and `[mixer]` turn servo outputs into deflections, `[align]` brings
clocks together. A mapping that says `extends = "px4"` starts from a ready one and overrides what it names.
`docs/flight-files.md` explains every key.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stoop.base.schema_errors import first_complaint
from stoop.errors import LogError

TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
Text: TypeAlias = Annotated[str, Field(min_length=1)]
Number: TypeAlias = Annotated[float, Field(gt=-1e300, lt=1e300)]
Columns: TypeAlias = (
    str | Annotated[dict[str, Number], Field(min_length=1)]
)  #: one column, or weights of a sum
FrameName: TypeAlias = Literal["frd", "flu", "ned", "enu", "nwu"]
MixerKind: TypeAlias = Literal["v-tail", "inverted v-tail", "elevon", "flaperon"]
Quantity: TypeAlias = Literal["p", "q", "r", "psi_dot", "turning", "vn", "ve", "vd", "load"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class ClockTable(_Table):
    """[time], or [clock.STREAM]: the column that holds the time, its unit, and an offset in s that is added."""

    column: Text
    unit: TimeUnit
    offset: Number = 0.0


class _SourceKeys(_Table):
    stream: str = ""
    scale: Number | list[Number] = 1.0
    offset: Number | list[Number] = 0.0
    valid: str | list[str] = ""
    stamp: str = ""
    stamp_unit: TimeUnit = "us"
    frame: FrameName | list[FrameName] = []
    instance: Literal["first", "most moved"] = "first"
    unused: Number | None = None
    optional: bool = False


class VariableTable(_SourceKeys):
    """A line of [variables]: one column for one variable."""

    column: Columns
    unit: Text
    file: str = ""


class SourceTable(_SourceKeys):
    """An entry of sources in [group.NAME], with what the group says of all."""

    variables: Text | Annotated[list[Text], Field(min_length=1)]
    columns: Columns | list[Columns]
    unit: str | list[str] = ""
    partial: bool = False


class GroupTable(_Table):
    """[group.NAME]: variables that belong together, and their sources in order of trust.

    Keys of a source that stand beside `sources` hold for all of them.
    """

    sources: list[SourceTable]
    choose: Literal["fastest", "first"] = "fastest"

    @model_validator(mode="before")
    @classmethod
    def _give_common_keys(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        sources = content.get("sources", [{}])
        common = {key: x for key, x in content.items() if key not in ("sources", "choose")}
        if isinstance(sources, list):
            sources = [{**common, **one} if isinstance(one, dict) else one for one in sources]
        return {"sources": sources} | {key: x for key, x in content.items() if key == "choose"}


class CalibrationTable(_Table):
    """[calibration.OUTPUT]: pairs of output and deflection; a polynomial of some degree, or lines between them."""

    points: Annotated[list[Annotated[list[Number], Field(min_length=2, max_length=2)]], Field(min_length=2)]
    unit: str = "rad"
    degree: Annotated[int, Field(ge=1)] | None = None


class SurfaceTable(_Table):
    """[surface.NAME]: a weighted sum of calibrated outputs."""

    weights: Annotated[dict[str, Number], Field(alias="from", min_length=1)]


class MixerTable(_Table):
    """[mixer.NAME]: two calibrated outputs that move two surfaces."""

    kind: MixerKind
    left: Text
    right: Text


class AlignmentTable(_Table):
    """[align.STREAM]: the clock of a stream is moved to that of another one."""

    reference: Annotated[str, Field(alias="with", min_length=1)]
    using: list[Quantity] = []
    longest: Annotated[Number, Field(gt=0.0)] | None = None
    drift: bool = False


class MappingFile(_Table):
    """A mapping file."""

    extends: Text | None = None
    files: dict[str, Text] = {}
    time: ClockTable | None = None
    clock: dict[str, ClockTable] = {}
    variables: dict[str, VariableTable] = {}
    group: dict[str, GroupTable] = {}
    calibration: dict[str, CalibrationTable] = {}
    surface: dict[str, SurfaceTable] = {}
    mixer: dict[str, MixerTable] = {}
    align: dict[str, AlignmentTable] = {}


LINE_KEYS: Final = frozenset(VariableTable.model_fields)
GROUP_KEYS: Final = frozenset(SourceTable.model_fields) | GroupTable.model_fields.keys()


def parse_mapping(place: str, content: Mapping[str, Any]) -> MappingFile:
    """Validate the content of a mapping file.

    Raises
    ------
    LogError
        Names the file, the key and the fix.
    """
    try:
        return MappingFile.model_validate(content)
    except ValidationError as error:
        raise LogError(f"{place}: {first_complaint(error, content, MappingFile)}") from None
