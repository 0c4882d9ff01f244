"""Names that are code in one language or another, and the code of each output with all its text taken out.

A name becomes code where the same command with another name writes other code. So every output is read by the parser of its
language, its comments and texts are taken out, and what is left must be that of a vehicle and a flight with plain names.
"""

from __future__ import annotations

import ast
import csv
import io
import json
import re
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Mapping
from html.parser import HTMLParser
from pathlib import PurePosixPath
from typing import Any, Final

from scipy.io import loadmat
from studies.robustness.trials import promise

from stoop.base.toml import quoted
from stoop.exporters.jsbsim_flight import file_name
from stoop.exporters.matlab import identifier

PLAIN: Final = "a name of plain letters, longer than the forty of an identifier"
NAMES: Final[Mapping[str, str]] = {
    "script": "</script><script>alert(1)</script>",
    "attribute": "\"><img src=x onerror=alert(1)>' onload='x",
    "quotes": "\"\"\" ''' ` \" '",
    "lines": "a\nb\r\nc\u2028d\x85e\x0bf",
    "backslashes": '\\" \\\n \\u0022 \\',
    "sections": "]]> */ --> ]] ]=] --[[ {- <!-- <![CDATA[ /*",
    "formula": "=cmd|' /C calc'!A0",
    "sum": "@SUM(1+1)*cmd|' /C calc'!A0",
    "call": "'); system('x'); ('",
    "template": "${x} $name {name} {0} @NAME@ @EQUATIONS@ %s %(x)s {{7*7}} {% x %}",
    "shell": "x\" $(touch x) `touch x` ; touch x & # ' | touch x",
    "matlab": "x\n%{\nsystem('x') ... \n%}",
    "markdown": "[x](javascript:alert(1)) ![x](http://x) <b> | x |\n# x\n```\n",
    "mathematics": "$\\frac{$ a_b^{ $\\x$ \\input{x}",
    "path": "../../../../x/../y",
    "directions": "\u202ex\u2066\x1b[31m\x07\x00",
    "keyword": "end",
    "number": "1e5",
    "letters": "\u0130\u00df\uff1cscript\uff1e\ufb01",
}  #: kind -> a name


def _several(most: int = 190) -> tuple[str, ...]:
    """Return the names in a few, of as many letters as a vehicle and a file may have."""
    found = [""]
    for name in NAMES.values():
        if len((found[-1] + name).encode()) > most:
            found.append("")
        found[-1] += name
    return tuple(found)


SEVERAL: Final = (*_several(), NAMES["formula"])
STRING: Final = r"\"(?:\\.|[^\"\\\n])*\""
QUOTED: Final = r"'(?:\\.|[^'\\\n])*'"
TEXTS: Final[Mapping[str, str]] = {
    ".c": rf"/\*.*?\*/|//[^\n]*|{STRING}|{QUOTED}",
    ".lua": rf"--\[(=*)\[.*?\]\1\]|--[^\n]*|{STRING}|{QUOTED}|\[(=*)\[.*?\]\2\]",
    ".m": r"^\s*%\{\s*$.*?^\s*%\}\s*$|%[^\n]*|\.\.\.[^\n]*|(?<![\w)\]}.'])'(?:''|[^'\n])*'|\"(?:\"\"|[^\"\n])*\"",
    "": r"(?<!\S)#[^\n]*|'[^']*'|\"(?:\\.|[^\"\\])*\"",  # of a shell
    ".parm": r"^#[^\n]*",
    ".param": r"^#[^\n]*",
    ".params": r"^#[^\n]*",
}  #: ending -> comments and texts of a language
VARIANTS: Final = (file_name, identifier, lambda name: file_name(name).replace("-", "_"))
PLACE: Final = re.compile(r"[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*")
NUMBER: Final = re.compile(r"\b22\d\d\d_")  #: of an airframe of PX4, which follows from the name
FORMULA: Final = re.compile(r"[=+\-@\t\r]")


