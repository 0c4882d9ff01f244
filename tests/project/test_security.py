"""Claims of docs/security.md that no other test holds: what the source calls, what a run reaches, what workers listen to."""

import functools
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.works import HERE, sockets

import stoop
from stoop.base import cache, files
from stoop.errors import LogError
from stoop.logs import guard
from stoop.parallel import LocalProcesses, Plan, Run, execute

PACKAGE = Path(stoop.__file__ or "").parent
EXAMPLES = Path(__file__).parents[2] / "examples"
#: prints what it was forbidden to do, and refuses it
WATCHED = """
import os, sys
network = ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo", "socket.listen",
           "socket.gethostbyname", "urllib.Request", "http.client.connect", "ftplib.connect", "smtplib.connect")
allowed = tuple(os.environ["ALLOWED"].split(os.pathsep))
def watch(event, arguments):
    if event in network:
        refuse(event, arguments)
    wanted = arguments[:1]
    if event == "open" and not isinstance(arguments[0], int) and not (
        set(str(arguments[1] or "")) & set("wax+") or (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
    ):
        return
    if event in ("os.rename", "os.link", "os.symlink"):
        wanted = arguments[:2]
    elif event not in ("open", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"):
        return
    for path in wanted:
        if not isinstance(path, int) and not os.path.abspath(os.fsdecode(path)).startswith(allowed):
            refuse(event, arguments)
def refuse(*what):
    os.write(2, ("forbidden: " + repr(what) + "\\n").encode())
    os._exit(99)
sys.addaudithook(watch)
from stoop.cli.main import main
code = main(sys.argv[1:])
print("done", code)
sys.exit(code)
"""


# What the source calls; the rules S of Ruff forbid evaluation, pickles, shells and insecure temporary files.


@functools.cache
def sources() -> dict[str, str]:
    own = [p for p in PACKAGE.parent.glob("stoop*/**/*.py") if "stoop_studies" not in p.parts]
    return {
        p.relative_to(PACKAGE.parent).as_posix().removeprefix("stoop/"): p.read_text("utf-8") for p in own
    }


def places(pattern: str) -> set[str]:
    """Return the files of the package in whose code a pattern is found."""
    return {name for name, text in sources().items() if re.search(pattern, text, re.MULTILINE)}


def test_programs_connections_and_servers_have_one_place_each() -> None:
    """The child that reads formats of others, the steps of the app, its browser, the C compiler; a Dask client; the app."""
    starters = r"\b(subprocess\.(run|Popen|call|check_\w+)|os\.(system|popen|exec\w*|spawn\w*|posix_spawn\w*)|pty\.\w+)\("
    assert places(starters) == {"logs/guard.py", "stoop_app/steps.py", "stoop_export/fmu.py"}
    assert places(r"\bwebbrowser\.\w+\(") == {"stoop_app/server.py"}
    network = r"^\s*(import|from) (socket|socketserver|http|urllib|ssl|requests|httpx|aiohttp|ftplib|smtplib|asyncio)\b"
    assert places(network) == {"parallel/pools.py", "parallel/worker.py"}
    assert places(r"\bsocket\.(?!gethostname|create_connection|timeout)\w+\(") == set()
    assert all(
        place.startswith("stoop_app/") for place in places(r"^\s*(import|from) (tornado|bokeh|panel)\b")
    )
    assert places(r'^ADDRESS\b.* = "127\.0\.0\.1"') == {"stoop_app/server.py"}
    assert places(r"\bget_server\(") == {"stoop_app/server.py"}
    assert places(r"exec_module\(|source_to_code\(") == {"kernels/generated.py", "stoop_export/exporter.py"}


