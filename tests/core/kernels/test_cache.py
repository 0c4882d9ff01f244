"""Compiled modules on disk: reused, shared, and not loaded where they are not what was written."""

import ast
import errno
import functools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from naive import oscillator

from stoop.base import cache
from stoop.errors import CacheWarning, KernelError
from stoop.kernels import Kernel, cache_folder, environment, kernel, load_kernel

BUILDER = """
import sys
from pathlib import Path
from stoop.base.cache import provide
def make(folder):
    print("builds", flush=True)
    sys.stdin.readline()
    (folder / "module.py").touch()
provide(Path(sys.argv[1]), make)
"""
WITHOUT_NUMBA = """
import numpy as np
from stoop.kernels import load_kernel
from stoop.kernels.generated import riccati_module
k = load_kernel("pendulum", None)
print(repr(float(k.trajectories(np.ones((3, 1)), np.ones((2, 1)), np.ones((50, 1)), 0.01)[0, -1, 0])), flush=True)
riccati_module()
"""


def value(k: Kernel) -> float:
    return float(k.trajectories(np.ones((3, 1)), np.ones((2, 1)), np.ones((50, 1)), 0.01)[0, -1, 0])


def touch(folder: Path) -> None:
    (folder / "a.py").write_text("x = 1")


def model_of(filled: Path) -> Path:
    """Return the folder of the model's functions, without those that are compiled from them."""
    (folder,) = (p for p in filled.iterdir() if "-" not in p.name and not p.name.startswith("."))
    return folder


@pytest.fixture(scope="module")
def expected(pendulum: Kernel) -> float:
    return value(pendulum)


@pytest.fixture
def filled(forget: Path, pendulum: Kernel, expected: float) -> Path:
    """Return a cache that holds a sound pendulum and its trajectories, without compiling them again."""
    forget.mkdir(mode=0o700)
    for name in (pendulum.folder.name, f"{pendulum.folder.name}-outputs-{pendulum.lanes // 2}"):
        shutil.copytree(pendulum.folder.with_name(name), forget / name)
    return forget


def test_a_compiled_model_is_read_again(filled, expected, monkeypatch):
    before = {p: p.stat().st_mtime_ns for p in filled.rglob("*")}
    model = Mock(wraps=oscillator.equations)
    first = load_kernel("pendulum", model)
    assert value(first) == expected
    assert load_kernel("pendulum", model) is first, "one kernel a process"
    assert {p: p.stat().st_mtime_ns for p in filled.rglob("*")} == before, "nothing was written again"
    for kept in ("_loaded", "_models"):
        monkeypatch.setattr(kernel, kept, {})
    monkeypatch.setattr(cache, "writable", lambda _: False)  # the tests may run as root, whom no mode stops
    copied = load_kernel("pendulum", model)
    assert (value(copied), model.call_count) == (expected, 0)
    assert filled not in copied.folder.parents
    assert copied.folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(os.name == "nt", reason="no locks of folders on this system")
@pytest.mark.parametrize("killed", [False, True])
def test_a_process_waits_for_the_one_that_builds_and_takes_over_when_it_dies(tmp_path, killed):
    """One that builds the module says so and waits for a line."""
    command, pipe = [sys.executable, "-c", BUILDER, str(tmp_path / "a")], subprocess.PIPE
    first = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    assert first.stdout is not None
    assert first.stdout.readline() == "builds\n"
    second = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    if killed:
        first.kill()
    first.communicate("" if killed else "go on\n")
    assert second.communicate("go on\n")[0] == ("builds\n" if killed else "")
    assert cache.intact(tmp_path / "a")
    assert not (tmp_path / f"{cache.BUILDING}a").exists(), "no lock is left"


