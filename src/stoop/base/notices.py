"""What is found about a log, a mapping, a vehicle or a fit, as typed values.

A `Notice` is data: code compares codes and values, never sentences. It becomes a sentence once, at the border (terminal,
page, ``result.json``), by the one table ``data/notices.toml``, which ``docs/notices.md`` shows.
"""

from __future__ import annotations

import functools
import math
import string
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from types import MappingProxyType
from typing import Any, Literal, ParamSpec, TypeAlias, TypeVar, get_args

from stoop.base.numbers import MAX_NUMBER
from stoop.base.text import enumerated
from stoop.base.units import DEGREE
from stoop.errors import StoopError, one_line, raised_at

Given = ParamSpec("Given")
Found = TypeVar("Found")
Severity = Literal["info", "warning"]
Value: TypeAlias = "str | float | int | bool | tuple[str, ...] | tuple[float, ...] | Notice"


@dataclass(frozen=True)
class Notice:
    """One finding.

    Attributes
    ----------
    code : str
        Row of the table, such as ``"stuck-channel"``.
    severity : str
        ``"info"``: what a figure rests on, or what was done to the data; ``"warning"``: what makes a result doubtful.
    subject : str
        What it is about: a channel, a parameter, a window, a line of a file.
    values : mapping
        Numbers (SI, radians), names and notices that the sentence needs.
    """

    code: str
    severity: Severity
    subject: str = ""
    values: Mapping[str, Value] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return the sentence."""
        return message(self)

    def __hash__(self) -> int:
        """Return a hash, so that repeated notices can be dropped."""
        return hash((self.code, self.subject, tuple(sorted(self.values))))

    @property
    def topic(self) -> str:
        """Topic of the code: "log", "mapping", "flight", "vehicle", "fit", "assessment" or "design"."""
        return table()[self.code].topic

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON document holds; the sentence is among it, for people."""
        return {
            "code": self.code,
            "severity": self.severity,
            "subject": self.subject,
            "values": {
                name: v.to_dict() if isinstance(v, Notice) else list(v) if isinstance(v, tuple) else v
                for name, v in self.values.items()
            },
            "message": message(self),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Notice:
        """Return the notice that `Notice.to_dict` gave; where this version has another code or values, its sentence is kept.

        Every notice can be shown: where there is no sentence, it raises ValueError, LookupError, TypeError, AttributeError or
        OverflowError.
        """
        if content["severity"] not in get_args(Severity):
            raise ValueError(f"{content['severity']!r} is no severity")
        if content["code"] not in table():
            return as_notice(str(content["message"]), content["severity"])
        values = {name: _value(v) for name, v in content["values"].items()}
        found = cls(content["code"], content["severity"], str(content["subject"]), values)
        try:
            message(found)
        except LookupError:
            if "message" not in content:
                raise
            return as_notice(str(content["message"]), content["severity"])
        return found


@dataclass(frozen=True)
class Kind:
    """A row of the table: `topic` is "log", "mapping", "flight", "vehicle", "fit", "assessment" or "design"."""

    topic: str
    severity: Severity
    text: str


#: Metadata of a dataclass field of notices that a JSON document holds as a list of sentences, or as one text: a notice or
#: none, or several and what stands between their sentences.
AS_SENTENCES: Mapping[str, Any] = MappingProxyType({"sentences": None})
AS_TEXT: Mapping[str, Any] = MappingProxyType({"sentences": "; "})
AS_PARAGRAPH: Mapping[str, Any] = MappingProxyType({"sentences": ". "})


def paragraph(notices: Iterable[Notice]) -> str:
    """Return the sentences of several notices as one text, which ends without a stop, as a notice does."""
    return str(AS_PARAGRAPH["sentences"]).join(map(str, notices))


@functools.cache
def table() -> Mapping[str, Kind]:
    """Return code -> row of ``data/notices.toml``."""
    text = (files("stoop.data") / "notices.toml").read_text("utf-8")
    return MappingProxyType({code: Kind(**row) for code, row in tomllib.loads(text).items()})


def notice(code: str, subject: str = "", **values: Value) -> Notice:
    """Return a notice with the severity that the table gives its code; of infinite numbers, which JSON lacks, the sign stays."""
    finite = {name: _finite(value) for name, value in values.items()}
    return Notice(code, table()[code].severity, subject, finite)


def _finite(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_finite, value))
    return math.copysign(MAX_NUMBER, value) if isinstance(value, float) and math.isinf(value) else value


def as_notice(found: Notice | str, severity: Severity = "warning", topic: str = "fit") -> Notice:
    """Return a notice as it is; a sentence without a code becomes one that holds it as its text."""
    if isinstance(found, Notice):
        return found
    code = "untyped-warning" if severity == "warning" else f"untyped-{topic}-note"
    return notice(code, text=found)


def _value(value: Any) -> Any:
    if isinstance(value, dict | list):
        return Notice.from_dict(value) if isinstance(value, dict) else tuple(map(_value, value))
    return math.nan if value is None else value  # JSON has no NaN


def message(found: Notice) -> str:
    """Return the sentence of a notice, on one line whatever names of a log are quoted in it."""
    values = {"subject": found.subject, **found.values}
    return one_line(_FORMATTER.vformat(table()[found.code].text, (), values))


def attempt(
    failed: list[Notice],
    nothing: Found,
    detector: Callable[Given, Found],
    *given: Given.args,
    **options: Given.kwargs,
) -> Found:
    """Return what a detector finds; one that fails finds nothing, which costs its notice among `failed`, never the flight.

    An error that the user can mend is no failure, and passes.
    """
    try:
        return detector(*given, **options)
    except (StoopError, MemoryError):
        raise
    except Exception as error:
        failed.append(detector_failed(f"{detector.__module__}.{detector.__qualname__}", error))
        return nothing


def detector_failed(detector: str, error: Exception) -> Notice:
    """Return the notice of a detector that failed; tests and trials raise the error instead."""
    why = f"{type(error).__name__}: {error}"
    return notice("detector-failed", detector, error=why, place=raised_at(error))


def distinct(found: Iterable[Notice]) -> tuple[Notice, ...]:
    """Return the notices without repetitions, in order."""
    return tuple(dict.fromkeys(found))


def of_severity(found: Iterable[Notice], severity: Severity) -> tuple[Notice, ...]:
    """Return the notices of one severity, in order."""
    return tuple(one for one in found if one.severity == severity)


class _Formatter(string.Formatter):
    """`str.format` with lists (``a, b and c``) and more formats.

    Angles ``{x:deg .1f}``, shares ``{x:percent .0f}``, plurals ``{n:plural sample samples}``.
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, tuple | list):
            return enumerated(self.format_field(one, format_spec) for one in value)
        if format_spec.startswith("deg "):
            return format(value / DEGREE, format_spec.removeprefix("deg "))
        if format_spec.startswith("percent "):
            return format(100.0 * value, format_spec.removeprefix("percent ")) + " %"
        if format_spec.startswith("plural "):
            one, many = format_spec.removeprefix("plural ").split(" ")
            return one if value == 1 else many
        return str(format(value, format_spec))


_FORMATTER = _Formatter()
