"""A zip that is tried: what ends it too late is told in words."""

from types import SimpleNamespace

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.tools.release import try_zip as module


def test_a_zip_that_does_not_end_is_told_with_what_it_said_so_far(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "sources_of_zip", lambda path: {})
    monkeypatch.setattr(module, "imports_of", lambda sources: SimpleNamespace(modules=[]))
    monkeypatch.setattr(module, "_TRY", "import time; print('TRIED {\"install_s\": 1}', flush=True); time.sleep(60)")
    monkeypatch.setattr(module, "_SECONDS", 3)
    with pytest.raises(LiveHandError, match=r"tiny\.zip must render within 3 s, got only: TRIED .*install_s"):
        module.try_zip(tmp_path / "tiny.zip")
