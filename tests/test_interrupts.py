"""Signals kept back: none is lost, none comes in the middle, and handlers are as before."""

import doctest
import signal
import threading

import pytest

from pulsewright import interrupts
from pulsewright.interrupts import kept_back


@pytest.fixture(autouse=True)
def handlers():
    before = {n: signal.getsignal(n) for n in interrupts.KEPT}
    yield
    assert {n: signal.getsignal(n) for n in interrupts.KEPT} == before


def test_an_interrupt_comes_at_the_end():
    done = []

    def work():
        with kept_back() as interrupted:
            assert not interrupted()
            signal.raise_signal(signal.SIGINT)
            assert interrupted()
            done.append(1)
        done.append(2)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == [1]


def test_a_termination_that_nobody_handles_becomes_an_exit():
    def work():
        with kept_back():
            signal.raise_signal(signal.SIGTERM)

    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    with pytest.raises(SystemExit) as ended:
        work()
    assert ended.value.code == 143


def test_it_does_what_the_handler_does(monkeypatch):
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with kept_back():
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGTERM)
            assert heard == []
        assert heard == [signal.SIGTERM]  # once
    finally:
        signal.signal(signal.SIGTERM, before)


def test_one_inside_another_hands_it_on():
    def work():
        with kept_back() as outer:
            with kept_back() as inner:
                signal.raise_signal(signal.SIGINT)
                assert inner()
            assert outer()

    with pytest.raises(KeyboardInterrupt):
        work()


def test_ignored_signals_stay_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with kept_back() as interrupted:
            signal.raise_signal(signal.SIGINT)
            assert not interrupted()
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_error_inside_does_not_hide_it():
    def work():
        with kept_back():
            signal.raise_signal(signal.SIGINT)
            raise ValueError

    with pytest.raises(KeyboardInterrupt) as ended:
        work()
    assert isinstance(ended.value.__context__, ValueError)


def test_other_threads_are_left_alone():
    seen = []

    def work():
        with kept_back() as interrupted:
            seen.append(interrupted())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]


def test_the_example_holds():
    assert doctest.testmod(interrupts) == (0, 2)
