"""Commands of the pages: all parse, and those of the first pages run."""

import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from docs.pages import DOCS, PAGES, ROOT, blocks, commands, table
from stoop.cli.main import main, one_verb, parser_for
from stoop.results.result import read_result
from stoop.vehicle.builtin import load_vehicle

OTHER = re.compile(
    r"^(\.venv/bin/)?(mv|python3? -m venv|pip install|pytest|"
    r"python3? scripts/\w+\.py|python3? (-m )?benchmarks)\b"
)


def words(command: str) -> list[str]:
    """Return the words after ``stoop``, without a redirection."""
    return one_verb(shlex.split(command.partition(">")[0].replace(".venv/bin/", ""))[1:])


def test_commands_of_all_pages_parse() -> None:
    parser_of = cache(lambda verb: parser_for([verb]))
    for page in PAGES:
        for part in (p.strip() for line in commands(page) for p in line.split("&&")):
            if not part.removeprefix(".venv/bin/").startswith("stoop "):
                assert OTHER.match(part), f"{page.name}: {part}"
                continue
            arguments, unknown = parser_of(words(part)[0]).parse_known_args(words(part))
            assert (unknown, callable(arguments.run)) == ([], True), f"{page.name}: {part}"


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(command: str) -> None:
    assert main(words(command)) == 0, command


def test_maneuver_page_runs(workplace: Path) -> None:
    for name, text in zip(("maneuver", "rotors"), blocks(DOCS / "maneuver-file.md", "toml"), strict=True):
        (workplace / f"{name}.toml").write_text(text, encoding="utf-8")
    for command in commands(DOCS / "maneuver-file.md"):
        run(command)
    assert all((workplace / f"{name}.nc").exists() for name in ("flight", "hover"))


def test_demo_runs(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run([part.strip() for part in commands(ROOT / "README.md")[0].split("&&")][-1])
    assert "truth" in capsys.readouterr().out
    assert (workplace / "stoop-demo" / "report.html").exists()


def test_quick_start_runs(workplace: Path) -> None:
    practice = [c for c in commands(DOCS / "quickstart.md") if "twin-boom" in c]
    assert len(practice) == 3
    for command in practice:
        run(command)
    result = read_result(workplace / "practice" / "result.json")
    truth = {p.name: p.value for p in load_vehicle("twin-boom").parameters}
    assert len(result.parameters) == 32
    assert all(abs(p.estimate - truth[n]) < 4.0 * p.std_error for n, p in result.parameters.items())


def test_first_mile_runs(workplace: Path) -> None:
    """From a log, mass, span and chord to a model, by the printed commands: slopes agree with those that flew."""
    first = [c for c in commands(DOCS / "quickstart.md") if "flight.ulg" in c or "my.toml" in c]
    verbs = ["simulate", "info", "vehicle new", "trim", "maneuvers", "identify"]
    assert [words(c)[0] for c in first] == verbs
    for command in first:
        run(command)
    result = read_result(workplace / "result" / "result.json")
    flown, file = (load_vehicle(p) for p in (ROOT / "examples" / "vtail.toml", workplace / "my.toml"))
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


def test_quadrotor_by_defaults(workplace: Path) -> None:
    """The commands of the page on drafted files recover the truth within three standard errors."""
    page = DOCS / "vehicle-new.md"
    for command in (c for c in commands(page) if "hover.ulg" in c):
        run(command)
    truth, found = load_vehicle("quad-x"), read_result("result/result.json").parameters
    names = table(page, "A quadrotor by defaults", "parameter").column("parameter")
    assert len(names) > 5
    for name in names:
        assert abs(found[name].estimate - truth.value(name)) < 3.0 * found[name].std_error, name