@pytest.mark.skipif(os.name == "nt", reason="no locks of folders on this system")
def test_locks_of_others_and_disks_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    with cache._lock(tmp_path / "a"):
        assert cache.provide(tmp_path / "b", touch) == tmp_path / "b", "another module waits for none"
        monkeypatch.setattr(cache, "PATIENCE", 0.1)
        assert cache.provide(tmp_path / "a", touch) == tmp_path / "a", "patience ends"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]
    for number in (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL):
        monkeypatch.setattr(fcntl, "flock", Mock(side_effect=OSError(number, "no locks")))
        assert cache.provide(tmp_path / f"c{number}", touch) == tmp_path / f"c{number}"
    monkeypatch.setitem(sys.modules, "fcntl", None)
    assert cache.provide(tmp_path / "d", touch) == tmp_path / "d"


def test_folders_of_killed_processes_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old, fresh = tmp_path / ".building-old", tmp_path / ".building-fresh"
    for folder in (old, fresh):
        folder.mkdir()
        (folder / "model.py").touch()
    os.utime(old, (0, 0))
    assert cache.start_build(tmp_path).parent == tmp_path
    assert (old.exists(), fresh.exists()) == (False, True)
    # one that another process puts in its place meanwhile is listed, and gone when its age is read
    monkeypatch.setattr(Path, "glob", lambda self, _: iter([self / f"{cache.BUILDING}gone"]))
    assert cache.start_build(tmp_path).parent == tmp_path


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)


