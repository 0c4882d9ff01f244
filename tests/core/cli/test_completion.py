"""Completion, asked of bash itself; the scripts of zsh and fish are read by these where they are installed."""

import argparse
import os
import shutil
import subprocess
from pathlib import Path

import pytest
import shtab
from helpers.command_line import Cli

from stoop.base.verbs import verbs
from stoop.cli.completion import all_parsers
from stoop.cli.main import parser_for
from stoop.vehicle.builtin import BUILT_IN

#: each line of the input is the words of a command; prints the completions of the last, a line of tabs for each
BASH = """
source "$1"
while IFS= read -r line; do
    IFS=$'\\t' read -ra COMP_WORDS <<< "$line"; [[ $line == *$'\\t' ]] && COMP_WORDS+=("")
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=()
    _shtab_stoop 2> /dev/null # compopt complains where nobody types
    (IFS=$'\\t'; echo "${COMPREPLY[*]}")
done
"""
SHELLS = tuple(verbs()["completion"].option("shell").choices)
pytestmark = pytest.mark.skipif(os.name == "nt", reason="paths of Windows are not those of its bash")


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the scripts, and another to work in: a log, a vehicle file, and a folder."""
    made = tmp_path_factory.mktemp("scripts")
    parsers = all_parsers()
    for shell in SHELLS:
        (made / shell).write_text(shtab.complete(parsers, shell) + "\n", encoding="utf-8")
    (made / "work" / "result").mkdir(parents=True)
    for name in ("flight.ulg", "my.toml"):
        (made / "work" / name).touch()
    return made


def asked(scripts: Path, commands: list[list[str]]) -> list[set[str]]:
    done = subprocess.run(
        ["bash", "--norc", "--noprofile", "-c", BASH, "bash", str(scripts / "bash")], cwd=scripts / "work",
        input="".join("\t".join(["stoop", *words]) + "\n" for words in commands), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert not done.stderr
    return [{word.rstrip("/") for word in line.split("\t")} - {""} for line in done.stdout.splitlines()]


def options(verb: str) -> set[str]:
    actions = parser_for([verb]).verbs[verb]._actions
    return {name for action in actions for name in action.option_strings if name.startswith("--")}


COMPLETED: list[tuple[str, set[str]]] = [
    ("ident", {"identify"}), ("--", {"--help", "--version", "--debug"}), ("--debug tri", {"trim"}),
    ("vehicle ", {"new", *BUILT_IN}), ("vehicle new --geo", {"--geometry"}),
    ("vehicle quad-x --o", {"--output", "--overwrite"}), ("completion ", set(SHELLS)), ("verify cover", {"coverage"}),
    ("export my.toml --to ", set(verbs()["export"].option("target").choices)), ("identify fl", {"flight.ulg"}),
    ("identify flight.ulg --vehicle qu", {"quad-x", "quad-plus", "quadplane"}),
    ("identify flight.ulg --vehicle my", {"my.toml"}),
    ("identify flight.ulg --maneuver 1:2 3:4 --vehicle twin", {"twin-boom"}), ("identify flight.ulg -o ", {"result"}),
    ("structure my.toml flight.ulg --criterion p", {"press", "pse"}), ("trim oct", {"octo-x"}),
]  # fmt: skip


def test_words_of_commands(scripts: Path) -> None:
    wanted = [*((words.split(" "), found) for words, found in COMPLETED)]
    wanted += [([""], {name for name in verbs() if " " not in name})]
    wanted += [([*verb.split(), "--"], options(verb)) for verb in verbs()]
    found = asked(scripts, [words for words, _ in wanted])
    for (words, expected), completed in zip(wanted, found, strict=True):
        assert completed == expected, words


def arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    inner = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return [*parser._actions, *(a for i in inner for p in i.choices.values() for a in arguments(p))]


def test_every_argument_that_takes_a_path_completes_it_and_no_name_holds_a_colon() -> None:
    """A colon ends a name in the script for zsh: a window START:STOP would begin an action called STOP."""
    every = arguments(all_parsers())
    taken = [action for action in every if action.type is Path]
    assert {"flight", "mapping", "output", "result", "noise"} <= {action.dest for action in taken}
    assert not [action.dest for action in taken if not hasattr(action, "complete")]
    assert not [a.metavar for a in every if ":" in (a.metavar or "")]


@pytest.mark.parametrize("shell", SHELLS)
def test_a_script_is_printed_as_it_is_and_is_one_of_its_shell(shell: str, scripts: Path, cli: Cli) -> None:
    assert cli(["completion", shell]) == (0, (scripts / shell).read_text("utf-8"), "")
    if shutil.which(shell):
        done = subprocess.run([shell, "-n", str(scripts / shell)], capture_output=True, text=True, check=True)
        assert done.stdout + done.stderr == ""
