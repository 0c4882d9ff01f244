"""Compiled modules on disk: reused, shared, and never believed when they are not what we wrote."""

from __future__ import annotations

import ast
import errno
import functools
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from naive import oscillator

from stoop.base import cache
from stoop.errors import CacheWarning, KernelError
from stoop.kernels import Kernel, SymbolicModel, cache_folder, environment, kernel, load_kernel

TESTS = Path(__file__).parents[2]
CHILD = """
import sys
sys.path.insert(0, {tests!r})
import numpy as np
from stoop.kernels import load_kernel
built = []
def model():
    built.append(1)
    if {held}:
        print("compiles", flush=True)
        sys.stdin.readline()
    from naive import oscillator
    return oscillator.equations()
k = load_kernel("pendulum", model)
y = k.trajectories(np.ones((3, 1)), np.ones((2, 1)), np.ones((50, 1)), 0.01)
if {lanes}:
    lanes = k.trajectories(np.ones((3, 2)), np.ones((2, 2)), np.ones((50, 1, 2)), 0.01)
    assert np.allclose(y, lanes[:1], rtol=1e-13)
print(len(built), repr(float(y[0, -1, 0])), "sympy" in sys.modules)
"""


def child(folder: Path, lanes: bool = False, held: bool = False, **environment: str) -> subprocess.Popen[str]:
    """Start a process that needs a pendulum; `held` lets it say that it compiles, then wait for a line."""
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", CHILD.format(tests=str(TESTS), lanes=lanes, held=held)],
        env=os.environ | {"STOOP_CACHE_DIR": str(folder)} | environment,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def said(process: subprocess.Popen[str]) -> list[str]:
    out, err = process.communicate()
    assert process.returncode == 0, err
    assert err == ""
    return out.split()


def value(k: Kernel) -> float:
    return float(k.trajectories(np.ones((3, 1)), np.ones((2, 1)), np.ones((50, 1)), 0.01)[0, -1, 0])


def sealed(folder: Path) -> list[Path]:
    return [p for p in folder.iterdir() if not p.name.startswith(".")]


def model_of(filled: Path) -> Path:
    """Return the folder of the model's functions, without those that are compiled from them."""
    (folder,) = (p for p in sealed(filled) if "-" not in p.name)
    return folder


@pytest.fixture(scope="module")
def expected(pendulum: Kernel) -> float:
    return value(pendulum)


def count_builds() -> tuple[list[int], Callable[[], SymbolicModel]]:
    built: list[int] = []

    def model() -> SymbolicModel:
        built.append(1)
        return oscillator.equations()

    return built, model


@pytest.fixture
def filled(forget: Path, pendulum: Kernel, expected: float) -> Path:
    """Return a cache that holds a sound pendulum and its trajectories, without compiling them again."""
    import shutil

    forget.mkdir(mode=0o700)
    for name in (pendulum.folder.name, f"{pendulum.folder.name}-outputs-{pendulum.lanes // 2}"):
        shutil.copytree(pendulum.folder.with_name(name), forget / name)
    return forget


def test_processes_share_what_was_compiled_once(tmp_path: Path, expected: float) -> None:
    first = said(child(tmp_path, lanes=True))
    assert first == ["1", repr(expected), "True"]
    assert len(sealed(tmp_path)) == 3, "the model, a function for shared inputs, one for inputs per lane"
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    second = said(child(tmp_path, lanes=True))
    assert second == ["0", repr(expected), "False"], "a warm start needs no SymPy"
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before, "nothing was written again"
    assert all(cache.intact(p) for p in sealed(tmp_path))


def test_two_processes_at_once_compile_once(tmp_path: Path, expected: float) -> None:
    pair = [said(p) for p in [child(tmp_path), child(tmp_path)]]
    assert sorted(count for count, *_ in pair) == ["0", "1"]
    assert [number for _, number, _ in pair] == [repr(expected)] * 2
    assert all(cache.intact(p) for p in tmp_path.iterdir()), "no half-built folder is left behind"


