"""Packages beside stoop: what they offer is found without an import, and what is wrong with one costs a line and that part."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import stoop
from stoop.base.packages import OWN, check, packages

SCHEMA = tomllib.loads((Path(stoop.__file__).parent / "data" / "packages.toml").read_text("utf-8"))
DEFECTS = tomllib.loads(Path(__file__).with_name("packages.toml").read_text("utf-8"))
GOOD = (DEFECTS["good"]["file"], DEFECTS["good"]["code"])
SOURCE = Path(stoop.__file__).parents[1]


def written(folder: Path, packages: dict[str, tuple[str, str]]) -> None:
    for name, (table, code) in packages.items():
        (folder / name).mkdir()
        head = "interface = 1\n" * ("interface" not in table)
        (folder / name / "stoop.toml").write_text(head + table.replace("NAME", name))
        (folder / name / "m.py").write_text(code)


def output(folder: Path, code: str) -> tuple[str, str]:
    whole = f"import sys; sys.path[:0] = {[str(SOURCE), str(folder)]}\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", whole], capture_output=True, text=True, check=False, cwd=folder
    )
    return done.stdout, done.stderr


def lines_of(err: str) -> dict[str, list[str]]:
    """Return what is said of each package."""
    said = dict[str, list[str]]()
    for line in (one.partition("Warning: ")[2] for one in err.splitlines()):
        name, _, text = line.partition(": ")
        said.setdefault(name, []).append(text.removesuffix("; update or remove the package"))
    return {name: texts for name, texts in said.items() if name}


def test_files_of_stoop_follow_the_forms_that_others_must_follow() -> None:
    for name in OWN:
        for kind, table in packages()[name].items():
            for row in table.values():
                check(SCHEMA["tables"][kind][1], row, name, kind)


def test_what_a_package_offers_is_used_without_an_import_before(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_hum": GOOD})
    code = """
from stoop.cli.main import main
main(["--help"]); print("stoop_hum" in sys.modules)
main(["hum", "--loud", "--seed", "3"]); main(["hum", "--whistle", "x"])
import stoop
from stoop.optimize.registry import create, names
print(stoop.tune_of(2), "tune_of" in dir(stoop), "guess" in names(), create("guess").name)
"""
    out, err = output(tmp_path, code)
    assert "hum           hum a tune\n" in out
    assert (out.splitlines()[-4:], err) == (["False", "la 3 True", "fiu x", "lala True True guess"], "")


def test_what_is_wrong_with_a_file_is_one_line_and_the_rest_works(tmp_path: Path) -> None:
    added = {f"more.identify = {{ options = [{one}] }}": said for one, said in DEFECTS["options"].items()}
    told = {f"stoop_p{i:02}": row for i, row in enumerate((DEFECTS["files"] | added).items())}
    written(tmp_path, {"stoop_hum": GOOD, **{name: (table, "") for name, (table, _) in told.items()}})
    code = """
import stoop
from stoop.cli.main import main
print([main(words.split()) for words in ("--help", "identify --help", "hum", "--help")])
print(stoop.Notice.__module__, stoop.tune_of(2))
"""
    out, err = output(tmp_path, code)
    assert out.splitlines()[-2:] == ["[0, 0, 0, 0]", "stoop.base.notices lala"]
    said = lines_of(err)
    assert sorted(said) == list(told)
    for name, (table, text) in told.items():
        assert len(said[name]) == 1, (table, said[name])
        assert text.replace("NAME", name) in said[name][0], (table, said[name])


def test_a_function_that_fails_is_one_line(tmp_path: Path) -> None:
    table = """
verbs.VERB = { summary = "s", run = "NAME.m:f", options = [] }
optimizers.NAME = { make = "NAME.m:f" }
"""
    told = {f"stoop_p{i}": row for i, row in enumerate(DEFECTS["functions"].items())}
    written(tmp_path, {name: (table.replace("VERB", name[-2:]), code) for name, (code, _) in told.items()})
    code = f"""
from stoop.cli.main import main
from stoop.optimize.registry import create
for name in {list(told)}:
    print(main([name[-2:]]))
    try: create(name)
    except Exception as error: print(f"stoop: error: {{error}}", file=sys.stderr)
