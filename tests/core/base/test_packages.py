"""Packages beside stoop: what they offer is found without an import, and what is wrong with one costs a line and that part."""

import os
import subprocess
import sys
from pathlib import Path

import stoop

GOOD = """
interface = 1
[verbs.hum]
summary = "hum a tune"
run = "stoop_hum.tune:run"
options = ["seed", { name = "--loud", kind = "switch", help = "louder" }]
[more.hum]
options = [{ name = "--whistle", metavar = "SONG", help = "whistle", run = "stoop_hum.tune:whistle" }]
[more."of an absent package"]
options = ["seed"]
[functions]
tune_of = "stoop_hum.tune:tune_of"
[optimizers]
guess = { make = "stoop_hum.tune:guess" }
"""
CODE = """
def run(arguments): print("la", arguments.seed, arguments.loud); return 0
def whistle(arguments): print("fiu", arguments.whistle); return 0
def tune_of(n): return "la" * n
def guess(): return "a guess"
"""
ROW = '{ summary = "s", run = "m:f", options = [] }'
BAD = {
    "stoop_other": f"interface = 1\n[verbs]\nhum = {ROW}\ntrim = {ROW}\n",
    "stoop_broken": "interface = [",
    "stoop_lost": f"interface = 1\n[verbs]\nlose = {ROW}\nwrong = {{ run = 'm:f' }}\n",
    "stoop_new": "interface = 2\n",
}
UNKNOWN = "'m:f' cannot be imported (No module named 'm')"
HOSTILE = """
interface = 1
hooks = 3
[verbs.a]
summary = "a %(prog)d"
run = "m:f"
options = []
[verbs.b]
summary = "two options"
run = "m:f"
options = ["seed", "seed"]
[more]
trim = { options = [{ name = "--zz", kind = "nosuch", help = "h" }] }
[methods]
result = "m:f"
__setattr__ = "m:f"
[functions]
fit = "m:f"
"""
SOURCE = Path(stoop.__file__).parents[1]


def written(folder: Path, packages: dict[str, str]) -> None:
    for name, text in packages.items():
        (folder / name).mkdir()
        (folder / name / "stoop.toml").write_text(text)


def output(folder: Path, code: str) -> tuple[str, str]:
    words = [sys.executable, "-c", f"import sys; sys.path[:0] = {[str(SOURCE), str(folder)]}\n{code}"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=folder)
    return done.stdout, done.stderr


def test_what_a_package_offers_is_used_without_an_import_before(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_hum": GOOD})
    (tmp_path / "stoop_hum" / "tune.py").write_text(CODE)
    code = """
from stoop.cli.main import main
main(["--help"]); print("stoop_hum" in sys.modules)
main(["hum", "--loud", "--seed", "3"]); main(["hum", "--whistle", "x"])
import stoop
from stoop.optimize.registry import create, names
print(stoop.tune_of(2), "tune_of" in dir(stoop), "guess" in names(), create("guess"))
"""
    out, err = output(tmp_path, code)
    assert "hum           hum a tune\n" in out
    assert out.splitlines()[-4:] == ["False", "la 3 True", "fiu x", "lala True True a guess"]
    assert err == ""


def test_what_is_wrong_with_a_package_is_one_line_and_the_rest_works(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_hum": GOOD, **BAD})
    out, err = output(tmp_path, "from stoop.cli.main import main; sys.argv[1:] = ['--help']; main()")
    assert "hum           hum a tune\n" in out
    assert "trim          find the controls" in out
    lines = [line.removeprefix("stoop: warning: ").partition(":") for line in err.splitlines()]
    assert [name[6:] for name, *_ in lines] == ["broken", "new", "lost", "other", "other"]
    for told in ("interface 2 of stoop, which has 1", "one of stoop_hum already", "is one of stoop already"):
        assert told in err
    out, err = output(tmp_path, "from stoop.cli.main import main; print(main(['lose']))")
    assert out == "2\n"
    assert err.splitlines()[-1] == f"stoop: error: m: {UNKNOWN}; update, install or remove the package"


def test_no_row_breaks_what_is_of_stoop(tmp_path: Path) -> None:
    (tmp_path / "later").mkdir()
    switch = '{ name = "--zz", kind = "switch", help = "h", run = "m:f" }'
    rows = f"interface = 1\n[hooks]\ncontrol_laws = 'm:f'\n[more]\ntrim = {{ options = [{switch}] }}\n[verbs]\ntune = {ROW}\n"
    written(tmp_path, {"stoop_aaa": rows, "stoop_hostile": HOSTILE})
    code = """
import stoop
from stoop.base.packages import hooks
from stoop.cli.main import main
print(main(["tune", "--help"]), main(["trim", "quad-x"]), main(["trim", "quad-x", "--zz"]))
print(stoop.fit.__module__, len(hooks("control_laws")), "result" in stoop.FittedModel.__dataclass_fields__)
"""
    out, err = output(tmp_path, code)
    assert out.splitlines()[-2:] == ["0 0 2", "stoop.workflow.identification 1 True"]
    assert "usage: stoop tune" in out
    tune, left = "'tune' of its verbs is one of stoop_tune", "its hook 'control_laws' is left out"
    for told in (tune, left, "its verb 'a'", "its verb 'b'"):
        assert told in err


def test_an_unknown_name_is_answered_with_the_nearest(tmp_path: Path) -> None:
    code = "import stoop\ntry: stoop.lineariz\nexcept AttributeError as e: print(e)"
    out, _ = output(tmp_path, code)
    assert out == "module 'stoop' has no attribute 'lineariz'; did you mean linearize?\n"


def test_a_function_that_cannot_be_imported_is_left_out_of_all(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_lost": "interface = 1\n[functions]\nlost = 'stoop_lost.f:f'\n"})
    out, err = output(tmp_path, "from stoop import *\nprint(fit.__name__, errors.__name__)")
    assert out == "identify stoop.errors\n"
    assert "stoop_lost: 'lost' is left out: stoop_lost: 'stoop_lost.f:f' cannot be imported" in err


def test_packages_in_the_folder_of_a_call_are_not_read(tmp_path: Path) -> None:
    written(tmp_path, {"stoop_hum": GOOD})
    quiet = os.environ | {"PYTHONPATH": str(SOURCE)}
    words = [sys.executable, "-m", "stoop", "--help"]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=tmp_path, env=quiet)
    assert "hum a tune" not in done.stdout
