"""Ctrl-C waits while a finished search is written down."""

from __future__ import annotations

import signal
import threading

import pytest

from stoop.base.interrupts import Deferred, deferred_interrupt


def press_twice() -> None:
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)


def test_the_first_waits_and_the_second_stops(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupt() as ctrl_c:
        assert not ctrl_c.came
        signal.raise_signal(signal.SIGINT)
        assert ctrl_c.came
    assert signal.getsignal(signal.SIGINT) is before
    assert "writing its result" in capfd.readouterr().err
    with pytest.raises(KeyboardInterrupt), deferred_interrupt():
        press_twice()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_process_that_ignores_it_and_another_thread_go_on_doing_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupt() as ctrl_c:
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert not ctrl_c.came
    finally:
        signal.signal(signal.SIGINT, before)
    seen: list[Deferred] = []

    def work() -> None:
        with deferred_interrupt() as ctrl_c:
            seen.append(ctrl_c)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [Deferred(came=False)]
