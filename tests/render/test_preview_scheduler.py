"""The preview scheduler: newest first, coarse before fine, and never an image older than the last."""

import threading
import time

import pytest
from livehand.backend.render.preview_scheduler import PreviewScheduler

PATIENCE_S = 5


@pytest.fixture
def preview():
    made = PreviewScheduler()
    yield made
    made.close()


class Gate:
    """A step that records that it has begun, and ends when it is opened or stopped."""

    def __init__(self, value):
        self.value = value
        self.begun, self.opened = threading.Event(), threading.Event()
        self.was_stopped = False

    def __call__(self, should_stop):
        self.begun.set()
        while not self.opened.wait(0.001):
            if should_stop():
                self.was_stopped = True
                raise RuntimeError("stopped")
        return self.value


def wait_for(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "the condition was not met in time"
        time.sleep(0.001)


def outcome(preview, view):
    wait_for(lambda: preview.has_outcome(view))
    return preview.pop_outcome(view)


def test_steps_run_one_after_the_other(preview):
    fine = Gate("fine")
    preview.submit("view", [lambda stop: "coarse", fine])
    assert outcome(preview, "view").value == "coarse"
    assert fine.begun.wait(PATIENCE_S)
    assert preview.is_busy("view")
    assert preview.pop_outcome("view") is None
    fine.opened.set()
    assert outcome(preview, "view").value == "fine"
    wait_for(lambda: not preview.is_busy("view"))


def test_an_outcome_tells_its_step_and_how_long_it_took(preview):
    gate, start = Gate("coarse"), time.monotonic()
    preview.submit("view", [gate])
    assert gate.begun.wait(PATIENCE_S)
    time.sleep(0.02)
    gate.opened.set()
    got = outcome(preview, "view")
    assert got.step is gate
    assert 0.02 <= got.seconds <= time.monotonic() - start


def test_a_first_step_is_never_stopped_and_waiting_steps_are_replaced(preview):
    first, second, third = Gate(1), Gate(2), Gate(3)
    preview.submit("view", [first, lambda stop: "fine 1"])
    assert first.begun.wait(PATIENCE_S)
    assert not preview.is_waiting("view")
    preview.submit("view", [second])
    assert preview.is_waiting("view")
    preview.submit("view", [third])
    first.opened.set()
    assert outcome(preview, "view").value == 1
    third.opened.set()
    assert outcome(preview, "view").value == 3
    assert not preview.is_waiting("view")
    wait_for(lambda: not preview.is_busy("view"))
    assert not second.begun.is_set()
    assert preview.pop_outcome("view") is None


def test_a_finer_step_stops_for_something_newer(preview):
    fine, newer = Gate("old fine"), Gate("new")
    preview.submit("view", [lambda stop: "old", fine])
    assert fine.begun.wait(PATIENCE_S)
    assert preview.pop_outcome("view").value == "old"
    preview.submit("view", [newer])
    assert newer.begun.wait(PATIENCE_S)
    assert fine.was_stopped
    newer.opened.set()
    assert outcome(preview, "view").value == "new"
    wait_for(lambda: not preview.is_busy("view"))


def test_a_preempted_view_is_continued(preview):
    fine, other = Gate("fine"), Gate("other")
    preview.submit("view", [lambda stop: "coarse", fine])
    assert fine.begun.wait(PATIENCE_S)
    preview.submit("other", [other])
    assert other.begun.wait(PATIENCE_S)
    assert fine.was_stopped
    assert not preview.is_waiting("view")  # only a finer step does
    fine.opened.set()
    other.opened.set()
    assert outcome(preview, "other").value == "other"
    wait_for(lambda: not preview.is_busy("view"))
    assert preview.pop_outcome("view").value == "fine"


def test_an_error_is_an_outcome_and_ends_the_steps(preview):
    def fail(should_stop):
        raise ValueError("no avatar")

    never = Gate("fine")
    preview.submit("view", [fail, never])
    assert str(outcome(preview, "view").error) == "no avatar"
    assert not preview.is_busy("view")
    assert not never.begun.is_set()
    preview.submit("view", [lambda stop: "again"])
    assert outcome(preview, "view").value == "again"


def test_a_forgotten_view_is_stopped_and_leaves_nothing(preview):
    gate = Gate("coarse")
    preview.submit("view", [gate, lambda stop: "fine"])
    assert gate.begun.wait(PATIENCE_S)
    preview.forget("view")
    assert not preview.is_busy("view")
    preview.submit("other", [lambda stop: "other"])
    assert outcome(preview, "other").value == "other"
    assert gate.was_stopped
    assert preview.pop_outcome("view") is None


def test_close_stops_what_runs():
    preview, gate = PreviewScheduler(), Gate("coarse")
    preview.submit("view", [gate])
    assert gate.begun.wait(PATIENCE_S)
    preview.close()
    assert gate.was_stopped