def compiling(folder: Path) -> subprocess.Popen[str]:
    """Return a process that is compiling a pendulum, and goes on with a line."""
    process = child(folder, held=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "compiles\n"
    return process


@pytest.mark.skipif(os.name == "nt", reason="no locks of folders on this system")
class TestLock:
    def test_a_process_waits_for_the_one_that_compiles(self, tmp_path: Path, expected: float) -> None:
        first, second = compiling(tmp_path), child(tmp_path)
        first.communicate("go on\n")
        assert said(second)[:2] == ["0", repr(expected)]

    def test_one_takes_over_when_that_one_dies(self, tmp_path: Path, expected: float) -> None:
        first, second = compiling(tmp_path), child(tmp_path)
        first.kill()
        first.communicate()
        assert said(second)[:2] == ["1", repr(expected)]
        assert not [
            p for p in tmp_path.iterdir() if p.name.startswith(cache.BUILDING + sealed(tmp_path)[0].name)
        ]

    def test_another_module_waits_for_none(self, tmp_path: Path) -> None:
        with cache._lock(tmp_path / "a"):
            assert cache.provide(tmp_path / "b", lambda f: (f / "b.py").touch()) == tmp_path / "b"

    def test_patience_ends(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(cache, "PATIENCE", 0.1)
        with cache._lock(tmp_path / "a"):
            assert cache.provide(tmp_path / "a", lambda f: (f / "a.py").touch()) == tmp_path / "a"
        assert [p.name for p in tmp_path.iterdir()] == ["a"]

    @pytest.mark.parametrize("error", [errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL])
    def test_a_disk_without_locks(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: int) -> None:
        import fcntl

        def flock(*_: object) -> None:
            raise OSError(error, os.strerror(error))

        monkeypatch.setattr(fcntl, "flock", flock)
        assert cache.provide(tmp_path / "a", lambda f: (f / "a.py").touch()) == tmp_path / "a"

    def test_a_system_without_locks(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "fcntl", None)
        assert cache.provide(tmp_path / "a", lambda f: (f / "a.py").touch()) == tmp_path / "a"

    def test_a_place_where_no_folder_can_be_made(self, tmp_path: Path) -> None:
        place = Path("/proc/stoop") if Path("/proc").is_dir() else tmp_path / "file" / "cache"
        (tmp_path / "file").touch()
        with pytest.warns(CacheWarning, match="set STOOP_CACHE_DIR"):
            made = cache.provide(place / "a", lambda f: (f / "a.py").touch())
        assert (made / "a.py").exists()


def test_the_filled_fixture_is_a_sound_cache(filled: Path, expected: float) -> None:
    built, model = count_builds()
    assert value(load_kernel("pendulum", model)) == expected
    assert not built


def damaged(filled: Path, suffix: str, damage: Callable[[Path], None], expected: float) -> None:
    for victim in sorted(filled.rglob(f"*{suffix}")):
        damage(victim)
    built, model = count_builds()
    assert value(load_kernel("pendulum", model)) == expected
    assert built == ([1] if suffix == ".py" else []), "SymPy is asked only where the model itself is damaged"
    assert all(cache.intact(p) for p in sealed(filled))
    assert not [p for p in filled.iterdir() if p.name.startswith(".")], "nothing half-made is left"


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("suffix", "damage"), [(".o", truncate), (".o", Path.unlink), (".o", flip), (".py", flip)]
)
def test_damage_is_recompiled_silently(
    filled: Path, suffix: str, damage: Callable[[Path], None], expected: float
) -> None:
    damaged(filled, suffix, damage, expected)


@pytest.mark.parametrize("suffix", [".o", "manifest.json", "model.py", "sizes.txt"])
@pytest.mark.parametrize("damage", [truncate, empty, flip, Path.unlink])
def test_any_damage_is_seen(filled: Path, suffix: str, damage: Callable[[Path], None]) -> None:
    victim = sorted(filled.rglob(f"*{suffix}"))[0]
    assert cache.intact(victim.parent)
    damage(victim)
    assert not cache.intact(victim.parent)


def test_an_added_file_is_seen(filled: Path) -> None:
    folder = model_of(filled)
    (folder / "more.o").write_bytes(b"\x7fELF")
    assert not cache.intact(folder)


@pytest.mark.parametrize("text", ["", "[]", "null", "{}", "\x00", "[" * 100_000, '{"model.py": 3}'])
def test_any_manifest_is_only_a_mismatch(filled: Path, text: str) -> None:
    folder = model_of(filled)
    (folder / "manifest.json").write_text(text)
    assert not cache.intact(folder)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no file modes on this system")
class TestTrust:
    def test_a_folder_that_others_can_write_is_not_trusted(self, filled: Path) -> None:
        folder = model_of(filled)
        for mode in (0o770, 0o707, 0o722):
            folder.chmod(mode)
            assert not cache.intact(folder)
        for mode in (0o700, 0o755, 0o500):
            folder.chmod(mode)
            assert cache.intact(folder)
        folder.chmod(0o700)

    def test_a_file_that_others_can_reach_and_write_is_not_trusted(self, filled: Path) -> None:
        folder = model_of(filled)
        (folder / "model.py").chmod(0o664)
        assert cache.intact(folder), "nobody else can enter the folder"
        folder.chmod(0o755)
        assert not cache.intact(folder)

    def test_a_folder_of_somebody_else_is_not_trusted(
        self, filled: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = model_of(filled)
        status = folder.stat()
        real = Path.lstat

        def lstat(self: Path) -> os.stat_result:
            return os.stat_result((*real(self)[:4], 12345, *real(self)[5:]))

        assert status.st_uid == os.getuid()
        monkeypatch.setattr(Path, "lstat", lstat)
        assert not cache.intact(folder)

    def test_a_link_is_not_trusted(self, filled: Path, tmp_path: Path) -> None:
        folder = model_of(filled)
        target = tmp_path / "target.py"
        (folder / "model.py").rename(target)
        (folder / "model.py").symlink_to(target)
        assert not cache.intact(folder)

    def test_an_untrusted_folder_is_compiled_anew(self, filled: Path, expected: float) -> None:
        folder = model_of(filled)
        folder.chmod(0o777)
        built, model = count_builds()
        assert value(load_kernel("pendulum", model)) == expected
        assert built == [1]
        assert cache.intact(folder)
        assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no file modes on this system")
class TestPlace:
    """Whoever can replace a sealed folder can have it loaded after it was checked: such a cache is not used at all."""

    def used(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
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
                assert self.used(tmp_path / inner, monkeypatch) == (mode in (0o1777, 0o755)), (
                    oct(mode),
                    inner,
                )

    def test_a_place_of_somebody_else(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        if os.getuid() != 0:
            pytest.skip("only root can give files away")
        (tmp_path / "a" / "b").mkdir(parents=True)
        os.chown(tmp_path / "a", 12345, 12345)
        assert not self.used(tmp_path / "a", monkeypatch)
        assert not self.used(tmp_path / "a" / "b", monkeypatch)
        assert self.used(tmp_path / "c", monkeypatch)

    def test_a_group_of_ones_own(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import grp
        import pwd

        status = os.stat_result((0o40775, 0, 0, 1, os.getuid(), 777, 0, 0, 0, 0))
        user = pwd.getpwuid(os.getuid()).pw_name
        for name, members, expected in (
            (user, [], True),
            (user, [user], True),
            (user, ["eve"], False),
            ("lab", [], False),
        ):
            monkeypatch.setattr(
                grp, "getgrgid", lambda _, n=name, m=members: grp.struct_group((n, "x", 777, m))
            )
            assert cache._replaceable_by_none(status) == expected

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

    def test_code_of_somebody_else_is_not_loaded(
        self, filled: Path, expected: float, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A whole folder with a sound manifest, in a cache where others can write."""
        folder = model_of(filled)
        source = folder / "sizes.txt"
        source.write_text("0 0 0 0 0 0")
        (folder / "manifest.json").write_text(json.dumps(cache.checksums(folder)))
        assert cache.intact(folder), "of itself it is sound"
        filled.chmod(0o777)
        built, model = count_builds()
        monkeypatch.setattr(cache, "_for_this_process", functools.cache(cache._for_this_process.__wrapped__))
        with pytest.warns(CacheWarning):
            k = load_kernel("pendulum", model)
        assert (built, value(k)) == ([1], expected)
        assert filled not in k.folder.parents


def test_a_read_only_cache_is_used(filled: Path, expected: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "writable", lambda _: False)  # the tests may run as root, whom no mode stops
    built, model = count_builds()
    k = load_kernel("pendulum", model)
    assert value(k) == expected
    assert not built
    assert filled not in k.folder.parents
    assert k.folder.stat().st_mode & 0o777 == 0o700


def test_an_unwritable_cache_still_compiles(
    tmp_path: Path, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file stands where the folder should be")
    monkeypatch.setenv("STOOP_CACHE_DIR", str(blocked / "cache"))
    monkeypatch.setattr(cache, "_for_this_process", functools.cache(cache._for_this_process.__wrapped__))
    for kept in ("_loaded", "_models"):
        monkeypatch.setattr(kernel, kept, {})
    with pytest.warns(CacheWarning):
        k = load_kernel("pendulum", oscillator.equations)
    assert value(k) == expected
    assert blocked not in k.folder.parents


def test_a_damaged_folder_that_cannot_be_removed(
    filled: Path, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = model_of(filled)
    flip(folder / "model.py")
    monkeypatch.setattr(cache, "discard", lambda _: None)
    k = load_kernel("pendulum", oscillator.equations)
    assert value(k) == expected
    assert k.folder != folder


def full_disk(monkeypatch: pytest.MonkeyPatch, full: Callable[[Path], bool]) -> None:
    """Let nothing be written where ``full`` says so."""
    for name in ("write_bytes", "write_text"):
        real = getattr(Path, name)

        def write(self: Path, content: bytes | str, real: Callable[..., int] = real) -> int:
            if full(self):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(self, content)

        monkeypatch.setattr(Path, name, write)


def test_a_full_disk_below_the_cache_costs_time_only(
    forget: Path, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    full_disk(monkeypatch, lambda p: forget in p.parents)
    with pytest.warns(CacheWarning):
        k = load_kernel("pendulum", oscillator.equations)
    assert value(k) == expected
    assert forget not in k.folder.parents
    assert k.folder.stat().st_mode & 0o777 == 0o700
    assert not list(forget.iterdir()), "nothing half-made is left"


def test_no_room_anywhere_is_said_in_one_line(forget: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full_disk(monkeypatch, lambda _: True)
    with (
        pytest.raises(KernelError, match=r"No space left on device.*STOOP_CACHE_DIR"),
        pytest.warns(CacheWarning),
    ):
        load_kernel("pendulum", oscillator.equations)


def test_equations_do_not_need_numba(tmp_path: Path, expected: float) -> None:
    assert said(child(tmp_path, NUMBA_DISABLE_JIT="1"))[1] == repr(expected)


def test_numba_told_not_to_compile(tmp_path: Path) -> None:
    code = "from stoop.kernels.generated import riccati_module; riccati_module()"
    variables = os.environ | {"STOOP_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("stoop.errors.KernelError: NUMBA_DISABLE_JIT: ")
    assert not (tmp_path / "cache").exists()


def test_one_kernel_per_process(filled: Path) -> None:
    built, model = count_builds()
    assert load_kernel("pendulum", model) is load_kernel("pendulum", model)
    assert not built


def test_the_key_holds_structure_versions_and_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = []
    monkeypatch.setattr(kernel, "_load", lambda key, _: keys.append(key))
    for structure, facts in (("a", "1"), ("a", "1"), ("b", "1"), ("a", "2")):
        monkeypatch.setattr(kernel, "equations_environment", lambda facts=facts: {"facts": facts})
        load_kernel(structure, oscillator.equations)
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [("BOUNDSCHECK", 1), ("DEBUGINFO_DEFAULT", 1), ("SLP_VECTORIZE", 1), ("LOOP_VECTORIZE", 0), ("CPU_NAME", "generic")],
)  # fmt: skip
def test_the_key_holds_what_changes_the_code(
    monkeypatch: pytest.MonkeyPatch, name: str, value: object
) -> None:
    from numba import config

    before = environment.__wrapped__()
    monkeypatch.setattr(config, name, value)
    assert environment.__wrapped__() != before


def test_the_key_holds_the_version_of_sympy() -> None:
    import sympy

    assert sympy.__version__ in environment().values()


def imports(path: Path) -> set[str]:
    """Return the modules of stoop that a file imports."""
    found = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
    names = {n.module or "" for n in found}
    return names | {f"{n.module}.{a.name}" for n in found for a in n.names if n.module == "stoop.vehicle"}


def test_every_module_behind_the_equations_enters_the_key() -> None:
    from stoop import vehicle as room
    from stoop.vehicle.vehicle import _EQUATION_SOURCES

    here = Path(room.__file__).parent
    sources = [*(here / "symbolic").glob("*.py"), *(here / name for name in _EQUATION_SOURCES)]
    behind = {name for path in sources for name in imports(path)}
    equations = {m.removeprefix("stoop.vehicle.") for m in behind if m.startswith("stoop.vehicle.")}
    texts = {
        f"stoop.base.{m}" for m in ("arrays", "text", "streams", "names", "html")
    }  # types, messages, tables to print
    numbers = {m.removeprefix("stoop.base.") for m in behind - texts if m.startswith("stoop.base.")}
    expected = {f"{m}.py" for m in equations if "symbolic" not in m} | {f"../base/{m}.py" for m in numbers}
    assert expected == set(_EQUATION_SOURCES)


def test_where_the_cache_lies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("STOOP_CACHE_DIR", str(tmp_path / "a"))
    assert cache_folder() == tmp_path / "a"
    monkeypatch.delenv("STOOP_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "b"))
    assert cache_folder() == tmp_path / "b" / "stoop" / "kernels"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "stoop" / "kernels"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STOOP_CACHE_DIR", ".")
    assert cache_folder() == tmp_path


def test_a_user_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", home)
    monkeypatch.delenv("STOOP_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == cache_folder()
    assert cache_folder().stat().st_mode & 0o777 == 0o700


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    old, fresh = tmp_path / ".building-old", tmp_path / ".building-fresh"
    for folder in (old, fresh):
        folder.mkdir()
        (folder / "model.py").touch()
    os.utime(old, (0, 0))
    building = cache.start_build(tmp_path)
    assert not old.exists()
    assert fresh.exists()
    assert building.parent == tmp_path


def test_a_folder_that_another_process_puts_in_its_place_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is listed, and gone when its age is asked."""
    monkeypatch.setattr(Path, "glob", lambda self, _: iter([self / f"{cache.BUILDING}gone"]))
    assert cache.start_build(tmp_path).parent == tmp_path


def test_the_manifest_is_plain_json(filled: Path) -> None:
    folder = model_of(filled)
    manifest = json.loads((folder / "manifest.json").read_text())
    assert {"model.py", "equations.tex", "sizes.txt"} <= set(manifest)
    assert all(len(digest) == 64 for digest in manifest.values())
