"""An unfinished search goes on where it was, and only if it is the same; Ctrl-C waits while a finished one is written down."""

import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.base.interrupts import Deferred, deferred_interrupt
from stoop.errors import OutputError
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.workflow import checkpoint as module
from stoop.workflow import fit
from stoop.workflow.checkpoint import Checkpoint, identity


@pytest.fixture(scope="module")
def outcome(wrong: Vehicle, flight: Flight) -> optimize.Outcome:
    return fit(wrong, flight, ["0:8"], options=Options("de-rand-1-bin", generations=2)).estimate.outcome


@pytest.fixture
def state(outcome: optimize.Outcome) -> optimize.State:
    assert outcome.state is not None
    return outcome.state


def test_one_file_holds_the_state_and_what_it_belongs_to(tmp_path: Path, state: optimize.State) -> None:
    told: list[str] = []
    checkpoint, other = (Checkpoint(tmp_path, name, told.append) for name in ("this", "that"))
    checkpoint.keep(state)
    (file,) = tmp_path.iterdir()
    assert file.name == "search.npz"
    assert Checkpoint(tmp_path, "this", told.append).load().evaluations.cost == state.evaluations.cost
    with pytest.raises(OutputError, match=r"another one \(.*windows, decisions, method"):
        other.load()
    file.write_bytes(b"damaged")
    with pytest.raises(OutputError, match="--resume"):
        checkpoint.load()
    file.unlink()
    with pytest.raises(OutputError, match="no interrupted search"):
        checkpoint.load()
    assert not told


def test_the_last_state_is_kept(tmp_path: Path, outcome: optimize.Outcome, state: optimize.State) -> None:
    checkpoint = Checkpoint(tmp_path, "this", pytest.fail)
    checkpoint.keep(replace(state, generation=0))
    checkpoint.keep(replace(state, generation=1))  # too soon after the first
    assert checkpoint.load().generation == 0
    checkpoint.keep_last(outcome)
    checkpoint.forget(outcome.status)
    assert outcome.status == "generations"
    assert checkpoint.load().generation == state.generation == 2
    checkpoint.forget("converged")
    assert not list(tmp_path.iterdir())


def test_a_state_that_cannot_be_saved_is_told_once(
    tmp_path: Path, outcome: optimize.Outcome, state: optimize.State, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "INTERVAL", 0.0)
    told: list[str] = []
    checkpoint = Checkpoint(tmp_path / "out", "this", told.append)
    for _ in range(3):
        checkpoint.keep(state)
    (line,) = told
    assert "the search goes on" in line
    assert "\n" not in line
    checkpoint.keep_last(outcome)
    assert checkpoint.load().generation == state.generation


def test_identity_is_of_everything_that_decides_the_search(wrong: Vehicle) -> None:
    noise = np.diag(np.arange(1.0, 7.0))
    basis = {
        "vehicle": wrong, "files": {"a.ulg": "1"}, "maneuvers": ["0:20"], "validate": ["20:28"],
        "options": Options(covariance=noise),
    }  # fmt: skip
    loaded = replace(wrong, file=wrong.file.model_copy(update={"loadings": {"full": {"mass.mass": 210.0}}}))
    others = [
        {"vehicle": wrong.with_numbers({"mass.mass": {"value": 200.0}})}, {"vehicle": loaded}, {"files": {"a.ulg": "2"}},
        {"files": {"a.ulg": "1", "m.toml": "1"}}, {"maneuvers": ["0:20", "20:28"], "validate": []}, {"options": Options()},
        *({"options": one} for one in (Options(covariance=2.0 * noise), Options(seed=1, covariance=noise),
                                       Options("ps-gde", covariance=noise))),
    ]  # fmt: skip
    whole = identity(**basis)  # type: ignore[arg-type]
    assert len({whole, *(identity(**basis | one) for one in others)}) == 1 + len(others)  # type: ignore[arg-type]
    limits = Options(covariance=noise, generations=9, budget=5.0, target_cost=1.0)
    remark = replace(wrong, text="# a remark\n" + wrong.text)
    assert {identity(**basis | one) for one in ({"options": limits}, {"vehicle": remark})} == {whole}  # type: ignore[arg-type]


def test_the_first_interrupt_waits_and_the_second_stops(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupt() as ctrl_c:
        assert not ctrl_c.came
        signal.raise_signal(signal.SIGINT)
        assert ctrl_c.came
    assert signal.getsignal(signal.SIGINT) is before
    assert "writing its result" in capfd.readouterr().err
    with pytest.raises(KeyboardInterrupt), deferred_interrupt():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_process_that_ignores_interrupts_and_another_thread_go_on_doing_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupt() as ctrl_c:
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert not ctrl_c.came
    finally:
        signal.signal(signal.SIGINT, before)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(deferred_interrupt().__enter__).result() == Deferred(came=False)
