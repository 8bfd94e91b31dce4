"""Modules in the current folder are not run by the Pythons that we start."""

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.package_files import fetch_files
from livehand.backend.tracking import live
from livehand.backend.tracking.live import CameraSource, LiveTracker
from livehand.backend.tracking.weights import PACKAGE


@pytest.fixture
def trap(tmp_path, monkeypatch):
    """A current folder with modules that leave a mark when they are imported."""
    mark = tmp_path / "mark"
    for name in ("pip", "json", "numpy", "threading"):
        (tmp_path / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')\nraise SystemExit('not {name}')\n")
    monkeypatch.chdir(tmp_path)
    return mark


@pytest.mark.slow
def test_the_networks_are_fetched_with_the_real_pip(trap, monkeypatch):
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    with pytest.raises(LiveHandError, match="pip must download"):
        fetch_files(PACKAGE)
    assert not trap.exists()


def test_the_tracker_process_imports_the_real_modules(trap, monkeypatch):
    monkeypatch.setattr(live, "load_networks", lambda weights: None)
    monkeypatch.setattr(live.sys, "path", ["", *live.sys.path])
    tracker = LiveTracker(CameraSource(str(trap.parent / "none.mp4"), is_file=True))
    tracker._process.wait(60)
    tracker._reader.join(10)
    with pytest.raises(LiveHandError, match=r"none\.mp4"):
        tracker.newest()
    tracker.close()
    assert not trap.exists()
