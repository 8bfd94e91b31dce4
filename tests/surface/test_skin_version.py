"""Which version of the built-in skin a capture shows."""

import shutil

from livehand.backend.hand.model_file import builtin_hand_path
from livehand.backend.surface import base_surface
from livehand.backend.surface import skin_version as module
from livehand.backend.surface.base_surface import COARSE_FILE, FINE_FILE, HAIR_FILE, SURFACE_FILE, base_sha256
from livehand.backend.surface.skin_version import SKIN_VERSION, is_current_skin, skin_version


def test_any_changed_file_is_another_version(tmp_path, monkeypatch):
    hand = builtin_hand_path()
    for name in (SURFACE_FILE, FINE_FILE, COARSE_FILE, HAIR_FILE):
        shutil.copy(hand.with_name(name), tmp_path)
    shipped, base = skin_version(), base_sha256()
    monkeypatch.setattr(base_surface, "builtin_hand_path", lambda: tmp_path / hand.name)
    monkeypatch.setattr(base_surface, "files_sha256", base_surface.files_sha256.__wrapped__)
    monkeypatch.setattr(module, "files_sha256", base_surface.files_sha256)
    assert (skin_version(), base_sha256()) == (shipped, base)
    for name in (SURFACE_FILE, FINE_FILE, COARSE_FILE, HAIR_FILE):
        before = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
        assert base_sha256() != base
        assert (skin_version() != shipped) == (name != HAIR_FILE)  # captures show no hair
        (tmp_path / name).write_bytes(before)


def test_a_capture_may_not_tell():
    assert [is_current_skin(capture) for capture in ({}, None, [], "skin_version", 3.0)] == [None] * 5
    assert is_current_skin({SKIN_VERSION: skin_version()}) is True
    assert is_current_skin({SKIN_VERSION: "0" * 12}) is False
