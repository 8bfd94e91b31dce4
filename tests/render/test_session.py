"""Which hand models and renderers stay loaded, and when they are loaded again."""

import sys
from types import SimpleNamespace

import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.model_file import builtin_hand_path
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.session import Device, Session, load_renderer

AVATAR, HAND = shipped_avatar_path(), builtin_hand_path()


class RecordedRenderer:
    """A renderer that only keeps the arguments it was made with."""

    avatar = SimpleNamespace(name="recorded", provenance={})
    is_relightable = False
    mean_albedo = None
    frames_at_once = 1
    renders_at_once = False

    def __init__(self, avatar_path, hand, device):
        self.avatar_path, self.hand, self.device = avatar_path, hand, device

    def posed_surface(self, shot):
        raise NotImplementedError

    def render(self, shot, should_stop):
        raise NotImplementedError


@pytest.fixture
def session():
    return Session(RecordedRenderer)


def test_a_hand_and_its_renderer_are_loaded_once(session):
    hand = session.hand(HAND)
    assert session.hand(HAND) is hand
    assert session.renderer(AVATAR, hand, Device()) is session.renderer(AVATAR, hand, Device())


def test_devices_and_avatars_are_kept_apart(session, tmp_path):
    (tmp_path / "mine.safetensors").write_bytes(b"avatar")
    hand, avatars, devices = (
        session.hand(HAND),
        (AVATAR, tmp_path / "mine.safetensors"),
        (Device(), Device("cpu")),
    )
    renderers = {session.renderer(avatar, hand, device) for avatar in avatars for device in devices}
    assert len(renderers) == 4
    assert session.renderer(AVATAR, hand, Device()) in renderers


def test_a_changed_file_replaces_what_was_loaded(session, tmp_path):
    avatar, hand = tmp_path / "a.safetensors", session.hand(HAND)
    avatar.write_bytes(b"one")
    first = session.renderer(avatar, hand, Device())
    avatar.write_bytes(b"second")
    second = session.renderer(avatar, hand, Device())
    assert second is not first
    assert session.avatar_path(second) == avatar
    assert session.avatar_paths == {avatar}
    with pytest.raises(ValueError, match="not enough values"):
        session.avatar_path(first)


def test_free_removes_everything(session):
    hand = session.hand(HAND)
    first = session.renderer(AVATAR, hand, Device())
    session.free()
    assert session.renderer(AVATAR, hand, Device()) is not first


def test_a_missing_file_is_named(session, tmp_path):
    with pytest.raises(LiveHandError, match=r"no file at .*gone\.npz .*in the LiveHand tab of the 3D view's sidebar"):
        session.hand(tmp_path / "gone.npz")


def test_loading_a_renderer_without_its_packages_is_an_import_error(monkeypatch, hand):
    monkeypatch.setitem(sys.modules, "livehand.backend.avatars.file", None)
    with pytest.raises(ImportError):
        load_renderer(AVATAR, hand, Device())
