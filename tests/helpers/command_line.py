"""The command line in this process, a small flight file, and a fitted model, each made once, for tests of all packages."""

import contextlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from stoop.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "examples"
Cli, Done, Refused = Callable[..., tuple[int, str, str]], Callable[..., str], Callable[..., str]


class Answer(NamedTuple):
    code: int
    out: str
    err: str


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


@pytest.fixture(scope="session")
def examples() -> Path:
    return EXAMPLES


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Return what runs a command line: a text that is split at blanks or a list of words."""

    def run(command: str | Sequence[object]) -> Answer:
        capsys.readouterr()
        code = main(command.split() if isinstance(command, str) else [*map(str, command)])
        return Answer(code, *capsys.readouterr())

    return run


@pytest.fixture
def done(cli: Callable[..., Answer]) -> Callable[..., str]:
    def run(command: str | Sequence[object]) -> str:
        answer = cli(command)
        assert answer.code == 0, answer
        return answer.out

    return run


@pytest.fixture
def refused(cli: Cli, here: Path) -> Refused:
    """Return what runs a command in an empty folder and gives its one line of complaint; every file stays as it was."""

    def run(command: str | Sequence[object]) -> str:
        before = contents(here)
        code, out, err = cli(command)
        assert code == 2, command
        *progress, line = err.removesuffix("\n").split("\n")
        assert line.startswith("stoop: error: "), err
        assert all(one.isprintable() for one in (*progress, line, *out.split("\n")))
        assert not any("rror" in one for one in progress), err
        assert contents(here) == before, command
        return f"{line}\n{out}"

    return run


@pytest.fixture(scope="session")
def flight_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the 3-2-1-1 of the twin-boom aircraft, written by the command line itself."""
    path = tmp_path_factory.mktemp("flights") / "flight.nc"
    maneuver = str(EXAMPLES / "maneuver_3211.toml")
    assert main(["simulate", "twin-boom", "--maneuver", maneuver, "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="session")
def hover_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a quadrotor's flight of 40 s: a 3-2-1-1 of roll at 10 s and one of yaw at 25 s."""
    folder = tmp_path_factory.mktemp("hover")
    shape = '[[input]]\ncontrol = "{}"\nshape = "3-2-1-1"\nstart = {}\nstep = {}\namplitude = {}\n'
    inputs = shape.format("roll", 10.0, 0.15, 15.0) + shape.format("yaw", 25.0, 0.4, 1.0)
    (folder / "m.toml").write_text(f"duration = 40.0\nrate = 100.0\naltitude = 200.0\n{inputs}")
    words = ["simulate", "quad-x", "--maneuver", folder / "m.toml", "-o", folder / "quad.nc"]
    assert main([*map(str, words)]) == 0
    return folder / "quad.nc"


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder of the demonstration, a fit of ten coefficients, and what the command printed."""
    folder, shown = tmp_path_factory.mktemp("demo") / "demo", io.StringIO()
    with contextlib.redirect_stdout(shown):
        assert main(["demo", "-o", str(folder)]) == 0
    return folder, shown.getvalue()


@pytest.fixture(scope="session")
def fitted(demo: tuple[Path, str]) -> Path:
    return demo[0]
