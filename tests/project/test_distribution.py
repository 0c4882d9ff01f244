"""What is published: the content of sdist and wheel, the page that a package index shows, and one address everywhere."""

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Collection
from email import message_from_bytes
from email.message import Message
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
URLS = PROJECT["urls"]
AT_TOP = {
    *("src", "tests", "docs", "examples", "benchmarks", "scripts", "README.md", "LICENSE", "CHANGELOG.md"),
    *("CITATION.cff", "CONTRIBUTING.md", "pyproject.toml", "PKG-INFO", ".gitignore"),
}
CACHES = ("__pycache__", ".pyc", ".pytest_cache", ".mypy_cache", ".ruff_cache", ".hypothesis", ".DS_Store")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an sdist, and of the wheel that was built from it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> dict[str, bytes]:
    """Return the files of the wheel."""
    with zipfile.ZipFile(next(built.glob("*.whl"))) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def metadata(wheel: dict[str, bytes]) -> Message:
    """Return the metadata of the wheel; the payload is the page of the package."""
    return message_from_bytes(wheel[f"stoop-{PROJECT['version']}.dist-info/METADATA"])


def sources() -> set[str]:
    """Return the files of the packages in this folder, as a wheel names them."""
    files = (p for p in (ROOT / "src").rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {p.relative_to(ROOT / "src").as_posix() for p in files if ".egg-info" not in str(p)}


def test_sdist_holds_what_the_checks_need_and_nothing_else(built: Path) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        names = [name.split("/", 1)[1] for name in archive.getnames()]
    assert {name.split("/", 1)[0] for name in names} == AT_TOP
    assert not [name for name in names if any(part in name for part in CACHES)]
    assert {n.removeprefix("src/") for n in names if n.startswith("src/")} == sources()


def test_wheel_holds_the_packages_and_nothing_else(wheel: dict[str, bytes]) -> None:
    dist_info = f"stoop-{PROJECT['version']}.dist-info/"
    files = {path for path in (ROOT / "examples").rglob("*.*") if "__pycache__" not in path.parts}
    examples = {f"stoop/data/{path.relative_to(ROOT).as_posix()}" for path in files}
    assert {name for name in wheel if not name.startswith(dist_info)} == sources() | examples
    assert "stoop/py.typed" in wheel
    entry_points = wheel[f"{dist_info}entry_points.txt"].decode()
    assert "stoop = stoop.cli.main:main" in entry_points


def install(wheel: dict[str, bytes], folder: Path, absent: Collection[str] = ()) -> None:
    for name, content in wheel.items():
        if name.partition("/")[0] not in absent:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)


def test_a_wheel_copies_its_examples(wheel: dict[str, bytes], tmp_path: Path) -> None:
    install(wheel, tmp_path / "installed")
    command = [sys.executable, "-m", "stoop", "example", "vtail", "-o", "copied"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "installed")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("vtail.ipynb", "vtail.toml"):
        assert (tmp_path / "copied" / name).read_bytes() == (ROOT / "examples" / name).read_bytes()


def test_page_of_the_package_has_no_relative_links(metadata: Message) -> None:
    """What the README links in the repository is linked, and shown, under the tag of the version."""
    assert (metadata["Description-Content-Type"], metadata["License-Expression"]) == ("text/markdown", "MIT")
    assert {u.split(", ")[0] for u in metadata.get_all("Project-URL", [])} == set(URLS)
    payload = metadata.get_payload(decode=True)
    assert isinstance(payload, bytes)
    links = re.findall(r"\]\(([^)\s]+)", payload.decode("utf-8"))
    assert any(f"{URLS['Source']}/blob/v{PROJECT['version']}/" in link for link in links)
    assert [link for link in links if not link.startswith(("https://", "#"))] == []


PACKAGES = [Path(p).name for p in PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"][1:]]
IDENTIFY = "identify made/flight.nc --vehicle made/vehicle.toml"
WORK = (
    "demo -o made", "linearize made", "info made/flight.nc", "info p.csv", f"{IDENTIFY} --maneuver 0:20 -o again",
    "validate again made/flight.nc --maneuver 20:30 --open-loop -o judged",
)  # fmt: skip
GAINS = "RRP RRI RRFF PRP PRI PRFF YRP YRI YRFF"
DESIGN = "design made --shape doublet --evaluations 9 -o designed"  #: works without the studies
#: what else is refused without a package
NEEDED = {
    "stoop_analysis": (f"{IDENTIFY} --maneuver 0:20 --posterior -o x", "export made --to state-space -o x"),
    "stoop_draft": ("tune made gains.params",),
    "stoop_plan": (f"{IDENTIFY} w.toml -o x",),
}
CODE = """
import contextlib, io, json, sys
sys.path.insert(0, PLACE)
from stoop.base.verbs import verbs
from stoop.cli.main import main
def refused(words):
    with contextlib.redirect_stderr(io.StringIO()) as said:
        return main(words.split()), said.getvalue()
codes = [main([*name.split(), "--help"]) for name in verbs()], [main(words.split()) for words in WORK]
json.dump([list(verbs()), codes, [refused(words) for words in REFUSED]], open("answers.json", "w"))
"""


@pytest.mark.parametrize("absent", [*PACKAGES, "all"])
def test_without_a_package_its_verbs_are_absent_and_the_rest_works(
    absent: str, wheel: dict[str, bytes], tmp_path: Path
) -> None:
    gone = PACKAGES if absent == "all" else [absent]
    install(wheel, tmp_path / "installed", gone)
    for library in Path(np.__file__).parents[1].iterdir():
        if "stoop" not in library.name:
            (tmp_path / "installed" / library.name).symlink_to(library)
    (tmp_path / "p.csv").write_text("t,p\n" + "".join(f"{0.02 * k},{k % 7}\n" for k in range(200)))
    lines = "[time]\ncolumn = 't'\nunit = 's'\n[variables]\np = {column = 'p', unit = 'deg/s'}\n"
    (tmp_path / "p.csv.toml").write_text(lines)
    (tmp_path / "gains.params").write_text("".join(f"FW_{n[:2]}_{n[2:]},0.1\n" for n in GAINS.split()))
    verbs = {p: list(tomllib.loads(wheel[f"{p}/stoop.toml"].decode()).get("verbs", ())) for p in PACKAGES}
    asked = [words for p in gone for words in (*verbs[p], *NEEDED.get(p, ()))]
    work = (*WORK, *[DESIGN] * (absent == "stoop_studies"))
    code = f"PLACE, WORK, REFUSED = {str(tmp_path / 'installed')!r}, {work}, {asked}\n{CODE}"
    command = [sys.executable, "-I", "-S", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names, (helped, worked), refused = json.loads((tmp_path / "answers.json").read_text())
    every = {name for own in verbs.values() for name in own}
    assert every - set(names) == {name for p in gone for name in verbs[p]}
    assert set(helped) == {0}
    assert worked == [0] * len(work), done.stderr
    assert ("signs, units and axes were not compared" in done.stdout) == ("stoop_draft" in gone)
    for words, (status, said) in zip(asked, refused, strict=True):
        assert (status, said.count("\n"), said[:14]) == (2, 1, "stoop: error: "), (words, said)
        assert " " in words or f"there is no verb '{words}'" in said
