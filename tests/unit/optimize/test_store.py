from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.errors import IdentificationError, OutputError
from stoop.optimize.state import FORMER_CLASSES

RELEASE_0_1 = Path(__file__).parent / "data" / "state-0.1.npz"


@pytest.fixture
def state(oscillation: Callable[..., Any]) -> Any:
    run = optimize.minimize(
        optimize.create(), oscillation(disturbance=0.3), seed=0, stop=optimize.Stop(generations=8)
    )
    return run.state


def test_a_file_can_be_opened_without_pickle(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    optimize.save_state(path, state)
    with np.load(path, allow_pickle=False) as file:
        assert all(not file[name].dtype.hasobject for name in file.files)
    assert optimize.load_state(path).evaluations.cost == state.evaluations.cost
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_a_tag_lies_in_the_same_file(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    optimize.save_state(path, state, "this problem")
    loaded, tag = optimize.load_tagged(path)
    assert tag == "this problem"
    assert loaded.evaluations.cost == state.evaluations.cost == optimize.load_state(path).evaluations.cost
    optimize.save_state(path, state)
    assert optimize.load_tagged(path)[1] == ""


def test_infinity_and_large_integers_survive(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    books = replace(state.evaluations, cost=np.inf, trajectories=1 / 3)
    optimize.save_state(path, replace(state, evaluations=books))
    loaded = optimize.load_state(path)
    assert loaded.evaluations.cost == np.inf
    assert loaded.evaluations.trajectories == 1 / 3
    assert loaded.stream == state.stream
    assert loaded.stream.state > 2**64


def test_a_damaged_file_is_named_and_nothing_worse(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    optimize.save_state(path, state)
    whole = path.read_bytes()
    generator = np.random.default_rng(0)
    damaged = [whole[:n] for n in (0, 1, 100, len(whole) // 2, len(whole) - 1)]
    for _ in range(200):
        flipped = bytearray(whole)
        flipped[generator.integers(len(whole))] ^= 1 << generator.integers(8)
        damaged.append(bytes(flipped))
    messages = [m for m in (_refusal(path, content) for content in damaged) if m is not None]
    assert len(messages) >= 100
    assert all(m.startswith(str(path)) and len(m.splitlines()) == 1 for m in messages)


def _refusal(path: Path, content: bytes) -> str | None:
    """Return what is said of a file; None where a flipped bit did not matter."""
    path.write_bytes(content)
    try:
        optimize.load_state(path)
    except IdentificationError as error:
        return str(error)
    return None


def test_another_version_is_refused(state: Any, tmp_path: Path) -> None:
    path, other = tmp_path / "state.npz", tmp_path / "other.npz"
    optimize.save_state(path, state)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    header = arrays["header"].tobytes().replace(b"stoop-state/1", b"stoop-state/9")
    arrays["header"] = np.frombuffer(header, dtype=np.uint8)
    np.savez(other, **arrays)
    with pytest.raises(IdentificationError, match="stoop-state/9"):
        optimize.load_state(other)


def test_a_file_names_no_class_but_ours(tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    header = b'{"schema": "stoop-state/1", "state": {"class": "Path", "fields": {}}}'
    np.savez(path, header=np.frombuffer(header, dtype=np.uint8))
    with pytest.raises(IdentificationError, match="not a usable state"):
        optimize.load_state(path)
    header = header.replace(b"Path", b"Stream").replace(
        b"{}}", b'{"state":1,"inc":1,"has_uint32":0,"uinteger":0}}'
    )
    np.savez(path, header=np.frombuffer(header, dtype=np.uint8))
    with pytest.raises(IdentificationError, match="holds no state"):
        optimize.load_state(path)


def test_missing_files_and_folders_are_told(state: Any, tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="there is no saved state"):
        optimize.load_state(tmp_path / "none.npz")
    with pytest.raises(OutputError, match="cannot be written"):
        optimize.save_state(tmp_path / "none" / "state.npz", state)


def test_a_failed_write_leaves_the_old_file(
    state: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "state.npz"
    optimize.save_state(path, state)
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr("stoop.base.files._write_through", full)
    with pytest.raises(OutputError, match="No space left"):
        optimize.save_state(path, replace(state, generation=99))
    assert path.read_bytes() == before
    assert zipfile.is_zipfile(path)
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_what_cannot_be_stored_is_an_error_of_ours(state: Any, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="cannot hold set"):
        optimize.save_state(tmp_path / "state.npz", replace(state, round={1}))
    assert not list(tmp_path.iterdir())


class Rastrigin:
    """Thousands of local optima: the file beside this one holds a run on it, saved by release 0.1."""

    dimension, extra, prices = 3, 0, (1.0,)

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        Y = 8 * X - 4
        return 10 * 3 + (Y**2 - 10 * np.cos(2 * np.pi * Y)).sum(axis=1)

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        return np.sqrt(self.costs(Z, rung))[:, None]

    def jacobian(self, z: np.ndarray, rung: int, r: np.ndarray) -> tuple[np.ndarray, float]:
        return optimize.forward_jacobian(self, z, rung, r)

    def reference(self, rung: int) -> float:
        return 1e3


STOP = optimize.Stop(generations=80)
FORMER_NAMES = {
    **{ours: theirs for theirs, ours in FORMER_CLASSES.items()},
    "evaluations": "books",
    "resumed": "gone_on",
    "deferred": "shelved",
    "least": "seen",
    "optima": "ends",
    "population": "herd",
    "population_size": "herd_size",
    "refined": "dived",
}
LATER_FIELDS = {"prolonged", "evolved"}  # which release 0.1 did not have


def renamed(value: Any) -> Any:
    """Return an encoded state with the names of release 0.1."""
    if not isinstance(value, dict) or "array" in value:
        return value
    fields = {FORMER_NAMES.get(name, name): renamed(item) for name, item in value["fields"].items()}
    return {"class": FORMER_NAMES.get(value["class"], value["class"]), "fields": fields}


def test_a_state_with_the_names_of_release_0_1_continues_as_an_uninterrupted_run(tmp_path: Path) -> None:
    """Saved here, so that it may be held to the last bit: BLAS has other kernels, and rounds otherwise, on other processors."""
    path = tmp_path / "state.npz"
    whole = optimize.minimize(optimize.create(), Rastrigin(), seed=3, stop=STOP)
    half = optimize.minimize(optimize.create(), Rastrigin(), seed=3, stop=optimize.Stop(generations=60))
    assert half.state is not None
    assert half.state.population is not None
    optimize.save_state(path, half.state)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays["header"].tobytes())
    header["state"] = renamed(header["state"])
    with np.load(RELEASE_0_1) as file:
        kind, fields = names(header["state"])
        former = {name: item for name, item in fields.items() if name not in LATER_FIELDS}
        assert (kind, former) == names(json.loads(file["header"].tobytes())["state"])
    np.savez(path, **arrays | {"header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)})
    resumed = optimize.minimize(
        optimize.create(), Rastrigin(), seed=0, stop=STOP, state=optimize.load_state(path)
    )
    assert (resumed.trajectories, resumed.cost) == (whole.trajectories, whole.cost)
    assert np.array_equal(resumed.history, whole.history)


def names(value: Any) -> Any:
    """Return the names in an encoded state."""
    if not isinstance(value, dict) or "array" in value:
        return None
    return value["class"], {name: names(item) for name, item in value["fields"].items()}


def test_the_state_of_release_0_1_itself_loads_and_continues() -> None:
    old = optimize.load_state(RELEASE_0_1)
    outcome = optimize.minimize(optimize.create(), Rastrigin(), seed=0, stop=STOP, state=old)
    assert (old.generation, outcome.generation) == (60, 80)
    assert outcome.trajectories > old.evaluations.trajectories == 4359.0
    assert outcome.cost == pytest.approx(0.117749, rel=1e-4)
