"""Texts and paths of odd forms: lines of 100 MB, 10,000 columns, other encodings, paths as long as a system takes."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from studies.robustness.commands import CHEAP
from studies.robustness.documents import SOUND
from studies.robustness.small_runs import IDENTIFY, OUT, TO, inputs

LONG: Final = 100_000_000  #: bytes of a line
WIDE: Final = 10_000  #: columns, or words of a line
WINDOWS: Final = b'format = "stoop-windows/1"\nwindow = [{ flight = "sim", start = 0.0, stop = 8.0 }]\n'
NO_LOG: Final = b"t,q\n0,1\n"  #: in a file whose ending is that of another format
READ_BY: Final[Mapping[str, tuple[str, ...]]] = {
    "table.csv": ("info", "table.csv"),
    "bare.csv": ("map", "bare.csv", "-o", f"{OUT}.toml"),
    "table.csv.toml": ("info", "table.csv"),
    "a.log": ("info", "a.log"),
    "a.txt": ("info", "a.txt"),
    "v.toml": ("trim", "v.toml"),
    "m.toml": ("simulate", "v.toml", "--maneuver", "m.toml", "-o", f"{OUT}.nc"),
    "w.toml": ("identify", "sim.nc", "--vehicle", "v.toml", "--maneuver", "w.toml", *CHEAP, *TO),
    "g.toml": ("vehicle", "new", "--geometry", "g.toml", "-o", f"{OUT}.toml"),
    "n.csv": (*IDENTIFY, "--noise", "n.csv", *CHEAP, *TO),
    "model/result.json": ("validate", "model", "sim.nc", "--maneuver", "8:12", *TO),
    "model/vehicle.toml": ("propagate", "model", "--draws", "100", "-o", f"{OUT}.html"),
}  #: name of a text -> a command that reads it


def sound_text(name: str) -> bytes:
    """Return a sound text of a name."""
    found = dict(inputs())
    found["bare.csv"] = found["table.csv"]
    found["w.toml"], found["g.toml"] = WINDOWS, (SOUND / "geometry.toml").read_bytes()
    found["n.csv"] = b"1,0.01,0.01,0.01,1,1\n"
    return found.get(name, NO_LOG)


def _comment(name: str, text: bytes) -> bytes:
    mark = {".toml": b"# ", ".json": b" "}.get(Path(name).suffix, b"")
    return mark + b" " * LONG + b"\n" + text


FORMS: Final[Mapping[str, Callable[[str, bytes], bytes]]] = {
    "the text itself": lambda name, text: text,
    "a line of 100 MB of zeros": lambda name, text: text + b"0" * LONG,
    "a line of 100 MB of commas": lambda name, text: text + b"," * LONG,
    "a line of 100 MB of brackets": lambda name, text: b"a = " + b"[" * LONG,
    "a line of 100 MB of quotes": lambda name, text: b'"' * LONG + b"\n" + text,
    "a line of 100 MB of spaces": _comment,
    "10,000 columns": lambda name, text: _repeated(text, b",".join(b"%d" % i for i in range(WIDE))),
    "10,000 equal columns": lambda name, text: _repeated(text, b",".join([b"q"] * WIDE)),
    "10,000 keys": lambda name, text: b"".join(b"a%d = 1\n" % i for i in range(WIDE)) + text,
    "UTF-16": lambda name, text: codecs.BOM_UTF16_LE + text.decode().encode("utf-16-le"),
    "UTF-16 of the other order": lambda name, text: codecs.BOM_UTF16_BE + text.decode().encode("utf-16-be"),
    "UTF-16 without a mark": lambda name, text: text.decode().encode("utf-16-le"),
    "UTF-32": lambda name, text: text.decode().encode("utf-32"),
    "UTF-8 with a mark": lambda name, text: codecs.BOM_UTF8 + text,
    "Latin-1": lambda name, text: b"# \xe9\xff\n" + text,
    "zeros between": lambda name, text: text.replace(b"a", b"a\0"),
    "old line ends": lambda name, text: text.replace(b"\n", b"\r"),
    "nothing": lambda name, text: b"",
    "a mark alone": lambda name, text: codecs.BOM_UTF8,
}  #: form -> from the name and the text of a sound file to an odd one


def _repeated(text: bytes, head: bytes) -> bytes:
    return head + b"\n" + b"\n".join([b",".join([b"1"] * WIDE)] * 20) + b"\n" + text


def long_path(length: int) -> str:
    """Return a relative path of so many characters, of folders of 200."""
    parts = ["d" * 200] * (length // 201)
    return "/".join([*parts, "x" * max(1, length - 201 * len(parts))])


PATHS: Final = {
    "a name of 255 letters": "n" * 250 + ".toml",
    "a name of 300 letters": "n" * 300,
    "a path of 4,000 letters": long_path(4000),
    "a path of 4,095 letters": long_path(4095),
    "a path of 20,000 letters": long_path(20_000),
    "a path of 3,800 dots": "./" * 1900 + "x",
    "a path through a file": "v.toml/x",
    "a name of a byte that is no text": "\udcff",
    "a name of line ends": "a\nb",
    "no name": "",
}  #: kind -> a path
WAYS: Final[Mapping[str, tuple[str, ...]]] = {
    "info": ("info", "PATH"),
    "look": ("look", "PATH"),
    "map": ("map", "PATH"),
    "trim": ("trim", "PATH"),
    "maneuver": ("simulate", "v.toml", "--maneuver", "PATH", "-o", f"{OUT}.nc"),
    "mapping": ("info", "table.csv", "--mapping", "PATH"),
    "windows": ("identify", "sim.nc", "--vehicle", "v.toml", "--maneuver", "PATH", *TO),
    "noise": (*IDENTIFY, "--noise", "PATH", *CHEAP, *TO),
    "model": ("agreement", "PATH", "PATH"),
    "output of map": ("map", "table.csv", "-o", "PATH"),
    "output of a vehicle": ("vehicle", "quad-x", "-o", "PATH"),
    "output of identify": (*IDENTIFY, *CHEAP, "-o", "PATH"),
    "output of maneuvers": ("maneuvers", "sim.nc", "-o", "PATH"),
    "output of export": ("export", "v.toml", "--to", "state-space", "-o", "PATH"),
    "progress": (*IDENTIFY, *CHEAP, *TO, "--progress", "PATH"),
    "JSON": ("linearize", "v.toml", "--json", "PATH"),
}  #: way -> command
