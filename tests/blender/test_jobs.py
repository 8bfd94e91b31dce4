"""Operators that wait for a job: the window goes on, progress is shown, Esc cancels, errors are reported."""

from types import SimpleNamespace

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.child_job import JobProgress
from livehand.backend.tracking.film_job import FilmRequest
from livehand.livehand_blender.motion import film_job
from livehand.livehand_blender.ui import jobs

TICK, ESC = SimpleNamespace(type="TIMER", value="NOTHING"), SimpleNamespace(type="ESC", value="PRESS")


class FakeJob:
    is_running, progress, was_canceled = True, JobProgress("frame 3 of 12", 0.25), False

    def wait(self):
        self.is_running = False

    def cancel(self):
        self.is_running, self.was_canceled = False, True


class Operator(jobs.RunsJob):
    bl_label = "Import"

    def __init__(self, job, error=""):
        self.job, self.error, self.reports, self.taken = job, error, [], []

    def report(self, kind, text):
        self.reports.append((*kind, text))

    def start(self, context):
        if self.error == "at the start":
            raise LiveHandError(self.error)
        return self.job

    def take(self, context, job):
        if self.error:
            raise LiveHandError(self.error)
        self.taken.append(job)


class Layout:
    def __init__(self):
        self.drawn = []

    def row(self, align=False):
        return self

    def separator(self, factor=1.0):
        pass

    def label(self, text="", icon="NONE"):
        self.drawn.append(text)

    def progress(self, factor, text):
        self.drawn.append((factor, text))


@pytest.fixture
def window(monkeypatch):
    """A context with a window, which notes what happens to it."""
    monkeypatch.setattr(jobs, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    found = SimpleNamespace(timers=[], handlers=[], status=[])
    manager = SimpleNamespace(
        event_timer_add=lambda interval, window: found.timers.append(interval) or "timer",
        event_timer_remove=lambda timer: found.timers.pop(),
        modal_handler_add=found.handlers.append,
    )
    workspace = SimpleNamespace(status_text_set=found.status.append)
    found.context = SimpleNamespace(window="window", window_manager=manager, workspace=workspace)
    return found


def test_the_window_goes_on_until_the_job_has_ended(window):
    operator = Operator(FakeJob())
    assert operator.execute(window.context) == {"RUNNING_MODAL"}
    assert window.handlers == [operator]
    assert operator.modal(window.context, TICK) == {"PASS_THROUGH"}
    layout = Layout()
    window.status[-1](SimpleNamespace(layout=layout), window.context)
    assert layout.drawn == ["Cancel", (0.25, "Import: frame 3 of 12")]
    operator.job.progress = JobProgress("fetching")
    operator.modal(window.context, TICK)
    window.status[-1](SimpleNamespace(layout=layout), window.context)
    assert layout.drawn[2:] == ["Cancel", "Import: fetching"]
    operator.job.is_running = False
    for event in (("MOUSEMOVE", "NOTHING"), ("ESC", "RELEASE")):  # of the key that closed something else
        other = SimpleNamespace(type=event[0], value=event[1])
        assert operator.modal(window.context, other) == {"PASS_THROUGH"}
    assert operator.modal(window.context, TICK) == {"FINISHED"}
    assert (operator.taken, window.timers, window.status[-1]) == ([operator.job], [], None)


def test_esc_cancels_and_nothing_is_taken(window):
    operator = Operator(FakeJob())
    operator.execute(window.context)
    assert operator.modal(window.context, ESC) == {"CANCELLED"}
    assert operator.job.was_canceled
    assert (operator.taken, window.timers, window.status[-1]) == ([], [], None)
    assert operator.reports == [("INFO", "Import: canceled, nothing has changed")]


@pytest.mark.parametrize("error", ["at the start", "at the end"])
def test_errors_are_reported(window, error):
    operator = Operator(FakeJob(), error)
    result = operator.execute(window.context)
    if error == "at the end":
        assert result == {"RUNNING_MODAL"}
        operator.job.is_running = False
        result = operator.modal(window.context, TICK)
    assert result == {"CANCELLED"}
    assert operator.reports == [("ERROR", error)]
    assert window.timers == []


def test_without_a_window_it_waits(window):
    """In the background, and in a script of a window's Blender, whose context has none after a file was opened."""
    window.context.window = None
    for is_background in (True, False):
        jobs.bpy.app.background = is_background
        operator = Operator(FakeJob())
        assert operator.execute(window.context) == {"FINISHED"}
        assert not operator.job.is_running
        assert operator.taken == [operator.job]


def test_a_film_that_is_canceled_leaves_no_file(monkeypatch, tmp_path):
    monkeypatch.setattr(film_job.tempfile, "tempdir", str(tmp_path))
    (tmp_path / "film.mp4").write_text("no video")
    monkeypatch.setattr(film_job.importlib.util, "find_spec", lambda name: name)
    job = film_job.FilmJob(FilmRequest(str(tmp_path / "film.mp4"), ""))
    job.cancel()
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
