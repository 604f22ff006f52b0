"""A first signal waits for the step to end, a second one does not."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from aerial_il.algorithms.run.signals import SignalWatch


def send(number: signal.Signals) -> None:
    os.kill(os.getpid(), number)


def test_the_first_signal_is_remembered_and_the_second_one_stops() -> None:
    with SignalWatch() as watch:
        assert watch.pending is None
        send(signal.SIGTERM)
        assert watch.pending == signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            send(signal.SIGINT)


def test_each_signal_leaves_in_its_own_way() -> None:
    with SignalWatch() as watch:
        send(signal.SIGTERM)
        with pytest.raises(SystemExit) as caught:
            watch.stop()
    assert caught.value.code == 143


def test_a_signal_stops_long_work_before_and_during_it() -> None:
    with SignalWatch() as watch:
        with pytest.raises(KeyboardInterrupt), watch.at_once():
            send(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), watch.at_once():
            raise AssertionError("begun")


def test_handlers_come_back_and_other_threads_are_left_alone() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with SignalWatch():
        assert signal.getsignal(signal.SIGINT) is not before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    seen: list[int | None] = []

    def elsewhere() -> None:
        with SignalWatch() as watch:
            seen.append(watch.pending)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [None]
