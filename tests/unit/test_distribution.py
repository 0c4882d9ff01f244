"""What is published: the content of sdist and wheel, the page that a package index shows, and one address everywhere."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
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


def test_a_wheel_copies_its_examples(wheel: dict[str, bytes], tmp_path: Path) -> None:
    for name, content in wheel.items():
        (tmp_path / "installed" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "installed" / name).write_bytes(content)
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
