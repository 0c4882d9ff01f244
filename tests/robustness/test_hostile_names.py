"""Names of vehicles, flights and columns that are code somewhere: in no output do they become more than text.

A name becomes code where the same command with another name writes other code. So every output is read by the parser of its
language, its comments and texts are taken out, and what is left must be that of a vehicle and a flight with plain names.
"""

import ast
import contextlib
import csv
import io
import json
import re
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Mapping
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from robustness.small_runs import COMMANDS, OUT, inputs, run, written
from robustness.trials import BrokenPromiseError, lay_out, promise
from scipy.io import loadmat

from stoop.base.toml import quoted
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop_export.exporter import ModelData
from stoop_export.jsbsim_flight import file_name
from stoop_export.matlab import identifier
from stoop_export.targets import TARGETS

PLAIN = "a name of plain letters, longer than the forty of an identifier"
NAMES = (
    "</script><script>alert(1)</script>", "\"><img src=x onerror=alert(1)>' onload='x",
    "\"\"\" ''' ` \" '", "a\nb\r\nc\u2028d\x85e\x0bf", '\\" \\\n \\u0022 \\', "]]> */ --> ]] ]=] --[[ {- <!-- <![CDATA[ /*",
    "=cmd|' /C calc'!A0", "@SUM(1+1)*cmd|' /C calc'!A0", "'); system('x'); ('",
    "${x} $name {name} {0} @NAME@ @EQUATIONS@ %s %(x)s {{7*7}} {% x %}", "x\" $(touch x) `touch x` ; touch x & # ' | touch x",
    "x\n%{\nsystem('x') ... \n%}",
    "[x](javascript:alert(1)) ![x](http://x) <b> | x |\n# x\n```\n", "$\\frac{$ a_b^{ $\\x$ \\input{x}", "../../../../x/../y",
    "\u202ex\u2066\x1b[31m\x07\x00", "end", "1e5", "\u0130\u00df\uff1cscript\uff1e\ufb01",
)  # fmt: skip
SEVERAL = [NAMES[6], ""]  #: the names in a few, of as many letters as a vehicle and a file may have
for hostile in NAMES:
    if len((SEVERAL[-1] + hostile).encode()) > 190:
        SEVERAL.append("")
    SEVERAL[-1] += hostile
STRING = r"\"(?:\\.|[^\"\\\n])*\""
QUOTED = r"'(?:\\.|[^'\\\n])*'"
TEXTS = {
    ".c": rf"/\*.*?\*/|//[^\n]*|{STRING}|{QUOTED}",
    ".lua": rf"--\[(=*)\[.*?\]\1\]|--[^\n]*|{STRING}|{QUOTED}|\[(=*)\[.*?\]\2\]",
    ".m": r"^\s*%\{\s*$.*?^\s*%\}\s*$|%[^\n]*|\.\.\.[^\n]*|(?<![\w)\]}.'])'(?:''|[^'\n])*'|\"(?:\"\"|[^\"\n])*\"",
    "": r"(?<!\S)#[^\n]*|'[^']*'|\"(?:\\.|[^\"\\])*\"",  # of a shell
    **dict.fromkeys((".parm", ".param", ".params"), r"^#[^\n]*"),
}  #: ending -> comments and texts of a language
VARIANTS = (file_name, identifier, lambda name: file_name(name).replace("-", "_"))
PLACE = re.compile(r"[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*")
NUMBER = re.compile(r"\b22\d\d\d_")  #: of an airframe of PX4, which follows from the name


class _Markup(HTMLParser):
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
    rows = list(csv.reader(io.StringIO(text, newline="")))
    for cell in (cell for row in rows for cell in row if re.match(r"[=+\-@\t\r]", cell)):
        with contextlib.suppress(ValueError):
            float(cell)
            continue
        promise(False, f"the formula {cell!r} in a table")
    return [len(row) for row in rows]


def _markdown(text: str) -> Any:
    from markdown_it import MarkdownIt  # of the extra app

    tokens = MarkdownIt("commonmark", {"html": True}).enable("table").parse(text)
    every = [one for token in tokens for one in (token, *(token.children or ()))]
    return [one.type for one in every if one.type not in ("text", "text_special")]


PARSERS: dict[str, Callable[[str], Any]] = {
    ".html": _html, ".json": _json, ".toml": lambda text: _tree(tomllib.loads(text)),
    ".yaml": _json,  # of PyFlyt, in that part of the language
    **dict.fromkeys((".xml", ".sdf", ".urdf", ".config"), _xml),
    ".py": _python, ".csv": _table, ".md": _markdown, ".txt": lambda text: len(text.splitlines()),
}  # fmt: skip  #: ending -> the code of a file, or what stands for it


def code(place: str, content: bytes) -> Any:
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
            archive = zipfile.ZipFile(io.BytesIO(given))
            with zipfile.ZipFile(out := io.BytesIO(), "w") as new:
                for inside in archive.namelist():
                    new.writestr(other(inside), content(inside, archive.read(inside)))
            return out.getvalue()
        with contextlib.suppress(UnicodeDecodeError):
            given = other(given.decode("utf-8")).encode()
        return given

    return {other(place): content(place, given) for place, given in files.items()}


def with_name(text: str, name: str) -> str:
    head = f"name = {quoted(name)}\nnotes = [{quoted(name)}]\n"
    return head + re.sub(r"(?ms)^(name = [^\n]*|notes = \[.*?\])$", "", text)


