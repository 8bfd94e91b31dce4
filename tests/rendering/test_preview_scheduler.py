"""The thread of the 3D views: newest first, coarse before fine, nothing shown that is older than what was."""

import threading
import time

import pytest
from livehand.backend.rendering.preview_scheduler import PreviewScheduler

PATIENCE_S = 5


@pytest.fixture
def preview():
    made = PreviewScheduler()
    yield made
    made.close()


class Gate:
    """A step that says that it has begun, and ends when it is opened or told to stop."""

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
        assert time.monotonic() < end, "has not come"
        time.sleep(0.001)


def taken(preview, view):
    wait_for(lambda: preview.has_news(view))
    return preview.take(view)


def test_steps_come_one_after_the_other(preview):
    fine = Gate("fine")
    preview.ask("view", [lambda stop: "coarse", fine])
    assert taken(preview, "view").value == "coarse"
    assert fine.begun.wait(PATIENCE_S)
    assert preview.is_busy("view")
    assert preview.take("view") is None
    fine.opened.set()
    assert taken(preview, "view").value == "fine"
    wait_for(lambda: not preview.is_busy("view"))


def test_a_first_step_is_never_stopped_and_what_waited_is_replaced(preview):
    first, second, third = Gate(1), Gate(2), Gate(3)
    preview.ask("view", [first, lambda stop: "fine 1"])
    assert first.begun.wait(PATIENCE_S)
    preview.ask("view", [second])
    preview.ask("view", [third])
    first.opened.set()
    assert taken(preview, "view").value == 1
    third.opened.set()
    assert taken(preview, "view").value == 3
    wait_for(lambda: not preview.is_busy("view"))
    assert not second.begun.is_set()
    assert preview.take("view") is None


def test_a_finer_step_stops_for_something_newer(preview):
    fine, newer = Gate("old fine"), Gate("new")
    preview.ask("view", [lambda stop: "old", fine])
    assert fine.begun.wait(PATIENCE_S)
    assert preview.take("view").value == "old"
    preview.ask("view", [newer])
    assert newer.begun.wait(PATIENCE_S)
    assert fine.was_stopped
    newer.opened.set()
    assert taken(preview, "view").value == "new"
    wait_for(lambda: not preview.is_busy("view"))


def test_a_view_outrun_by_another_is_taken_up_again(preview):
    fine, other = Gate("fine"), Gate("other")
    preview.ask("view", [lambda stop: "coarse", fine])
    assert fine.begun.wait(PATIENCE_S)
    preview.ask("other", [other])
    assert other.begun.wait(PATIENCE_S)
    assert fine.was_stopped
    fine.opened.set()
    other.opened.set()
    assert taken(preview, "other").value == "other"
    wait_for(lambda: not preview.is_busy("view"))
    assert preview.take("view").value == "fine"


def test_an_error_is_an_outcome_and_ends_the_steps(preview):
    def fail(should_stop):
        raise ValueError("no avatar")

    never = Gate("fine")
    preview.ask("view", [fail, never])
    assert str(taken(preview, "view").error) == "no avatar"
    assert not preview.is_busy("view")
    assert not never.begun.is_set()
    preview.ask("view", [lambda stop: "again"])
    assert taken(preview, "view").value == "again"


def test_a_forgotten_view_is_stopped_and_leaves_nothing(preview):
    gate = Gate("coarse")
    preview.ask("view", [gate, lambda stop: "fine"])
    assert gate.begun.wait(PATIENCE_S)
    preview.forget("view")
    assert not preview.is_busy("view")
    preview.ask("other", [lambda stop: "other"])
    assert taken(preview, "other").value == "other"
    assert gate.was_stopped
    assert preview.take("view") is None


def test_close_stops_what_runs():
    preview, gate = PreviewScheduler(), Gate("coarse")
    preview.ask("view", [gate])
    assert gate.begun.wait(PATIENCE_S)
    preview.close()
    assert gate.was_stopped
