"""What stays loaded, and when it is loaded again."""

import sys

import pytest
from livehand.backend.avatars.session import Device, Session, load_renderer
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError


class Made:
    def __init__(self, *arguments):
        self.arguments = arguments


@pytest.fixture
def session():
    return Session(Made)


def test_a_hand_and_its_renderer_are_loaded_once(session):
    hand = session.hand(None)
    assert session.hand(None) is hand
    assert session.renderer(None, hand, Device()) is session.renderer(None, hand, Device())


def test_devices_and_avatars_are_kept_apart(session, tmp_path):
    (tmp_path / "mine.safetensors").write_bytes(b"avatar")
    hand, avatars, devices = session.hand(None), (None, tmp_path / "mine.safetensors"), (Device(), Device("cpu"))
    made = {session.renderer(avatar, hand, device) for avatar in avatars for device in devices}
    assert len(made) == 4
    assert session.renderer(None, hand, Device()) in made


def test_a_changed_file_replaces_what_was_loaded(session, tmp_path):
    avatar, hand = tmp_path / "a.safetensors", session.hand(None)
    avatar.write_bytes(b"one")
    first = session.renderer(avatar, hand, Device())
    avatar.write_bytes(b"second")
    assert session.renderer(avatar, hand, Device()) is not first
    assert len(session._renderers) == 1


def test_free_forgets_everything(session):
    hand = session.hand(None)
    first = session.renderer(None, hand, Device())
    session.free()
    assert session.renderer(None, hand, Device()) is not first


def test_a_missing_file_is_named(session, tmp_path):
    with pytest.raises(LiveHandError, match=r"no file at .*gone\.npz"):
        session.hand(tmp_path / "gone.npz")


def test_a_missing_package_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "livehand.backend.avatars.file", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(LiveHandError, match=r"lacks: torch; install them with: .*pip install"):
        load_renderer(None, load_default_hand(), Device())
