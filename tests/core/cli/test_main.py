"""The entry point: verbs, exit codes, one line of complaint, and nothing heavy before a verb is chosen."""

import importlib.util
import re
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.command_line import Cli

from stoop.base.verbs import Verb, verbs
from stoop.errors import StoopError

HEAVY = set("numpy scipy sympy numba xarray pandas pydantic rich stoop.vehicle stoop.flight".split())  # noqa: SIM905


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[object], int]], None]:
    def register(run: Callable[[object], int]) -> None:
        module = types.ModuleType("fake_verb")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "fake_verb", module)
        monkeypatch.setitem(verbs(), "fake", Verb("fake", "does what the test says", "fake_verb:run"))

    monkeypatch.delenv("STOOP_DEBUG", raising=False)
    return register


def raising(error: BaseException) -> Callable[[object], int]:
    def run(_: object) -> int:
        raise error

    return run


def test_help_lists_every_verb_and_each_explains_itself(cli: Cli) -> None:
    code, out, err = cli("--help")
    assert (code, err) == (0, "")
    assert all(len(line) <= 90 for line in out.splitlines())
    for name, verb in verbs().items():
        assert re.search(rf"^  {name} +{re.escape(verb.summary)}$", out, re.MULTILINE)
        assert importlib.util.find_spec(verb.run.partition(":")[0]) is not None
        code, told, err = cli([name, "--help"])
        assert (code, err) == (0, "")
        assert told.startswith(f"usage: stoop {name}")
        assert "--debug" in told
    code, out, err = cli("--version")
    assert code == 0
    assert re.fullmatch(r"stoop \d+\.\d+\S*\n", out)
    code, out, err = cli("")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"stoop: error: [^\n]*--help\)\n", err)


def test_help_imports_nothing_heavy() -> None:
    words = "import sys; from stoop.cli.main import main\nfor w in sys.argv[1:]: main(w.split())\nprint(*sys.modules)"
    helps = ["--help", *(f"{verb} --help" for verb in ("info", "simulate", "trim", "linearize"))]
    done = subprocess.run([sys.executable, "-c", words, *helps], capture_output=True, text=True, check=True)
    assert not set(done.stdout.splitlines()[-1].split()) & HEAVY


def test_what_is_a_value_is_taken_for_no_option(cli: Cli) -> None:
    """As argparse reads them: after two dashes, or with a blank. Here they name a vehicle that does not exist."""
    for words in (["trim", "--", "--vehicel"], ["trim", "--vehicel of mine"]):
        code, _, err = cli(words)
        assert code == 2
        assert "there is no option" not in err


#: error of a verb -> exit code, stdout, stderr
ERRORS: list[tuple[BaseException, int, str, str]] = [
    (StoopError("a.toml: \x1b[31mwrong\x1b[0m; mend it"), 2, "", "error: a.toml: \\x1b[31mwrong\\x1b[0m; mend it"),
    (StoopError('a.csv: save the lines below\n[time]\nunit = "s"'), 2, '[time]\nunit = "s"\n',
     "error: a.csv: save the lines below"),
    (KeyboardInterrupt(), 130, "", "interrupted"),
    (MemoryError(), 2, "", "error: the memory is not enough for this; give less data"),
    (PermissionError(13, "Permission denied", "a.ulg"), 2, "", "error: a.ulg: Permission denied"),
]  # fmt: skip


def test_errors_and_bugs(fake: Callable[..., None], cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(lambda _: 7)
    assert cli("fake").code == 7  # type: ignore[attr-defined]
    for error, code, out, err in ERRORS:
        fake(raising(error))
        assert cli("fake") == (code, out, f"stoop: {err}\n")
    fake(raising(ZeroDivisionError("by zero")))
    code, _, err = cli("fake")
    assert code == 1
    assert "ZeroDivisionError: by zero" in err
    assert "report" in err.splitlines()[-1]
    fake(raising(StoopError("a.toml: wrong; mend it")))
    for words, by_environment in (("fake --debug", False), ("--debug fake", False), ("fake", True)):
        if by_environment:
            monkeypatch.setenv("STOOP_DEBUG", "1")
        code, _, err = cli(words)
        assert code == 2
        assert "Traceback" in err
        assert err.endswith("stoop: error: a.toml: wrong; mend it\n")


def test_an_interrupt_amid_an_import(fake: Callable[..., None], cli: Cli) -> None:
    """A compiled module that is interrupted while it is imported raises an ImportError, and a verb an error of its own."""

    def run(_: object) -> int:
        try:
            raise ImportError("initialization failed") from KeyboardInterrupt()
        except ImportError:
            raise StoopError("this needs a library") from None

    fake(run)
    assert cli("fake") == (130, "", "stoop: interrupted\n")


def test_warnings_of_libraries_do_not_reach_the_user(tmp_path: Path) -> None:
    module = "import warnings\ndef run(arguments): warnings.warn('boo'); return 0\n"
    (tmp_path / "noisy.py").write_text(module)
    registered = "m.verbs()['noisy'] = m.Verb('noisy', 'warns', 'noisy:run')"
    words = f"import sys; from stoop.cli import main as m; {registered}; sys.exit(m.main())"
    command = [sys.executable, "-c", words, "noisy"]
    quiet, loud = (
        subprocess.run([*command, *more], cwd=tmp_path, capture_output=True, text=True, check=True).stderr
        for more in ([], ["--debug"])
    )
    assert quiet == ""
    assert "boo" in loud
