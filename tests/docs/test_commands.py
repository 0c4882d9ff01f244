"""Every command in the documentation parses, and every option of the program is documented."""

from __future__ import annotations

import argparse
import re
import shlex
import tomllib
from pathlib import Path

import pytest

from docs.pages import DOCS, PAGES, ROOT, blocks, commands, links, table, tables
from stoop.cli.main import all_verbs, main, one_verb, parser_for
from stoop.results.result import read_result
from stoop.vehicle.builtin import resolve_vehicle

TEXTS = (".py", ".toml", ".md", ".ipynb", ".txt")  #: endings of what may advise an installation
PAGE = DOCS / "commands.md"
WRITTEN = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in commands(page)]
STOOP = [
    (page, part.strip()) for page, line in WRITTEN for part in line.split("&&") if "stoop " in f"{part} "
]
OTHER = re.compile(
    r"^(\.venv/bin/)?(mv|python3? -m venv|pip install|pytest|"
    r"python3? scripts/(test|fuzz_readers)\.py|python3? (-m )?benchmarks)\b"
)


def words(command: str) -> list[str]:
    """Return the words after ``stoop``, without a redirection."""
    return one_verb(shlex.split(command.partition(">")[0].replace(".venv/bin/", ""))[1:])


def options(verb: str) -> dict[str, argparse.Action]:
    """Return the options of a verb by the names that help shows."""
    parser = parser_for([verb])
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    actions = verbs.choices[verb]._actions
    return {
        s: a for a in actions for s in a.option_strings or [a.metavar] if s not in ("-h", "--help", "--debug")
    }


@pytest.mark.parametrize(("page", "command"), STOOP)
def test_commands_parse(page: str, command: str) -> None:
    arguments, unknown = parser_for(words(command)).parse_known_args(words(command))
    assert not unknown
    assert callable(arguments.run)


@pytest.mark.parametrize(("page", "command"), WRITTEN)
def test_other_commands_are_known(page: str, command: str) -> None:
    parts = [part.strip() for part in command.split("&&")]
    unknown = [
        p for p in parts if not p.removeprefix(".venv/bin/").startswith("stoop") and not OTHER.match(p)
    ]
    assert not unknown


@pytest.mark.parametrize("verb", all_verbs())
def test_options_of_verbs(verb: str) -> None:
    cells = table(PAGE, f"stoop {verb}", "option").column("option")
    written = {
        word for cell in cells for word in re.findall(r"(?:^|[`\s])(-{1,2}[a-z][\w-]*|[A-Z]{5,})", cell)
    }
    assert written >= set(options(verb))
    assert {w for w in written if w.startswith("-")} == {o for o in options(verb) if o.startswith("-")}


@pytest.mark.parametrize("verb", all_verbs())
def test_defaults_of_options(verb: str) -> None:
    known = options(verb)
    for cell, _, default in table(PAGE, f"stoop {verb}", "option").rows:
        action = known[cell.replace("`", "").split(",")[0].split()[0]]
        if re.fullmatch(r"[\w.-]+", default) and default not in ("required", "none", "estimated", "all"):
            assert str(action.default).removesuffix(".0") == default, cell
        assert (default == "required") == (action.required and action.nargs != "*"), cell


def test_verbs() -> None:
    assert [row[0].partition("`")[2].partition("`")[0] for row in tables(PAGE)[0].rows] == list(all_verbs())