LEARNING = ("rotorpy", "mujoco", "pyflyt", "gym-pybullet-drones", "crazyflow", "isaac")
WRITERS = (
    "identify", "validate", "compatibility", "structure", "maneuvers", "state-space", "flight", "table", "map", "look",
    "propagate",
)  # fmt: skip


def exported(target: str, text: str) -> Mapping[str, bytes]:
    return TARGETS[target].load()(ModelData(parse_vehicle(text, "vehicle.toml"))).files().files


def assert_same_code(found: Mapping[str, bytes], plain: Mapping[str, bytes], name: str) -> None:
    hostile, expected = codes(found), codes(renamed(plain, name))
    assert sorted(hostile) == sorted(expected)
    for place, text in hostile.items():
        assert text == expected[place], f"other code: {place}"


@pytest.mark.parametrize("target", TARGETS)
def test_no_name_of_a_vehicle_becomes_code_of_an_export(target: str) -> None:
    several = "quadplane" if target in ("gazebo", "px4-jsbsim") else "twin-boom"
    text = builtin_text("quad-x" if target in LEARNING else several)
    plain = exported(target, with_name(text, PLAIN))
    for name in SEVERAL:
        assert_same_code(exported(target, with_name(text, name)), plain, name)


def file_stem(name: str) -> str:
    return name.replace("\\", "").replace("/", "\N{DIVISION SLASH}").replace("\0", "\N{SYMBOL FOR NULL}")


def named_inputs(name: str) -> dict[str, bytes]:
    found = dict(inputs())
    for place in ("v.toml", "model/vehicle.toml"):
        found[place] = with_name(found[place].decode(), name).encode()
    result = json.loads(found["model/result.json"])
    for maneuver in result["maneuvers"]:
        maneuver["flight"] = file_stem(name)
    found["model/result.json"] = json.dumps(result).encode()
    found[f"{file_stem(name)}.nc"] = found.pop("sim.nc")
    head, *rows = csv.reader(io.StringIO(found["table.csv"].decode()))
    table = io.StringIO()
    csv.writer(table).writerows([[*head, name], *([*row, f"{i % 7}"] for i, row in enumerate(rows))])
    found["columns.csv"] = table.getvalue().encode()
    for ending in (".csv", ".csv.toml"):
        found[f"{file_stem(name)}{ending}"] = found.pop(f"table{ending}")
    return found


def outputs(command: str, name: str) -> Mapping[str, bytes]:
    table = "columns.csv" if command == "map" else f"./{file_stem(name)}.csv"
    words = {"sim.nc": f"./{file_stem(name)}.nc", "table.csv": table}
    with TemporaryDirectory(prefix="stoop-") as place, contextlib.chdir(place):
        lay_out(Path(place), named_inputs(name))
        Path(OUT).mkdir()
        ended = run(tuple(words.get(word, word) for word in COMMANDS[command]))
        assert ended.code == 0, ended.stderr_lines[-1:]
        assert all(line.isprintable() for line in ended.stderr_lines), "steers a terminal"
        return written(Path(OUT))


@pytest.mark.parametrize("command", WRITERS)
def test_no_name_becomes_code_of_an_output(command: str) -> None:
    plain = outputs(command, PLAIN)
    for name in SEVERAL:
        assert_same_code(outputs(command, name), plain, name)


SEEN = {
    "a.c": ('/* n */ int x;\n// n\nchar *s = "n";', '/* n */ system(); /* */ int x;\n// n\nchar *s = "n";'),
    "a.lua": ('-- n\nlocal x = "n" --[[ n ]]', '-- n\nos.execute()\nlocal x = "n" --[[ n ]]'),
    "a.m": ("% n\nx = y' + z';  % 'n'\ns = 'n''n';", "% n\nx = y' + z';  % 'n'\ns = 'n'; system('n');"),
    "a": ("# n\nparam set A 'n'", "# n\ntouch x\nparam set A 'n'"),
    "a.py": ('"""n"""\nx = "n"', '"""n"""\nimport os\nx = "n"'),
    "a.xml": ("<a b='n'>n</a>", "<a b='n' c='n'>n</a>"), "a.html": ("<p>n</p>", "<p>n<img src=x></p>"),
    "a.toml": ('a = "n"', 'a = "n"\nb = "n"'), "a.json": ('{"a": "n"}', '{"a": "n", "b": 1}'),
    "a.parm": ("A 1\n# n", "A 1\nB 1\n# n"), "a.csv": ("a,n\r\n1,2", "a,n\r\nb,1,2"),
}  # fmt: skip


def test_a_name_that_becomes_code_is_seen() -> None:
    for place, texts in SEEN.items():
        plain, hostile = (text.encode() for text in texts)
        other = plain.replace(b"n", b"abc") if place not in ("a.c", "a.lua", "a.py") else plain
        assert code(place, plain) == code(place, other)
        assert code(place, plain) != code(place, hostile)
    code("a.csv", b"a,b\r\n-1.5,+2e3")
    tables = [f"a,b\r\n1,{cell}" for cell in ("=1+1", "+x", "-x()", "@SUM(1)", "\tx")]
    pages = ("<a href='javascript:x()'>", "<p onclick='x()'>")
    for place, text in (*(("a.csv", x) for x in tables), *(("a.html", x) for x in pages)):
        with pytest.raises(BrokenPromiseError):
            code(place, text.encode())
