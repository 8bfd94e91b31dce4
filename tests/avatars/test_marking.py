"""Marked avatars: their bits are in the header and in the map of albedo, and frames are marked with them."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.marking import mark_in_albedo, marked_avatar
from livehand.backend.avatars.metadata import read_metadata, watermark_of
from livehand.backend.avatars.origin import frame_payload, read_origin
from livehand.backend.capture.person import PERSONS
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.base_surface import surface_of_person

PAYLOAD = b"livehand"


@pytest.fixture
def avatar(hand):
    field = FieldConfig(width=4, planes=((8, 2, 2),), relief=8)
    config = AvatarConfig(field, SuperResConfig(width=4, depth=1), SamplerConfig())
    return replace(new_avatar("tiny", hand.name, hand.sha256, config), provenance={"licence": "CC0"})


def test_a_marked_avatar_keeps_its_bits_whatever_changes(avatar, tmp_path):
    path = tmp_path / "a.safetensors"
    save_avatar(avatar, path)
    before = read_origin(path)
    assert not before.is_marked
    marked = marked_avatar(avatar, before.payload)
    save_avatar(marked, path)
    after = read_origin(path)
    assert (after.payload, after.is_marked) == (before.payload, True)
    assert read_metadata(path).watermark == before.payload
    save_avatar(replace(load_avatar(path), name="another", provenance=marked.provenance | {"licence": "none"}), path)
    assert read_origin(path).payload == before.payload


def test_frames_are_marked_by_who_asks_for_it(avatar, tmp_path):
    paths = [tmp_path / "plain.safetensors", tmp_path / "marked.safetensors"]
    save_avatar(avatar, paths[0])
    save_avatar(marked_avatar(avatar, PAYLOAD), paths[1])
    plain, marked = map(read_origin, paths)
    assert frame_payload([plain], False) is None
    assert frame_payload([plain], True) == plain.payload
    assert frame_payload([marked], False) == PAYLOAD
    assert frame_payload([plain, marked], False) == PAYLOAD
    assert frame_payload([plain, marked], True) not in (None, PAYLOAD, plain.payload)
    assert frame_payload([], True) is None


def test_the_mark_is_in_the_surface_too_and_outlives_the_header(avatar, hand, tmp_path):
    """A surface without a map gets one that changes nothing but by the mark."""
    surface = surface_of_person(PERSONS["middle"], hand.sha256)
    assert mark_in_albedo(surface.arrays) is None
    marked = marked_avatar(replace(avatar, surface=surface), PAYLOAD)
    assert abs(marked.surface.arrays["albedo/ratio"].astype(int)).max() == 1
    save_avatar(replace(marked, provenance={}), tmp_path / "a.safetensors")
    assert not read_origin(tmp_path / "a.safetensors").is_marked
    reading = mark_in_albedo(load_avatar(tmp_path / "a.safetensors").surface.arrays)
    assert (reading.payload, reading.is_sure) == (PAYLOAD, True)


def test_an_avatar_is_marked_once(avatar):
    with pytest.raises(LiveHandError, match="not be marked yet, got the bits " + PAYLOAD.hex()):
        marked_avatar(marked_avatar(avatar, PAYLOAD), b"somebody")


@pytest.mark.parametrize("wrong", ["zz", "00", 7, np.nan, []])
def test_bits_must_be_eight_bytes(wrong):
    with pytest.raises(LiveHandError, match="16 hexadecimal digits"):
        watermark_of({"watermark": wrong})
