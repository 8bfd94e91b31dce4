"""Versions of a shot: what is compared, and what is told of it."""

import json
from dataclasses import replace

import pytest
from livehand.backend.batch.shot_version import ShotVersion, others_message, others_text

VERSION = ShotVersion(
    "1.0",
    "4.5.1",
    "5407",
    {"/a/sky.exr": "51", "/a/gone.png": None},
    frozenset("a"),
    frozenset("h"),
    (8, 6),
    {"d": "cpu"},
)
CHANGES = {
    "livehand": "1.1",
    "blender": "5.0.0",
    "shot": "0000",
    "linked": {"/a/sky.exr": "52", "/a/gone.png": None},
    "avatars": frozenset("ab"),
    "hand_models": frozenset("i"),
    "size_px": (6, 8),
    "settings": {"d": "cuda"},
}


def recorded(version):
    return json.loads(json.dumps({"version": version.to_record()}))


@pytest.mark.parametrize("key", CHANGES)
def test_a_difference_is_seen_in_each_part(key):
    other = replace(VERSION, **{key: CHANGES[key]})
    assert VERSION.differences(recorded(VERSION)) == ()
    assert VERSION.differences(recorded(other)) == (key,)
    assert other.digest() != VERSION.digest()
    assert others_text([key]).startswith("of ")


def test_the_places_of_linked_files_differ_among_machines_and_do_not_count():
    elsewhere = replace(VERSION, linked={"D:/sky.exr": "51", "D:/gone.png": None})
    assert VERSION.differences(recorded(elsewhere)) == ()
    assert VERSION.digest() == elsewhere.digest()


@pytest.mark.parametrize("record", [None, {}, {"version": 5}, {"version": None}])
def test_a_record_that_tells_no_version_is_of_unknown_origin(record):
    assert VERSION.differences(record) == ("unknown",)


def test_a_damaged_version_differs():
    assert set(VERSION.differences({"version": {"linked": [3], "shot": []}})) == CHANGES.keys()


def test_messages_have_counts():
    assert others_message([(), ()]) is None
    assert others_message([("avatars",)] * 12 + [()]) == (
        "12 frames are of another avatar; --overwrite renders them again, another folder keeps both"
    )
    assert others_message([("avatars", "shot"), ("shot",), ("unknown",)]).startswith(
        "3 frames are of another version (2 of another state of the .blend, 1 of another avatar, 1 of unknown origin);"
    )
