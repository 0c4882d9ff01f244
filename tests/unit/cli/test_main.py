"""The entry point: verbs, exit codes, one line of complaint, and nothing heavy before a verb is chosen."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import time
import types
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from stoop.base.verbs import Verb
from stoop.cli.main import VERBS, main
from stoop.errors import StoopError

HEAVY = (
    "numpy",
    "scipy",
    "sympy",
    "numba",
    "xarray",
    "pandas",
    "pydantic",
    "rich",
    "stoop.vehicle",
    "stoop.flight",
)


def verb(monkeypatch: pytest.MonkeyPatch, run: Callable[[object], int]) -> None:
    """Register a verb called `fake`."""
    module = types.ModuleType("fake_verb")
    module.run = run  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "fake_verb", module)
    monkeypatch.setitem(VERBS, "fake", Verb("fake", "does what the test says", "fake_verb:run"))


def raising(error: BaseException) -> Callable[[object], int]:
    def run(_: object) -> int:
        raise error

    return run


def test_help_lists_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for name, verb in VERBS.items():
        assert re.search(rf"^  {name} +{re.escape(verb.summary)}$", out, re.MULTILINE)
    assert all(len(line) <= 90 for line in out.splitlines())


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert importlib.util.find_spec(VERBS[name].run.partition(":")[0]) is not None
    assert main([name, "--help"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"usage: stoop {name}")
    assert "--debug" in out
    assert err == ""


def test_help_imports_nothing_heavy() -> None:
    words = "import sys; from stoop.cli.main import main; main(sys.argv[1:]); print(*sys.modules)"
    for arguments in (
        ["--help"],
        ["info", "--help"],
        ["simulate", "--help"],
        ["trim", "--help"],
        ["linearize", "--help"],
    ):
        done = subprocess.run(
            [sys.executable, "-c", words, *arguments], capture_output=True, text=True, check=True
        )
        loaded = set(done.stdout.splitlines()[-1].split())
        assert not loaded & set(HEAVY), arguments


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert re.fullmatch(r"stoop \d+\.\d+\S*\n", capsys.readouterr().out)


def test_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stoop", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("stoop ")


@pytest.mark.parametrize(
    "words", [[], ["nosuch"], ["trim"], ["trim", "twin-boom", "--nosuch"], ["--nosuch"], ["info", "a", "b"]]
)
def test_wrong_arguments_are_told_in_one_line(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("stoop: error: ")
    assert err.endswith("--help)\n")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("identfy", "there is no verb 'identfy'; did you mean identify? (see stoop --help)"),
        ("Trim", "there is no verb 'Trim'; did you mean trim? (see stoop --help)"),
        ("reprodce", "there is no verb 'reprodce'; did you mean reproduce? (see stoop --help)"),
        ("vehcle new", "there is no verb 'vehcle'; did you mean vehicle or vehicle new? (see stoop --help)"),
        ("--debgu trim", "there is no option --debgu; did you mean --debug? (see stoop --help)"),
        (
            "identify a.ulg --vehicel=v.toml --maneuver 1:2 -o out",
            "there is no option --vehicel; did you mean --vehicle? (see stoop identify --help)",
        ),
        (
            "vehicle new --masss 3 -o v.toml",
            "there is no option --masss; did you mean --mass? (see stoop vehicle new --help)",
        ),
    ],
)
def test_mistyped_names_are_told_with_the_nearest(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert capsys.readouterr().err == f"stoop: error: {message}\n"


@pytest.mark.parametrize("words", [["trim", "--", "--vehicel"], ["trim", "--vehicel of mine"]])
def test_what_is_a_value_is_taken_for_no_option(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """As argparse reads them: after two dashes, or with a blank. Here they name a vehicle that does not exist."""
    assert main(words) == 2
    assert "there is no option" not in capsys.readouterr().err


def test_verb_decides_the_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    verb(monkeypatch, lambda _: 7)
    assert main(["fake"]) == 7


def test_mendable_error_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("STOOP_DEBUG", raising=False)
    verb(monkeypatch, raising(StoopError("a.toml: \x1b[31mwrong\x1b[0m; mend it")))
    assert main(["fake"]) == 2
    assert capsys.readouterr().err == "stoop: error: a.toml: \\x1b[31mwrong\\x1b[0m; mend it\n"


def test_further_lines_of_an_error_are_a_file_to_start_from(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    verb(monkeypatch, raising(StoopError('a.csv: save the lines below\n[time]\nunit = "s"')))
    assert main(["fake"]) == 2
    out, err = capsys.readouterr()
    assert err == "stoop: error: a.csv: save the lines below\n"
    assert out == '[time]\nunit = "s"\n'


@pytest.mark.parametrize("words", [["fake", "--debug"], ["--debug", "fake"]])
def test_debug_shows_the_traceback(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    verb(monkeypatch, raising(StoopError("a.toml: wrong; mend it")))
    assert main(words) == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.endswith("stoop: error: a.toml: wrong; mend it\n")


def test_debug_by_environment(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("STOOP_DEBUG", "1")
    verb(monkeypatch, raising(StoopError("a.toml: wrong; mend it")))
    assert main(["fake"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_interrupt(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    verb(monkeypatch, raising(KeyboardInterrupt()))
    assert main(["fake"]) == 130
    assert capsys.readouterr().err == "stoop: interrupted\n"


def test_an_interrupt_amid_an_import(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A compiled module that is interrupted while it is imported raises an ImportError, and a verb an error of its own."""

    def run(_: object) -> int:
        try:
            raise ImportError("initialization failed") from KeyboardInterrupt()
        except ImportError:
            raise StoopError("this needs a library") from None

    verb(monkeypatch, run)
    assert main(["fake"]) == 130
    assert capsys.readouterr().err == "stoop: interrupted\n"