class _Markup(HTMLParser):
    """Elements with the names of their attributes, and the scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[Any] = []
        self._script = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "code":  # text between backticks, which is set as such
            self.found.append((tag, sorted(name for name, _ in attrs)))
        self._script = tag in ("script", "style")
        for name, text in attrs:
            promise(not name.startswith("on"), f"an attribute {name} of <{tag}>")
            link = name.endswith(("href", "src", "action", "style"))
            promise(not (link and "javascript:" in (text or "").lower()), f"a script in {name} of <{tag}>")
            if name == "srcdoc":
                self.found.append(_html(text or ""))

    def handle_endtag(self, tag: str) -> None:
        if tag != "code":
            self.found.append(tag)
        self._script = False

    def handle_comment(self, data: str) -> None:
        self.found.append("comment")

    def handle_data(self, data: str) -> None:
        if self._script:
            self.found.append(_json(data) if data.lstrip().startswith(("{", "[")) else data)


def _html(text: str) -> Any:
    parser = _Markup()
    parser.feed(text)
    parser.close()
    return parser.found


def _tree(node: Any) -> Any:
    """Return a tree of values without its texts and numbers; keys stay, but for names of files."""
    if isinstance(node, dict):
        return {"file" if key.endswith((".nc", ".csv")) else key: _tree(x) for key, x in node.items()}
    if isinstance(node, list):
        kept = [_tree(x) for x in node]
        return kept if any(isinstance(x, dict | list) for x in node) else [len(kept)]
    return type(node).__name__


def _json(text: str) -> Any:
    return _tree(json.loads(text))


def _toml(text: str) -> Any:
    return _tree(tomllib.loads(text))


def _xml(text: str) -> Any:
    """Return the elements; not their order, which may be that of names."""
    return sorted((one.tag, *sorted(one.attrib)) for one in ET.fromstring(text).iter())  # noqa: S314 - of our own


def _python(text: str) -> Any:
    tree = ast.parse(text)
    for one in ast.walk(tree):
        if isinstance(one, ast.Constant):
            one.value = type(one.value).__name__
    return ast.dump(tree)


def _table(text: str) -> Any:
    """Return the widths of the rows; no cell is a formula of a spreadsheet."""
    rows = list(csv.reader(io.StringIO(text, newline="")))
    for cell in (cell for row in rows for cell in row):
        promise(not FORMULA.match(cell) or _number(cell), f"the formula {cell!r} in a table")
    return [len(row) for row in rows]


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _markdown(text: str) -> Any:
    from markdown_it import MarkdownIt  # of the extra app

    tokens = MarkdownIt("commonmark", {"html": True}).enable("table").parse(text)
    every = [one for token in tokens for one in (token, *(token.children or ()))]
    return [one.type for one in every if one.type not in ("text", "text_special")]


PARSERS: Final[Mapping[str, Callable[[str], Any]]] = {
    ".html": _html,
    ".json": _json,
    ".toml": _toml,
    ".yaml": _json,  # of PyFlyt, in that part of the language
    **dict.fromkeys((".xml", ".sdf", ".urdf", ".config"), _xml),
    ".py": _python,
    ".csv": _table,
    ".md": _markdown,
    ".txt": lambda text: len(text.splitlines()),
}  #: ending -> the code of a file, or what stands for it


def code(place: str, content: bytes) -> Any:
    """Return the code of a file: what is neither comment nor text nor number of it."""
    ending = PurePosixPath(place).suffix
    if ending == ".fmu":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            inside = {name: archive.read(name) for name in archive.namelist() if "binaries" not in name}
        return codes(inside)
    if ending == ".mat":
        return sorted(loadmat(io.BytesIO(content)))
    if ending in (".nc", ".npz", ".sqlite", ".ulg"):
        return ""
    text = content.decode("utf-8")
    if ending in PARSERS:
        return PARSERS[ending](text)
    promise(ending in TEXTS, f"{place}: nobody knows this language")
    left = re.sub(TEXTS[ending], '""', text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"\d+(\.\d+)?([eE][-+]?\d+)?", "0", left)


def codes(files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the code of files by their place, which stays below a folder."""
    found = {NUMBER.sub("0_", place): code(place, content) for place, content in sorted(files.items())}
    for place in found:
        promise(PLACE.fullmatch(place) and ".." not in place, f"the place {place!r}")
    return found


def renamed(files: Mapping[str, bytes], name: str) -> dict[str, bytes]:
    """Return what a plain name made, with the words for files and functions that are made of another name in their place."""
    words = {variant(PLAIN): variant(name) for variant in VARIANTS}

    def other(text: str) -> str:
        for word in sorted(words, key=len, reverse=True):
            text = text.replace(word, words[word])
        return text

    def content(place: str, given: bytes) -> bytes:
        if place.endswith(".fmu"):
            with (
                zipfile.ZipFile(io.BytesIO(given)) as archive,
                zipfile.ZipFile(out := io.BytesIO(), "w") as new,
            ):
                for inside in archive.namelist():
                    new.writestr(other(inside), content(inside, archive.read(inside)))
            return out.getvalue()
        try:
            return other(given.decode("utf-8")).encode()
        except UnicodeDecodeError:
            return given

    return {other(place): content(place, given) for place, given in files.items()}


def with_name(text: str, name: str) -> str:
    """Return a vehicle file under another name, which is one of its notes, too."""
    head = f"name = {quoted(name)}\nnotes = [{quoted(name)}]\n"
    return head + re.sub(r"(?ms)^(name = [^\n]*|notes = \[.*?\])$", "", text)