def test_temporary_folders_are_closed_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    modes: list[int] = []

    def note(folder: Path) -> None:
        modes.append(stat.S_IMODE(folder.stat().st_mode))

    def run_child(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        note(folder)
        raise LogError("enough")

    monkeypatch.setattr(guard, "run_child", run_child)
    with pytest.raises(LogError, match="enough"):
        guard.read_in_child("matlab", tmp_path)
    with files.scratch(tmp_path) as folder:
        note(folder)
    private = cache.private()
    note(private)
    cache.discard(private)
    assert modes == [0o700] * 3


def test_environment_variables_are_those_of_the_page() -> None:
    pattern = re.compile(r"""(?:environ\.get|getenv)\(\s*["']([A-Z_]+)["']""")
    read = {name for text in sources().values() for name in pattern.findall(text)}
    page = (Path(__file__).parents[2] / "docs" / "security.md").read_text(encoding="utf-8")
    assert read == set(re.findall(r"^\| `([A-Z_]+)` \|", page, re.MULTILINE)) - {"TMPDIR"}


def test_a_module_beside_a_log_is_not_imported_by_the_child(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from scipy.io import savemat

    from stoop.logs import read

    savemat(tmp_path / "a.mat", {"t": [0.0, 1.0, 2.0], "p": [1.0, 2.0, 3.0]})
    for name in ("scipy.py", "json.py", "numpy.py"):
        (tmp_path / name).write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    assert read(Path("a.mat")).streams


# What a run reaches.


def watched(folder: Path, *words: str) -> str:
    """Run a verb that may write in a folder, the cache of compiled code and the folder of temporary files only."""
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    compiled = cache.cache_folder()
    compiled.parent.mkdir(parents=True, exist_ok=True)  # a new user has none
    allowed = [str(folder), str(compiled), "/dev/null"]
    environment = {**os.environ, "ALLOWED": os.pathsep.join(allowed), "TMPDIR": str(temporary),
                   "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
    command = [sys.executable, "-c", WATCHED, *words]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert "forbidden" not in done.stderr, done.stderr
    assert "done 0" in done.stdout, done.stderr
    assert not list(temporary.iterdir()), "temporary files are removed"
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("security")
    text = (PACKAGE / "data" / "twin_boom.toml").read_text(encoding="utf-8")
    (place / "v.toml").write_text(text.replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = ['))
    maneuver = str(EXAMPLES / "maneuver_3211.toml")
    watched(place, "simulate", "v.toml", "--maneuver", maneuver, "-o", "f.nc")
    return place


def test_the_watch_sees_what_is_forbidden(tmp_path: Path) -> None:
    for line in ("import socket; socket.create_connection(('127.0.0.1', 9))", "open('/tmp/x', 'w')"):
        program = WATCHED.partition("from stoop")[0] + line
        done = subprocess.run([sys.executable, "-c", program], env={**os.environ, "ALLOWED": str(tmp_path)},
                              capture_output=True, text=True, check=False)  # fmt: skip
        assert done.returncode == 99
        assert "forbidden" in done.stderr


def test_reading_a_log_reaches_no_network_and_writes_nothing_elsewhere(folder: Path) -> None:
    from scipy.io import savemat

    watched(folder, "info", "f.nc")
    savemat(folder / "a.mat", {"t": [float(k) for k in range(50)], "p": [0.1 * (k % 7) for k in range(50)]})
    (folder / "a.mat.toml").write_text('[variables]\np = { stream = "data", column = "p", unit = "rad/s" }\n')
    watched(folder, "info", "a.mat")


def test_a_fit_reaches_no_network_and_writes_nothing_elsewhere(folder: Path) -> None:
    words = [
        "--vehicle",
        "v.toml",
        "--maneuver",
        "0:20",
        "--validate",
        "20:28",
        "--budget",
        "300",
        "-o",
        "fit",
    ]
    assert "CLalpha" in watched(folder, "identify", "f.nc", *words)


# What workers listen to.


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="no such files on this system")
def test_workers_on_this_machine_have_no_sockets_that_others_reach(tmp_path: Path) -> None:
    runs = [Run(str(k), f"{HERE}:sockets", {"k": k}) for k in range(2)]
    found = execute(Plan("sockets", {}, runs), tmp_path / "s.sqlite", LocalProcesses(2))
    assert list(found.values()) == [[], []]
    import socket

    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        own.listen()
        assert sockets({}, [None]) == [["tcp"]], "what is there is found"