@pytest.mark.parametrize(
    "page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda p: p.relative_to(ROOT).as_posix()
)
def test_links_lead_somewhere(page: Path) -> None:
    assert not [target for target in links(page) if not (page.parent / target).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_rows_of_tables_are_as_wide_as_their_heads(page: Path) -> None:
    """Else a page shows bars and dashes: a bar within a cell begins another cell."""
    for one in tables(page):
        assert {len(row) for row in one.rows} == {len(one.head)}, one.head


def test_version_is_one() -> None:
    """The package, its citation and its changelog name the same version."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## [{version}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder to work in, with the examples in it."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(command: str) -> None:
    assert main(words(command)) == 0, command


def test_quick_start_runs(workplace: Path) -> None:
    """Two simulated flights give the 32 coefficients back."""
    practice = [c for c in commands(DOCS / "quickstart.md") if "twin-boom" in c]
    assert len(practice) == 3
    for command in practice:
        run(command)
    result = read_result(workplace / "practice" / "result.json")
    truth = {p.name: p.value for p in resolve_vehicle("twin-boom").parameters}
    assert len(result.parameters) == 32
    assert all(abs(p.estimate - truth[n]) < 4.0 * p.std_error for n, p in result.parameters.items())


def test_first_mile_runs(workplace: Path) -> None:
    """From a log, mass, span and chord to a model, by the printed commands: slopes agree with those that flew."""
    first = [c for c in commands(DOCS / "quickstart.md") if "flight.ulg" in c or "my.toml" in c]
    assert [words(c)[0] for c in first] == [
        "simulate",
        "info",
        "vehicle new",
        "trim",
        "maneuvers",
        "identify",
    ]
    for command in first:
        run(command)
    result = read_result(workplace / "result" / "result.json")
    flown, file = (resolve_vehicle(p) for p in (ROOT / "examples" / "vtail.toml", workplace / "my.toml"))
    truth = {p.name: p.value for p in flown.parameters}
    for coefficient, axis in (("Cl", "x"), ("Cm", "y"), ("Cn", "z")):  # for the inertia that the draft states
        stated = file.value(f"reference.inertia.{axis}") / flown.value(f"mass.inertia.{axis}{axis}")
        truth |= {n: stated * truth[n] for n in flown.terms[coefficient]}
    # constants and thrust stand for another working point and another propeller
    other = ("CL0", "Cm0", "CD0", "propulsion.CT0", "propulsion.CT1")
    known = {n: p for n, p in result.parameters.items() if n in truth and n not in other and p.std_error}
    z = {n: (p.estimate - truth[n]) / p.std_error for n, p in known.items()}
    assert len(z) > 25
    assert max(map(abs, z.values())) < 4.0, z
    assert sum(abs(x) < 1.96 for x in z.values()) > 0.85 * len(z), z


def test_maneuver_page_runs(workplace: Path) -> None:
    for name, text in zip(("maneuver", "rotors"), blocks(DOCS / "maneuver-file.md", "toml"), strict=True):
        (workplace / f"{name}.toml").write_text(text, encoding="utf-8")
    for command in commands(DOCS / "maneuver-file.md"):
        run(command)
    assert (workplace / "flight.nc").exists()
    assert (workplace / "hover.nc").exists()


def test_demo_runs(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The main command of the README, without the installation."""
    demo = [part.strip() for part in commands(ROOT / "README.md")[0].split("&&")][-1]
    run(demo)
    assert "truth" in capsys.readouterr().out
    assert (workplace / "stoop-demo" / "report.html").exists()


def test_nothing_is_installed_from_an_index_that_has_no_stoop() -> None:
    """Pages, notebooks and messages install from a clone, as README does, by names of extras that there are."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    sources = [p for folder in ("src", "examples") for p in (ROOT / folder).rglob("*.*") if p.suffix in TEXTS]
    installed = set()
    for place in (*PAGES, *sources):
        text = place.read_text(encoding="utf-8")
        assert not re.search(r"pip install (-\S+ )*['\"]?stoop\b", text), place
        installed |= {
            e for found in re.findall(r"pip install '\.\[([\w,]+)\]'", text) for e in found.split(",")
        }
        installed |= (
            set(re.findall(r"\binstall\([\"'](\w+)[\"']\)", text)) if place.suffix == ".py" else set()
        )
    assert "app" in installed
    assert installed <= set(extras)
