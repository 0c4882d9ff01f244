"""Claims of docs/security.md that no other test holds: what the source calls, what a run reaches, what workers listen to."""

from __future__ import annotations

import ast
import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from unit.parallel.works import HERE, sockets

import stoop
from stoop.base import cache, files
from stoop.errors import LogError
from stoop.logs import guard
from stoop.parallel import LocalProcesses, Plan, Run, execute

PACKAGE = Path(stoop.__file__ or "").parent
EXAMPLES = Path(__file__).parents[2] / "examples"
TREES = {
    p.relative_to(PACKAGE).as_posix(): ast.parse(p.read_text(encoding="utf-8")) for p in PACKAGE.rglob("*.py")
}
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


def calls() -> Iterator[tuple[str, str, ast.Call]]:
    for place, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                yield place, ast.unparse(node.func), node


def imports() -> Iterator[tuple[str, str]]:
    for place, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                yield from ((place, alias.name) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield place, node.module or ""


# What the source never does.


def test_nothing_is_evaluated() -> None:
    names = {
        "eval",
        "exec",
        "compile",
        "__import__",
        "run_path",
        "run_module",
        "source_to_code",
        "exec_module",
    }
    #: of patterns, and of functions for types of arguments, by Numba
    compiled = {"re.compile", "again.compile", "dispatcher.compile", "found[entry].compile"}
    last = ((place, name.rpartition(".")[2]) for place, name, _ in calls() if name not in compiled)
    assert {(place, name) for place, name in last if name in names} == {
        ("kernels/generated.py", "exec_module"),
        ("kernels/generated.py", "source_to_code"),
        ("exporters/exporter.py", "exec_module"),
    }, "code that stoop wrote itself, from a private folder"
    for place, name, call in calls():
        if name == "ast.parse":  # read, and never run
            assert place in ("vehicle/terms.py", "parallel/worker.py"), place
        if name.endswith("import_module"):
            assert not any(
                isinstance(a, ast.JoinedStr) and "stoop." not in ast.unparse(a) for a in call.args
            ), place


def test_nothing_is_unpickled() -> None:
    modules = {"pickle", "cPickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml"}
    assert [i for i in imports() if i[1].partition(".")[0] in modules] == []
    for place, name, call in calls():
        if name in ("np.load", "numpy.load"):
            assert "allow_pickle=False" in ast.unparse(call), place
        assert not name.endswith(("read_pickle", "to_pickle")), place


def test_programs_are_started_in_one_place() -> None:
    """The child that reads formats of others, the steps of the app, its browser, and the C compiler; none is given a shell."""
    starters = re.compile(
        r"(subprocess\.\w+|os\.(system|popen|exec\w*|spawn\w*|posix_spawn\w*)|webbrowser\.\w+|pty\.\w+)$"
    )
    found = {(place, name) for place, name, _ in calls() if starters.match(name)}
    assert found == {
        ("logs/guard.py", "subprocess.run"),
        ("app/steps.py", "subprocess.Popen"),
        ("app/server.py", "webbrowser.open"),
        ("exporters/fmu.py", "subprocess.run"),
    }
    assert all("shell" not in {k.arg for k in call.keywords} for _, _, call in calls())


def test_one_place_connects_and_none_listens() -> None:
    """The client of a Dask scheduler whose address the user gave."""
    modules = {
        "socket",
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
    }
    assert {place for place, name in imports() if name.partition(".")[0] in modules} == {
        "parallel/pools.py",
        "parallel/worker.py",
    }
    used = {(place, name) for place, name, _ in calls() if name.startswith("socket.")}
    assert used == {
        ("parallel/pools.py", "socket.create_connection"),
        ("parallel/worker.py", "socket.gethostname"),
    }


def test_the_app_alone_serves() -> None:
    """Its server is bound to this machine; no other module imports what listens."""
    modules = {"tornado", "bokeh", "panel"}
    places = {place for place, name in imports() if name.partition(".")[0] in modules}
    assert all(place.startswith("app/") for place in places)
    servers = [c for place, name, c in calls() if name == "get_server"]
    assert [ast.unparse(k.value) for c in servers for k in c.keywords if k.arg == "address"] == ["ADDRESS"]
    from stoop.app.server import ADDRESS

    assert ADDRESS == "127.0.0.1"


def test_environment_variables_are_those_of_the_page() -> None:
    read = {
        ast.unparse(call.args[0]).strip("'")
        for _, name, call in calls()
        if name in ("os.environ.get", "os.getenv", "environ.get")
    }
    page = (Path(__file__).parents[2] / "docs" / "security.md").read_text(encoding="utf-8")
    assert read == set(re.findall(r"^\| `([A-Z_]+)` \|", page, re.MULTILINE)) - {"TMPDIR"}


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
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, *words],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
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
    words = (
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
    )
    assert "CLalpha" in watched(folder, "identify", "f.nc", *words)


def test_temporary_folders_are_closed_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are made by `tempfile` only, which makes them so, and stay so."""
    made = {name for _, name, _ in calls() if "tempfile." in name or "Temporary" in name}
    assert made <= {"tempfile.TemporaryDirectory", "TemporaryDirectory", "tempfile.mkdtemp", "tempfile.mkstemp",
                    "tempfile.NamedTemporaryFile"}  # fmt: skip
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
