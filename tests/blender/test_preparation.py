"""Kernels are compiled in the background once: when they are missing, and packages are there."""

import importlib
import tomllib
from pathlib import Path
from types import SimpleNamespace

import livehand
import pytest
from livehand.backend.compute.kernels import cache_folder
from livehand.backend.system.child_job import JobProgress
from livehand.livehand_blender.render import preparation
from livehand.livehand_blender.render.preparation import Preparation, draw_preparation


@pytest.fixture
def started(monkeypatch):
    """The jobs that are started, of which none ends by itself."""
    jobs = []

    def start(name, module, request):
        assert callable(importlib.import_module(f"livehand.backend.{module}").run)
        jobs.append(SimpleNamespace(is_running=True, progress=JobProgress("40 of 171", 0.25), cancel=lambda: None))
        return jobs[-1]

    monkeypatch.setattr(preparation, "ChildJob", SimpleNamespace(start=start))
    monkeypatch.setattr(preparation, "missing_requirements", lambda: [])
    monkeypatch.setattr(cache_folder, "is_prepared", lambda: False)
    return jobs


def test_it_starts_once_and_says_how_far_it_is(started):
    one = Preparation()
    assert one.progress is None
    one.start()
    one.start()
    assert len(started) == 1
    assert one.progress == JobProgress("Preparing LiveHand (once): 40 of 171", 0.25)
    drawn = []
    layout = SimpleNamespace(progress=lambda text, factor: drawn.append((text, factor)))
    draw_preparation(layout, one.progress)
    assert drawn == [("Preparing LiveHand (once): 40 of 171", 0.25)]
    started[0].is_running = False
    assert one.progress is None
    draw_preparation(layout, one.progress)
    assert len(drawn) == 1


@pytest.mark.parametrize("module", ["render/session.py", "tracking/film_job.py", "person/command.py"])
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
    Preparation().start()
    assert started == []