def test_any_damage_is_seen(filled: Path) -> None:
    whole = filled.with_name("whole")
    filled.rename(whole)
    victims = [model_of(whole) / name for name in ("manifest.json", "model.py", "sizes.txt")]
    places = [victim.relative_to(whole) for victim in (*victims, *whole.glob("*-*/*.o"))]

    def damaged(place: Path, damage: Callable[[Path], object]) -> bool:
        shutil.rmtree(filled, ignore_errors=True)
        shutil.copytree(whole, filled)
        assert cache.intact((filled / place).parent)
        damage(filled / place)
        return not cache.intact((filled / place).parent)

    for place in places:
        for damage in (
            lambda p: os.truncate(p, p.stat().st_size // 2), lambda p: os.truncate(p, 0), flip, Path.unlink,
            lambda p: p.symlink_to(p.rename(p.parents[2] / "target")),
        ):  # fmt: skip
            assert damaged(place, damage), (place.name, damage)
    assert damaged(places[0], lambda p: (p.parent / "more.o").write_bytes(b"\x7fELF"))
    for text in ("[]", "null", "{}", "\x00", "[" * 100_000, '{"model.py": 3}'):
        assert damaged(places[0], lambda p, text=text: p.write_text(text)), text[:20]


@pytest.mark.parametrize(("suffix", "rebuilt"), [(".o", 0), (".py", 1)])
def test_damage_is_recompiled_silently(filled, suffix, rebuilt, expected, monkeypatch):
    for victim in sorted(filled.rglob(f"*{suffix}")):
        flip(victim)
    model = Mock(wraps=oscillator.equations)
    assert value(load_kernel("pendulum", model)) == expected
    assert model.call_count == rebuilt, "SymPy runs only where the model itself is damaged"
    assert all(cache.intact(p) and p.name[0] != "." for p in filled.iterdir()), "nothing half-made is left"
    flip(model_of(filled) / "model.py")
    monkeypatch.setattr(cache, "discard", lambda _: None)  # a damaged folder that cannot be removed
    made = cache.provide(model_of(filled), touch)
    assert made != model_of(filled)
    assert (made / "a.py").exists()


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no file modes on this system")
class TestTrust:
    def test_modes_and_owners(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        folder = cache.provide(tmp_path / "a", touch)
        for mode in (0o770, 0o707, 0o722, 0o700, 0o755, 0o500):
            folder.chmod(mode)
            assert cache.intact(folder) == (not mode & 0o022), oct(mode)
        folder.chmod(0o700)
        (folder / "a.py").chmod(0o664)
        assert cache.intact(folder), "nobody else can enter the folder"
        folder.chmod(0o755)
        assert not cache.intact(folder)
        assert cache.provide(folder, touch) == folder, "built anew"
        assert cache.intact(folder)
        assert folder.stat().st_mode & 0o777 == 0o700
        real = Path.lstat
        other = 12345  # user
        monkeypatch.setattr(Path, "lstat", lambda p: os.stat_result((*real(p)[:4], other, *real(p)[5:])))
        assert not cache.intact(folder)

    def used(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
        """Whether a place is used: whoever can replace a sealed folder can have it loaded after it was checked."""
        monkeypatch.setenv("STOOP_CACHE_DIR", str(folder))
        found = cache_folder()
        assert found == folder.resolve() or found.stat().st_mode & 0o777 == 0o700, "one of this process"
        return found == folder.resolve()

    def test_a_place_where_others_can_write(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "a" / "b").mkdir(parents=True)
        monkeypatch.setattr(cache, "_has_no_other_member", lambda _: False)
        for mode in (0o777, 0o757, 0o775, 0o1777, 0o755):
            (tmp_path / "a").chmod(mode)
            for inner in ("a", "a/b", "a/b/new"):
                found = self.used(tmp_path / inner, monkeypatch)
                assert found == (mode in (0o1777, 0o755)), (oct(mode), inner)
        if os.getuid() == 0:  # only root can give files away
            os.chown(tmp_path / "a", 12345, 12345)
            assert not any(self.used(tmp_path / inner, monkeypatch) for inner in ("a", "a/b"))

    def test_a_group_of_ones_own(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import grp
        import pwd

        status = os.stat_result((0o40775, 0, 0, 1, os.getuid(), 777, 0, 0, 0, 0))
        user = pwd.getpwuid(os.getuid()).pw_name
        groups = ((user, [], True), (user, [user], True), (user, ["eve"], False), ("lab", [], False))
        for name, members, alone in groups:
            found = Mock(return_value=grp.struct_group((name, "x", 777, members)))
            monkeypatch.setattr(grp, "getgrgid", found)
            assert cache._replaceable_by_none(status) == alone

    def test_a_link_on_the_way(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("open", "closed"):
            (tmp_path / name / "in").mkdir(parents=True)
        (tmp_path / "closed" / "link").symlink_to(tmp_path / "open" / "in")
        (tmp_path / "open" / "link").symlink_to(tmp_path / "closed" / "in")
        assert self.used(tmp_path / "closed" / "link", monkeypatch)
        (tmp_path / "open").chmod(0o777)
        assert not self.used(tmp_path / "closed" / "link", monkeypatch), "it leads to where others can write"
        assert self.used(tmp_path / "open" / "link", monkeypatch), "it is followed once, and never again"
        (tmp_path / "round").symlink_to(tmp_path / "round")
        monkeypatch.setenv("STOOP_CACHE_DIR", str(tmp_path / "round"))
        assert cache_folder().name.startswith("stoop-kernels-")

    def test_code_of_somebody_else_is_not_loaded(self, filled, expected, monkeypatch):
        """A whole folder with a sound manifest, in a cache where others can write."""
        folder = model_of(filled)
        (folder / "sizes.txt").write_text("0 0 0 0 0 0")
        (folder / "manifest.json").write_text(json.dumps(cache.checksums(folder)))
        assert cache.intact(folder), "of itself it is sound"
        filled.chmod(0o777)
        model = Mock(wraps=oscillator.equations)
        monkeypatch.setattr(cache, "_for_this_process", functools.cache(cache._for_this_process.__wrapped__))
        with pytest.warns(CacheWarning):
            k = load_kernel("pendulum", model)
        assert (model.call_count, value(k)) == (1, expected)
        assert filled not in k.folder.parents


def full_disk(monkeypatch: pytest.MonkeyPatch, full: Callable[[Path], bool]) -> None:
    """Let nothing be written where ``full`` says so."""
    for name in ("write_bytes", "write_text"):
        real = getattr(Path, name)

        def write(self: Path, content: bytes | str, real: Callable[..., int] = real) -> int:
            if full(self):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(self, content)

        monkeypatch.setattr(Path, name, write)


def test_a_cache_without_room_costs_time_only(forget: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (forget.parent / "file").touch()
    full_disk(monkeypatch, lambda p: forget in p.parents)
    for place in (forget, forget.parent / "file" / "cache", Path("/proc/stoop")):
        cache._warn.cache_clear()
        with pytest.warns(CacheWarning, match="set STOOP_CACHE_DIR"):
            made = cache.provide(place / "a", touch)
        assert (made / "a.py").exists()
        assert place not in made.parents
        assert made.stat().st_mode & 0o777 == 0o700
    assert not list(forget.iterdir()), "nothing half-made is left"
    full_disk(monkeypatch, lambda _: True)
    cache._warn.cache_clear()
    full = pytest.raises(KernelError, match=r"No space left on device.*STOOP_CACHE_DIR")
    with full, pytest.warns(CacheWarning):
        load_kernel("pendulum", oscillator.equations)


def test_equations_do_not_need_numba(pendulum: Kernel, expected: float) -> None:
    variables = os.environ | {"STOOP_CACHE_DIR": str(pendulum.folder.parent), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", WITHOUT_NUMBA]
    done = subprocess.run(command, env=variables, capture_output=True, text=True)
    assert done.stdout == f"{expected!r}\n"
    assert done.stderr.splitlines()[-1].startswith("stoop.errors.KernelError: NUMBA_DISABLE_JIT: ")


def test_the_key_holds_structure_versions_and_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    import sympy
    from numba import config

    assert sympy.__version__ in environment().values()
    before = environment.__wrapped__()
    for name, changed in (
        ("BOUNDSCHECK", 1), ("DEBUGINFO_DEFAULT", 1), ("SLP_VECTORIZE", 1), ("LOOP_VECTORIZE", 0), ("CPU_NAME", "generic"),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(config, name, changed)
            assert environment.__wrapped__() != before, name
    keys = []
    monkeypatch.setattr(kernel, "_load", lambda key, _: keys.append(key))
    for structure, facts in (("a", "1"), ("a", "1"), ("b", "1"), ("a", "2")):
        monkeypatch.setattr(kernel, "equations_environment", lambda facts=facts: {"facts": facts})
        load_kernel(structure, oscillator.equations)
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


def test_every_module_behind_the_equations_enters_the_key() -> None:
    from stoop import vehicle as room
    from stoop.vehicle.vehicle import _EQUATION_SOURCES

    here = Path(room.__file__).parent
    sources = [*(here / "symbolic").glob("*.py"), *(here / name for name in _EQUATION_SOURCES)]
    nodes = [node for path in sources for node in ast.walk(ast.parse(path.read_text()))]
    found = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    behind = {n.module or "" for n in found}
    behind |= {f"{n.module}.{a.name}" for n in found for a in n.names if n.module == "stoop.vehicle"}
    equations = {m.removeprefix("stoop.vehicle.") for m in behind if m.startswith("stoop.vehicle.")}
    equations -= {"arrays", "delays", "rotor_channels", "trajectories"}  # these take the equations
    texts = {
        f"stoop.base.{m}" for m in ("arrays", "rotations", "text", "streams", "names", "html")
    }  # no numbers
    numbers = {m.removeprefix("stoop.base.") for m in behind - texts if m.startswith("stoop.base.")}
    expected = {f"{m}.py" for m in equations if "symbolic" not in m} | {f"../base/{m}.py" for m in numbers}
    assert expected == set(_EQUATION_SOURCES)


def test_where_the_cache_lies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STOOP_CACHE_DIR", ".")
    assert cache_folder() == tmp_path
    monkeypatch.delenv("STOOP_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "b"))
    assert cache_folder() == tmp_path / "b" / "stoop" / "kernels"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "stoop" / "kernels"

    monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError("Could not determine home directory.")))
    assert cache_folder() == cache_folder()
    assert cache_folder().stat().st_mode & 0o777 == 0o700