"""
    out, err = output(tmp_path, code)
    assert out.split() == ["2"] * len(told)
    texts = [text.replace("NAME", name) for name, (_, text) in told.items() for _ in range(2)]
    for line, name, text in zip(err.splitlines(), sorted([*told, *told]), texts, strict=True):
        assert line.startswith(f"stoop: error: {name}: {text}")


def test_a_fit_is_the_same_beside_packages_that_fail(tmp_path: Path) -> None:
    table = """
functions.NAME = "NAME.m:f"
methods = { NAME = "NAME.m:f", result = "NAME.m:f" }
decisions.NAME = { question = "q", default = true, data = "NAME.m:f", problem = "NAME.m:f", around = "NAME.m:f" }
"""
    for hook in ("judge_mapping", "check_motors", "measured_modes", "response_misfits", "advice"):
        table += f"hooks.{hook} = 'NAME.m:f'\n"
    code = """
import pydoc, stoop
from stoop.checks.vehicle import check_vehicle
from stoop.flight.load import with_contradictions
from stoop.workflow.demo import identify_demo
model, _ = identify_demo(0)
pydoc.render_doc(stoop), pydoc.render_doc(stoop.FittedModel)
print({name: one.estimate for name, one in model.result.parameters.items()}, *model.result.notices)
print(*check_vehicle(model.vehicle, {"demo": model.flights[0]}), *with_contradictions(model.flights[0]).faults)
"""
    alone, _ = output(tmp_path, code)
    written(tmp_path, {f"stoop_p{i}": (table, one) for i, one in enumerate(DEFECTS["functions"])})
    out, err = output(tmp_path, code)
    assert out == alone
    kinds = ["Change | None", "Fitted", "list[MeasuredMode]", "list[Notice]", "list[ResponseMisfit]"]
    for i, text in enumerate(DEFECTS["functions"].values()):
        taken, *said = lines_of(err)[f"stoop_p{i}"]
        assert taken == "'result' in [methods] is a name of stoop already; rename it"
        assert all(line.startswith(text.replace("NAME", f"stoop_p{i}")) for line in said)
        assert sorted(line.partition(" is no ")[2] for line in said) == (kinds if "gives" in text else [""])


def test_of_a_hook_that_takes_one_function_the_first_is_used_and_the_other_named(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_aaa": ("hooks.find_windows = 'NAME.m:f'", "def f(*_): return 3")})
    code = "from stoop.base.packages import hook\nfor _ in 'ab': print(hook('find_windows', 'x', int).__module__)"
    out, err = output(tmp_path, code)
    assert out == "stoop_plan.input_design.windows\n" * 2
    assert lines_of(err) == {"stoop_aaa": ["its find_windows is not used, as that of stoop_plan is"]}


def test_a_package_that_a_finder_imports_is_found_by_its_installation(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "stoop_hum-1.0.dist-info").mkdir()
    written(tmp_path / "elsewhere", {"stoop_hum": GOOD})
    code = """
from importlib.machinery import PathFinder
class Finder:
    def find_spec(name, *_): return PathFinder.find_spec(name, ["elsewhere"]) if name == "stoop_hum" else None
sys.meta_path.append(Finder)
import stoop
print("tune_of" in dir(stoop), "stoop_hum" in sys.modules, stoop.tune_of(2))
"""
    assert output(tmp_path, code) == ("True False lala\n", "")


def test_an_unknown_name_is_answered_with_the_nearest(tmp_path: Path) -> None:
    out, _ = output(tmp_path, "import stoop\ntry: stoop.lineariz\nexcept AttributeError as e: print(e)")
    assert out == "module 'stoop' has no attribute 'lineariz'; did you mean linearize?\n"


def test_packages_in_the_folder_of_a_call_are_not_read(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_hum": GOOD})
    quiet = os.environ | {"PYTHONPATH": str(SOURCE)}
    words = [sys.executable, "-m", "stoop", "--help"]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=tmp_path, env=quiet)
    assert "hum a tune" not in done.stdout
