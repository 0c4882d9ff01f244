"""Completion, asked of the shells themselves: bash everywhere, zsh and fish where they are installed."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from stoop.base.verbs import verbs
from stoop.cli.completion import all_parsers
from stoop.cli.main import all_verbs, main, parser_for
from stoop.exporters.targets import TARGETS
from stoop.vehicle.builtin import BUILT_IN

Ask = Callable[..., set[str]]
BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
_shtab_stoop 2> /dev/null # compopt complains where nobody types
printf '%s\\n' "${COMPREPLY[@]}"
"""
SHELLS = tuple(verbs()["completion"].option("shell").choices)
INSTALLED = [shell for shell in SHELLS if shell == "bash" or shutil.which(shell)]
posix = pytest.mark.skipif(os.name == "nt", reason="paths of Windows are not those of its bash")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder to work in, with a log, a vehicle file, and a folder."""
    made = tmp_path_factory.mktemp("work")
    for name in ("flight.ulg", "my.toml"):
        (made / name).touch()
    (made / "result").mkdir()
    return made


def script(shell: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = folder.parent / f"{folder.name}.{shell}"
    if not path.exists():
        assert main(["completion", shell]) == 0
        path.write_text(capsys.readouterr().out, encoding="utf-8")
    return path


def asked(command: list[str], folder: Path) -> list[str]:
    home = {"HOME": str(folder.parent), "XDG_DATA_HOME": str(folder.parent)}
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=True, env={**os.environ, **home}
    )
    assert not done.stderr
    return done.stdout.splitlines()


@pytest.fixture(params=[shell for shell in INSTALLED if shell != "zsh"])
def ask(request: pytest.FixtureRequest, folder: Path, capsys: pytest.CaptureFixture[str]) -> Ask:
    """Return what asks a shell to complete the last of some words; zsh answers on a terminal only."""
    path = script(request.param, folder, capsys)

    def complete(*words: str) -> set[str]:
        if request.param == "bash":
            command = ["bash", "--norc", "--noprofile", "-c", BASH, "bash", str(path), "stoop", *words]
        else:
            command = ["fish", "--no-config", "-c", "source $argv[1]; complete -C $argv[2]", str(path)]
            command.append(" ".join(["stoop", *words]))
        return {line.partition("\t")[0].rstrip("/") for line in asked(command, folder)} - {""}

    return complete


def options(verb: str) -> set[str]:
    """Return the long options of a verb, as the command knows them."""
    return {o for o in parser_for([verb]).verbs[verb]._option_string_actions if o.startswith("--")}


@posix
def test_verbs(ask: Ask) -> None:
    assert ask("") == {name for name in all_verbs() if " " not in name}
    assert ask("ident") == {"identify"}
    assert ask("--") == {"--help", "--version", "--debug"}
    assert ask("--debug", "tri") == {"trim"}


@posix
def test_second_words(ask: Ask) -> None:
    assert ask("vehicle", "") == {"new", *BUILT_IN}
    assert ask("vehicle", "new", "--geo") == {"--geometry"}
    assert ask("vehicle", "quad-x", "--o") == {"--output", "--overwrite"}


@posix
@pytest.mark.parametrize("verb", all_verbs())
def test_options_of_each_verb(verb: str, ask: Ask) -> None:
    assert ask(*verb.split(), "--") == options(verb)


@posix
@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["completion", ""], set(SHELLS)),
        (["verify", "cover"], {"coverage"}),
        (["export", "my.toml", "--to", ""], set(TARGETS)),
        (["identify", "fl"], {"flight.ulg"}),
        (["identify", "flight.ulg", "--vehicle", "qu"], {"quad-x", "quad-plus", "quadplane"}),
        (["identify", "flight.ulg", "--vehicle", "my"], {"my.toml"}),
        (["identify", "flight.ulg", "--maneuver", "1:2", "3:4", "--vehicle", "twin"], {"twin-boom"}),
        (["identify", "flight.ulg", "-o", ""], {"result"}),
        (["structure", "my.toml", "flight.ulg", "--criterion", "p"], {"press", "pse"}),
        (["trim", "oct"], {"octo-x"}),
    ],
)
def test_values(words: list[str], completed: set[str], ask: Ask) -> None:
    assert ask(*words) == completed


@posix
@pytest.mark.parametrize("shell", INSTALLED)
def test_syntax(shell: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not asked([shell, "-n", str(script(shell, folder, capsys))], folder)


def arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    inner = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return [*parser._actions, *(a for i in inner for p in i.choices.values() for a in arguments(p))]


def test_every_argument_that_takes_a_path_completes_it() -> None:
    taken = [action for action in arguments(all_parsers()) if action.type is Path]
    assert {"flight", "mapping", "output", "result", "noise"} <= {action.dest for action in taken}
    assert not [action.dest for action in taken if not hasattr(action, "complete")]


def test_names_of_arguments_hold_no_colon() -> None:
    """A colon ends a name in the script for zsh: a window START:STOP would begin an action called STOP."""
    assert not [a.metavar for a in arguments(all_parsers()) if ":" in (a.metavar or "")]


def test_other_shells_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "tcsh"]) == 2
    assert "invalid choice: 'tcsh'" in capsys.readouterr().err


@pytest.mark.parametrize("shell", SHELLS)
def test_script_is_printed_as_it_is(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    import shtab

    assert main(["completion", shell]) == 0
    out, err = capsys.readouterr()
    assert out == shtab.complete(all_parsers(), shell) + "\n"
    assert err == ""
