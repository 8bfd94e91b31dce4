"""Kernels are compiled in the background once: when they are missing, and packages are there."""

import importlib
import tomllib
from pathlib import Path
from types import SimpleNamespace

import livehand
import pytest
from livehand.backend.compute.kernels import cache_folder
from livehand.backend.render.ahead.job import READY
from livehand.backend.system.child_job import JobProgress
from livehand.livehand_blender.render import preparation
from livehand.livehand_blender.render.preparation import Preparation, draw_preparation


@pytest.fixture
def started(monkeypatch):
    """The jobs that are started, of which none ends by itself."""
    jobs = []

    def start(name, module, request):
        assert callable(importlib.import_module(f"livehand.backend.{module}").run)
        job = SimpleNamespace(
            request=request, is_running=True, progress=JobProgress("20 of 80", 0.25), is_stopped=False
        )
        job.cancel = lambda: setattr(job, "is_stopped", True)
        jobs.append(job)
        return job

    monkeypatch.setattr(preparation, "ChildJob", SimpleNamespace(start=start))
    monkeypatch.setattr(preparation, "missing_requirements", lambda: [])
    monkeypatch.setattr(cache_folder, "is_prepared", lambda: False)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    return jobs


def test_it_starts_once_and_says_how_far_it_is(started):
    one = Preparation()
    assert one.progress is None
    assert one.go_on()
    assert one.go_on()
    assert [job.request for job in started] == [[0, 2], [1, 2]]
    started[0].progress = JobProgress("starting")
    assert one.progress == JobProgress("Preparing LiveHand (once): 25%", 0.25)
    drawn = []
    layout = SimpleNamespace(progress=lambda text, factor: drawn.append((text, factor)))
    draw_preparation(layout, one.progress)
    assert drawn == [("Preparing LiveHand (once): 25%", 0.25)]
    started[0].is_running = False
    assert one.progress is not None
    started[1].is_running = False
    assert one.progress is None
    draw_preparation(layout, one.progress)
    assert len(drawn) == 1


def test_what_pictures_do_not_need_at_first_is_compiled_once_while_no_view_waits(started):
    one = Preparation()
    one.go_on()
    for job in started:
        job.progress = JobProgress(READY, 0.4)
        assert (one.progress is None) == (job is started[1])
    assert one.go_on()  # what a finished picture needs is still to come
    assert len(started) == 2
    for job in started:
        job.is_running = False
    assert not one.go_on()
    assert not one.go_on()
    assert [job.request for job in started] == [[0, 2], [1, 2], None]
    assert one.progress is None
    one.stop()
    assert all(job.is_stopped for job in started)


@pytest.mark.parametrize("module", ["render/ahead/job.py", "tracking/film_job.py", "person/command.py"])
def test_what_jobs_run_is_in_the_extension(module):
    root = Path(livehand.__file__).parent
    manifest = tomllib.loads((root / "blender_manifest.toml").read_text())
    excluded = [pattern for pattern in manifest["build"]["paths_exclude_pattern"] if pattern.startswith("/")]
    assert [pattern for pattern in excluded if f"/backend/{module}".startswith(pattern)] == []


@pytest.mark.parametrize("why", ["packages are missing", "kernels are compiled", "numba is missing"])
def test_it_does_not_start_where_there_is_nothing_to_do(started, monkeypatch, why):
    if why == "packages are missing":
        monkeypatch.setattr(preparation, "missing_requirements", lambda: ["torch"])
    elif why == "kernels are compiled":
        monkeypatch.setattr(cache_folder, "is_prepared", lambda: True)
    else:
        monkeypatch.setattr(preparation.importlib.util, "find_spec", lambda name: None)
    assert not Preparation().go_on()
    assert started == []