def test_a_step_of_the_app_is_stopped_at_once(tmp_path: Path) -> None:
    """However early Ctrl-C comes, it is no bug."""
    from stoop.app.steps import start

    step = start(tmp_path, "designs", lambda name: ["design", "quad-x", "-o", f"{name}/design.toml"])
    step.stop()
    while step.running:
        time.sleep(0.05)
    assert step.error == "stopped before there was a result"


def test_bug_shows_its_traceback_and_asks_for_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    verb(monkeypatch, raising(ZeroDivisionError("by zero")))
    assert main(["fake"]) == 1
    err = capsys.readouterr().err
    assert "ZeroDivisionError: by zero" in err
    assert "report" in err.splitlines()[-1]


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), "the memory is not enough for this; give less data"),
        (PermissionError(13, "Permission denied", "a.ulg"), "a.ulg: Permission denied"),
    ],
)
def test_fault_of_the_machine_is_one_line(
    error: BaseException, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    verb(monkeypatch, raising(error))
    assert main(["fake"]) == 2
    assert capsys.readouterr().err == f"stoop: error: {told}\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written(flight_file: Path, unbuffered: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "stoop", "info", str(flight_file)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
    assert done.returncode == 2
    assert done.stderr == "stoop: error: the output: No space left on device\n"


@pytest.mark.parametrize("words", [["info", "FLIGHT"], ["info", "FLIGHT", "--json"]])
def test_reader_that_leaves_early_is_no_error(words: list[str], flight_file: Path) -> None:
    arguments = [str(flight_file) if word == "FLIGHT" else word for word in words]
    with subprocess.Popen(
        [sys.executable, "-m", "stoop", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 141


def test_warnings_of_libraries_do_not_reach_the_user(tmp_path: Path) -> None:
    module = "import warnings\ndef run(arguments): warnings.warn('boo'); return 0\n"
    (tmp_path / "noisy.py").write_text(module)
    registered = "m.VERBS['noisy'] = m.Verb('noisy', 'warns', 'noisy:run')"
    words = f"import sys; from stoop.cli import main as m; {registered}; sys.exit(m.main())"
    command = [sys.executable, "-c", words, "noisy"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stderr == ""
    loud = subprocess.run([*command, "--debug"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "boo" in loud.stderr


def test_old_table_of_another_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = types.ModuleType("old_plugin")
    module.verbs = {"hum": ("old_plugin:run", "hum a tune")}  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "old_plugin", module)
    points = [EntryPoint("hum", "old_plugin:verbs", "stoop.verbs")]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: points)
    assert main(["hum"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("stoop: error: old_plugin:verbs: no table of verbs; update or remove its package")
