"""Work in a thread of its own: its result, its errors, questions while it is silent, and its end."""

import threading
import time
from itertools import pairwise

import pytest
from livehand.backend.render.background import BackgroundWork


@pytest.fixture
def background():
    work = BackgroundWork()
    yield work
    work.close()


def test_the_result_and_the_error_come_back(background):
    assert background.run(lambda _: threading.current_thread().name).startswith("livehand-still")
    with pytest.raises(TimeoutError, match="of the work"):
        background.run(lambda _: (_ for _ in ()).throw(TimeoutError("of the work")))


@pytest.mark.slow
def test_the_caller_is_asked_while_the_work_is_silent(background):
    asked = []
    background.run(lambda _: time.sleep(0.6), lambda: asked.append(time.perf_counter()))
    assert len(asked) >= 4
    assert max(late - early for early, late in pairwise(asked)) < 0.2


def test_a_stopped_caller_does_not_wait_and_the_next_work_does(background):
    ended = []

    def slow(should_stop):
        while not should_stop():
            time.sleep(0.01)
        time.sleep(0.2)
        ended.append(True)

    start = time.perf_counter()
    assert background.run(slow, lambda: True) is None
    assert not ended
    assert background.run(lambda _: list(ended)) == [True]
    assert time.perf_counter() - start < 5


def test_what_has_not_begun_is_never_begun(background):
    begun = threading.Event()
    assert background.run(lambda stop: begun.wait(5), lambda: True) is None
    ran = []
    assert background.run(lambda _: ran.append(True), lambda: True) is None
    begun.set()
    background.run(lambda _: None)
    assert not ran


@pytest.mark.slow
def test_progress_rises_with_the_questions_of_the_last_time(background):
    def work(should_stop, questions=10):
        for _ in range(questions):
            should_stop()
            time.sleep(0.03)

    background.run(work)
    shares = []
    background.run(work, on_progress=shares.append)
    assert shares == sorted(shares)
    assert len(set(shares)) >= 3
    assert max(shares) <= 0.99
    assert max(shares) > 0.3
