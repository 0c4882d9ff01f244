from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from core.optimize.conftest import Residuals

from stoop import optimize
from stoop.errors import IdentificationError, OutputError


@pytest.fixture
def state(oscillation: Callable[..., Any]) -> Any:
    problem, stop = oscillation(disturbance=0.3), optimize.Stop(generations=8)
    return optimize.minimize(optimize.create(), problem, seed=0, stop=stop).state


def test_a_file_holds_state_and_tag_without_pickle(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    books = replace(state.evaluations, cost=np.inf, trajectories=1 / 3)
    optimize.save_state(path, replace(state, evaluations=books), "this problem")
    with np.load(path, allow_pickle=False) as file:
        assert all(not file[name].dtype.hasobject for name in file.files)
    loaded, tag = optimize.load_tagged(path)
    assert tag == "this problem"
    assert (loaded.evaluations.cost, loaded.evaluations.trajectories) == (np.inf, 1 / 3)
    assert loaded.stream == state.stream
    assert loaded.stream.state > 2**64
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]
    optimize.save_state(path, state)
    assert optimize.load_tagged(path)[1] == ""
    assert optimize.load_tagged(path)[0].evaluations.cost == state.evaluations.cost


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
    messages = []
    for content in damaged:
        path.write_bytes(content)
        try:
            optimize.load_tagged(path)  # a flipped bit may not matter
        except IdentificationError as error:
            messages.append(str(error))
    assert len(messages) >= 100
    assert all(m.startswith(str(path)) and len(m.splitlines()) == 1 for m in messages)


def test_other_files_are_refused(state: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    optimize.save_state(path, state)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    later = arrays["header"].tobytes().replace(b"stoop-state/1", b"stoop-state/9")
    header = b'{"schema": "stoop-state/1", "state": {"class": "Path", "fields": {}}}'
    stream = b'Stream", "fields": {"state":1,"inc":1,"has_uint32":0,"uinteger":0}'
    none = header.replace(b'Path", "fields": {}', stream)  # a file names no class but ours
    for text, says in ((later, "stoop-state/9"), (header, "not a usable state"), (none, "holds no state")):
        np.savez(path, **arrays | {"header": np.frombuffer(text, dtype=np.uint8)})
        with pytest.raises(IdentificationError, match=says):
            optimize.load_tagged(path)
    with pytest.raises(IdentificationError, match="there is no saved state"):
        optimize.load_tagged(tmp_path / "none.npz")
    with pytest.raises(OutputError, match="cannot be written"):
        optimize.save_state(tmp_path / "none" / "state.npz", state)
    with pytest.raises(TypeError, match="cannot hold set"):
        optimize.save_state(tmp_path / "other.npz", replace(state, round={1}))


class Rastrigin(Residuals):
    """Thousands of local optima: the file beside this one holds a run on it, saved by release 0.1."""

    dimension = 3

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        Y = 8 * Z - 4
        return np.sqrt(30 + (Y**2 - 10 * np.cos(2 * np.pi * Y)).sum(axis=1))[:, None]

    def reference(self, rung: int) -> float:
        return 1e3


def test_the_state_of_release_0_1_loads_and_continues() -> None:
    old = optimize.load_tagged(Path(__file__).parent / "data" / "state-0.1.npz")[0]
    stop = optimize.Stop(generations=80)
    outcome = optimize.minimize(optimize.create(), Rastrigin(), seed=0, stop=stop, state=old)
    assert (old.generation, outcome.generation) == (60, 80)
    assert outcome.trajectories > old.evaluations.trajectories == 4359.0
    assert outcome.cost == pytest.approx(0.117749, rel=1e-4)
