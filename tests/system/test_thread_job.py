"""Jobs in threads: progress, results, errors, and their end."""

import time

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.child_job import JobProgress
from livehand.backend.system.thread_job import ThreadJob


class Stopped(Exception):
    """What the work raises when it is told to stop."""


def until_stopped(report, should_stop):
    report(JobProgress("going", 0.5))
    while not should_stop():
        time.sleep(0.001)
    raise Stopped


def test_a_result_is_there_after_the_end():
    job = ThreadJob("test", lambda report, should_stop: 7)
    job.wait()
    assert not job.is_running
    assert job.result() == 7


def test_progress_is_told_until_it_is_cancelled():
    job = ThreadJob("test", until_stopped)
    while job.progress.share is None:
        time.sleep(0.001)
    assert job.is_running
    assert job.progress == JobProgress("going", 0.5)
    job.cancel()
    assert not job.is_running
    with pytest.raises(Stopped):
        job.result()


def test_an_error_is_raised_where_the_result_is_asked_for():
    def wrong(report, should_stop):
        raise LiveHandError("a hand must be there")

    with pytest.raises(LiveHandError, match="must be there"):
        ThreadJob("test", wrong).result()
