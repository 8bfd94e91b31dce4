"""Signals that ask to stop are an interruption; ignored ones stay ignored."""

import os
import signal
import subprocess
import sys
import threading

import pytest
from livehand.backend.system import processes as signals
from livehand.backend.system.processes import on_stop_signals, stop_signals, stopping_as_at_ctrl_c

posix = pytest.mark.skipif(os.name == "nt", reason="sends the signals of Linux and macOS")


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", None)])
def test_a_signal_raises_keyboard_interrupt_and_the_handler_before_it_comes_back(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), stopping_as_at_ctrl_c():
        signal.raise_signal(number)
    assert signal.getsignal(number) is before


@posix
def test_only_ctrl_c_interrupts_what_stops_already():
    with stopping_as_at_ctrl_c():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@posix
def test_what_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping_as_at_ctrl_c():
            signal.raise_signal(signal.SIGHUP)
            assert signal.SIGHUP not in stop_signals()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_thread_leaves_the_handlers_alone():
    before, inside = signal.getsignal(signal.SIGTERM), []

    def work():
        with on_stop_signals(inside.append):
            inside.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert inside == [before]


def test_a_system_without_sighup_has_its_own_signals(monkeypatch):
    class WindowsSignals:
        __members__ = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}

        def __class_getitem__(cls, name):
            return cls.__members__[name]

    monkeypatch.setattr(signals.signal, "Signals", WindowsSignals)
    assert set(stop_signals()) <= {signal.SIGINT, signal.SIGTERM}


@pytest.mark.parametrize("system", [os.name, "nt"])
def test_a_thread_asks_its_process_to_stop(system):
    program = f"""
import os, threading, time
from livehand.backend.system.processes import ask_this_process_to_stop, stopping_as_at_ctrl_c
os.name = {system!r}
try:
    with stopping_as_at_ctrl_c():
        threading.Thread(target=ask_this_process_to_stop).start()
        for _ in range(500):
            time.sleep(0.01)
except KeyboardInterrupt:
    os._exit(130)
"""
    assert subprocess.run([sys.executable, "-c", program], timeout=10, check=False).returncode == 130
