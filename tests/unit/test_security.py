"""Claims of docs/security.md that no other test holds: what the source calls, what a run reaches, what workers listen to."""

from __future__ import annotations

import ast
import os
import re
import stat
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from unit.parallel.works import HERE, sockets

import stoop
from stoop.base import cache as compiled_cache
from stoop.base import files
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


@cache
def trees() -> dict[str, ast.Module]:
    """Return the parsed files of the package."""
    files = PACKAGE.rglob("*.py")
    return {p.relative_to(PACKAGE).as_posix(): ast.parse(p.read_text(encoding="utf-8")) for p in files}


# What the source never does.


@cache
def calls() -> list[tuple[str, str, ast.Call]]:
    """Return place, name and node of every call of the package."""
    nodes = ((place, node) for place, tree in trees().items() for node in ast.walk(tree))
    return [(place, ast.unparse(node.func), node) for place, node in nodes if isinstance(node, ast.Call)]


def importers(*modules: str) -> set[str]:
    """Return the files that import one of these modules."""
    found = set()
    for place, tree in trees().items():
        for node in ast.walk(tree):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.partition(".")[0] in modules for name in names):
                found.add(place)
    return found


def called(pattern: str) -> set[tuple[str, str]]:
    return {(place, name) for place, name, _ in calls() if re.fullmatch(pattern, name)}


def test_the_source_evaluates_nothing_of_others() -> None:
    """It runs code that stoop wrote itself, from a private folder; re.compile and Numba's compile are others."""
    names = r"(.*\.)?(eval|exec|compile|__import__|run_path|run_module|source_to_code|exec_module)"
    harmless = {"re.compile", "again.compile", "dispatcher.compile", "found[entry].compile"}
    assert {(place, name.rpartition(".")[2]) for place, name in called(names) if name not in harmless} == {
        ("kernels/generated.py", "exec_module"),
        ("kernels/generated.py", "source_to_code"),
        ("exporters/exporter.py", "exec_module"),
    }
    assert {place for place, _ in called(r"ast\.parse")} <= {"vehicle/terms.py", "parallel/worker.py"}
    for place, name, call in calls():
        if name.endswith("import_module"):
            chosen = (a for a in call.args if isinstance(a, ast.JoinedStr))
            assert all("stoop." in ast.unparse(a) for a in chosen), place


def test_the_source_unpickles_nothing() -> None:
    modules = ("pickle", "cPickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml")
    assert importers(*modules) == set()
    assert called(r".*\.(read_pickle|to_pickle)") == set()
    for place, name, call in calls():
        assert name not in ("np.load", "numpy.load") or "allow_pickle=False" in ast.unparse(call), place


def test_programs_and_connections_have_one_place_each() -> None:
    """The child that reads formats of others, the steps of the app, its browser, the C compiler; a Dask client."""
    starters = r"subprocess\.\w+|os\.(system|popen|exec\w*|spawn\w*|posix_spawn\w*)|webbrowser\.\w+|pty\.\w+"
    assert called(starters) == {
        ("logs/guard.py", "subprocess.run"),
        ("app/steps.py", "subprocess.Popen"),
        ("app/server.py", "webbrowser.open"),
        ("exporters/fmu.py", "subprocess.run"),
    }
    assert all("shell" not in {k.arg for k in call.keywords} for _, _, call in calls())
    network = (
        "socketserver",
        "http",
        "urllib",
        "ssl",
        "requests",
        "httpx",
        "aiohttp",
        "ftplib",
        "smtplib",
        "asyncio",
    )
    assert importers("socket", *network) == {"parallel/pools.py", "parallel/worker.py"}
    assert called(r"socket\..*") == {
        ("parallel/pools.py", "socket.create_connection"),
        ("parallel/worker.py", "socket.gethostname"),
    }


def test_the_app_alone_serves_this_machine() -> None:
    assert all(place.startswith("app/") for place in importers("tornado", "bokeh", "panel"))
    servers = [c for _, name, c in calls() if name == "get_server"]
    assert [ast.unparse(k.value) for c in servers for k in c.keywords if k.arg == "address"] == ["ADDRESS"]
    (address,) = re.findall(r'^ADDRESS\b.*= "(.*)"$', (PACKAGE / "app/server.py").read_text(), re.MULTILINE)
    assert address == "127.0.0.1"


def test_environment_variables_are_those_of_the_page() -> None:
    getters = ("os.environ.get", "os.getenv", "environ.get")
    read = {ast.unparse(call.args[0]).strip("'") for _, name, call in calls() if name in getters}
    page = (EXAMPLES.parent / "docs" / "security.md").read_text(encoding="utf-8")
    assert read == set(re.findall(r"^\| `([A-Z_]+)` \|", page, re.MULTILINE)) - {"TMPDIR"}


# What a run reaches.


def watched(folder: Path, *words: str) -> str:
    """Run a verb that may write in a folder, the cache of compiled code and the folder of temporary files only."""
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    compiled = compiled_cache.cache_folder()
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


def test_temporary_folders_are_closed_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are made by `tempfile` only, which makes them so, and stay so."""
    names = {name for _, name in called(r"tempfile\..*|.*Temporary.*")}
    safe = {"TemporaryDirectory", "tempfile.TemporaryDirectory", "tempfile.NamedTemporaryFile"}
    assert names <= safe | {"tempfile.mkdtemp", "tempfile.mkstemp"}
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
    private = compiled_cache.private()
    note(private)
    compiled_cache.discard(private)
    assert modes == [0o700] * 3


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
