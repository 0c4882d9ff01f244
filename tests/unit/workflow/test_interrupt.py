"""Ctrl-C waits while a finished search is written down."""

from __future__ import annotations

import signal
import threading

import pytest

from stoop.base.interrupts import Deferred, deferred_interrupt


def test_the_first_waits_and_what_was_before_comes_back(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupt() as ctrl_c:
        assert not ctrl_c.came
        signal.raise_signal(signal.SIGINT)
        assert ctrl_c.came
    assert signal.getsignal(signal.SIGINT) is before
    assert "writing its result" in capfd.readouterr().err
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def press_twice() -> None:
    with deferred_interrupt():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)


def test_the_second_stops(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        press_twice()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_process_that_ignores_it_goes_on_doing_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupt() as ctrl_c:
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert not ctrl_c.came
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_leaves_it_alone() -> None:
    seen: list[Deferred] = []

    def work() -> None:
        with deferred_interrupt() as ctrl_c:
            seen.append(ctrl_c)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [Deferred(came=False)]
