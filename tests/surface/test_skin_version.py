"""Which version of the built-in skin a capture shows."""

import shutil

from livehand.backend.hand.model_file import builtin_hand_path
from livehand.backend.surface import skin_version as module
from livehand.backend.surface.detail_maps_file import COARSE_FILE, FINE_FILE
from livehand.backend.surface.fine_surface import FILE
from livehand.backend.surface.skin_version import SKIN_VERSION, is_current_skin, skin_version


def test_any_changed_file_is_another_version(tmp_path, monkeypatch):
    hand = builtin_hand_path()
    for name in (FILE, FINE_FILE, COARSE_FILE):
        shutil.copy(hand.with_name(name), tmp_path)
    monkeypatch.setattr(module, "builtin_hand_path", lambda: tmp_path / hand.name)
    version = skin_version.__wrapped__
    assert version() == skin_version()
    for name in (FILE, FINE_FILE, COARSE_FILE):
        before = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
        assert version() != skin_version()
        (tmp_path / name).write_bytes(before)


def test_a_capture_may_not_tell():
    assert [is_current_skin(capture) for capture in ({}, None, [], "skin_version", 3.0)] == [None] * 5
    assert is_current_skin({SKIN_VERSION: skin_version()}) is True
    assert is_current_skin({SKIN_VERSION: "0" * 12}) is False
