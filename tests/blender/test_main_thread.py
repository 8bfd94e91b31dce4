"""Calls from other threads, served as Blender's timer would."""

import threading
import time

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.scene import main_thread


def served_from_a_thread(function):
    """What a call from another thread ends with, and the thread that the function ran in."""
    outcome = []

    def call():
        try:
            main_thread.call_in_main_thread(function)
            outcome.append(None)
        except Exception as error:
            outcome.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    until = time.monotonic() + 5
    while thread.is_alive() and time.monotonic() < until:
        main_thread._serve()
        time.sleep(0.01)
    thread.join()
    return outcome[0]


def test_a_call_from_the_main_thread_is_direct():
    ran = []
    main_thread.call_in_main_thread(lambda: ran.append(threading.current_thread()))
    assert ran == [threading.main_thread()]


def test_a_call_from_another_thread_runs_in_the_main_thread():
    ran = []
    assert served_from_a_thread(lambda: ran.append(threading.current_thread())) is None
    assert ran == [threading.main_thread()]


def test_its_error_is_raised_there():
    def fail():
        raise OSError("disk full")

    assert isinstance(served_from_a_thread(fail), OSError)


def test_a_main_thread_that_does_not_answer_is_an_error_and_the_call_is_given_up(monkeypatch):
    monkeypatch.setattr(main_thread, "_TIMEOUT_S", 0.05)
    ran, errors = [], []

    def call():
        with pytest.raises(LiveHandError, match="Blender's interface must answer"):
            main_thread.call_in_main_thread(lambda: ran.append(1))
        errors.append(1)

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    main_thread._serve()
    assert errors == [1]
    assert ran == []
