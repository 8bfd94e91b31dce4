"""The avatar chooser: which avatars it offers, their metadata, and the choice of one."""

import os
from dataclasses import replace

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import PERSONS, SHIPPED, SKINS, shipped_avatar_path
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.render.hand_source import hand_source
from livehand.livehand_blender.ui import avatar_library as library_module
from livehand.livehand_blender.ui.avatar_library import AvatarLibrary
from livehand.livehand_blender.ui.avatars import facts

OFFERED = [*SKINS, *(PERSONS[name] for name in SHIPPED[len(SKINS) :])]


@pytest.fixture
def library():
    library = AvatarLibrary()
    yield library
    library.close()


@pytest.fixture
def right_hand():
    bpy.ops.livehand.add_hand()
    return bpy.context.object


@pytest.fixture
def my_folder(tmp_path, monkeypatch):
    """The folder of the preferences: an avatar of the built-in hand, one of another hand, and a broken file."""
    save_avatar(replace(load_avatar(), name="mine"), tmp_path / "mine.safetensors")
    save_avatar(replace(load_avatar(), name="other", hand_sha256="ab" * 32), tmp_path / "other.safetensors")
    (tmp_path / "broken.safetensors").write_text("not an avatar")
    monkeypatch.setattr(library_module, "avatar_folder", lambda context: tmp_path)
    return tmp_path


def test_avatars_of_the_same_hand_are_offered(library, right_hand, my_folder):
    assert [metadata.name for metadata in library.offered(bpy.context, right_hand)] == [*OFFERED, "mine"]


def test_the_chosen_file_and_its_folder_are_offered_once(library, right_hand, tmp_path):
    for name in ("a", "b"):
        save_avatar(replace(load_avatar(), name=name), tmp_path / f"{name}.safetensors")
    right_hand.livehand.avatar_path = str(tmp_path / "b.safetensors")
    assert [metadata.name for metadata in library.offered(bpy.context, right_hand)] == [*OFFERED, "b", "a"]


def test_a_changed_file_is_read_again(library, right_hand, my_folder):
    library.offered(bpy.context, right_hand)
    path = my_folder / "mine.safetensors"
    stamp = path.stat().st_mtime_ns
    save_avatar(replace(load_avatar(), name="changed"), path)
    os.utime(path, ns=(stamp + 10**9, stamp + 10**9))
    assert library.offered(bpy.context, right_hand)[-1].name == "changed"


def test_icons_show_the_thumbnail(library):
    path = shipped_avatar_path().resolve()
    metadata = library.metadata(path)
    for _ in range(2):  # created once; without a window it has no number
        library.icon(metadata)
    (preview,) = library._icons.values()
    pixels = np.array(preview.image_pixels_float[:], np.float32).reshape(*tuple(preview.image_size)[::-1], 4)
    straight = metadata.thumbnail / 255
    expected = np.concatenate([straight[..., :3] * straight[..., 3:], straight[..., 3:]], -1)
    np.testing.assert_allclose(pixels[::-1], expected, atol=1 / 255)


def test_an_avatar_without_thumbnail_has_no_icon(library, tmp_path):
    save_avatar(replace(load_avatar(), thumbnail=None), tmp_path / "plain.safetensors")
    assert library.icon(library.metadata(tmp_path / "plain.safetensors")) == 0


def test_choosing_a_shipped_avatar_sets_the_skin(right_hand):
    right_hand.livehand.avatar_path = "/somewhere/else.safetensors"
    assert bpy.ops.livehand.wear_avatar(filepath=str(shipped_avatar_path("deep"))) == {"FINISHED"}
    assert (right_hand.livehand.skin, right_hand.livehand.avatar_path) == ("deep", "")


def test_choosing_another_file_sets_its_path(right_hand, my_folder):
    path = my_folder / "mine.safetensors"
    bpy.ops.livehand.wear_avatar(filepath=str(path))
    assert hand_source(right_hand).avatar_path == path


@pytest.mark.parametrize(
    ("name", "message"), [("other", "must be of the hand's own model"), ("broken", "must be a LiveHand avatar")]
)
def test_unsuitable_avatars_are_refused_and_nothing_changes(right_hand, my_folder, name, message):
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.livehand.wear_avatar(filepath=str(my_folder / f"{name}.safetensors"))
    assert (right_hand.livehand.skin, right_hand.livehand.avatar_path) == ("light", "")


def test_people_are_called_the_same_everywhere(right_hand):
    items = right_hand.livehand.bl_rna.properties["skin"].enum_items
    assert {item.identifier: item.name for item in items} == PERSONS


def test_facts_describe_the_avatar(my_folder):
    metadata = read_metadata(shipped_avatar_path())
    lines = facts(metadata)
    assert lines[:2] == ("Erik", "License: GPL-3.0-or-later")
    assert lines[2:5] == metadata.figures
    unknown = facts(replace(metadata, licence="", figures=(), made_from=""))
    assert unknown == ("Erik", "License: not stated", "not measured (livehand evaluate --record)")


def of_person(avatar, beta):
    capture = {"made_by": "livehand capture", "plan": {"person": {"beta": beta}}}
    return replace(avatar, provenance={**avatar.provenance, "capture": capture}, surface=None)


def test_a_hand_gets_the_shape_of_its_avatars_person(right_hand, tmp_path):
    beta = [0.5, -1.0, 0, 0, 0.25, 0, 0, 0, 0, 2.0]
    save_avatar(of_person(load_avatar(), beta), tmp_path / "person.safetensors")
    right_hand.livehand.avatar_path = str(tmp_path / "person.safetensors")
    assert bpy.ops.livehand.person_shape() == {"FINISHED"}
    np.testing.assert_allclose(right_hand["beta"], beta, atol=1e-6)


def test_an_avatar_that_tells_no_shape_is_named(right_hand, tmp_path):
    save_avatar(of_person(load_avatar(), None), tmp_path / "old.safetensors")
    right_hand.livehand.avatar_path = str(tmp_path / "old.safetensors")
    with pytest.raises(RuntimeError, match="must tell its person's shape, 'light' does not"):
        bpy.ops.livehand.person_shape()
    assert not any(right_hand["beta"])


@pytest.mark.parametrize("beta", [[1.0] * 9, ["wide"] * 10, [float("nan")] * 10])
def test_a_persons_shape_of_another_length_is_refused(tmp_path, beta):
    save_avatar(of_person(load_avatar(), beta), tmp_path / "wrong.safetensors")
    with pytest.raises(LiveHandError, match="missing or wrong"):
        read_metadata(tmp_path / "wrong.safetensors")
