"""The records of a frame's files: those of files that stay are kept."""

import json

import pytest
from livehand.backend.batch.frame_records import joined_records, kept_records, read_records, record_of

ONE = {"hands": ["a"], "formats": ["exr"]}
OTHER = {"hands": ["b"], "formats": ["png"]}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "wave_0001.json"


def save(path, record):
    path.write_text(json.dumps(record))


def test_a_file_that_is_added_has_a_record_of_its_own(path):
    save(path, joined_records([ONE], OTHER))
    assert json.loads(path.read_text()) == {**ONE, "added": [OTHER]}
    records = read_records(path, ("exr", "png"))
    assert (record_of(records, "exr"), record_of(records, "png"), record_of(records, "gif")) == (ONE, OTHER, None)


def test_files_that_were_made_in_the_same_way_share_a_record():
    assert joined_records([ONE], {**ONE, "formats": ["png"]}) == {**ONE, "formats": ["exr", "png"]}


def test_the_record_of_a_file_that_is_replaced_goes(path):
    save(path, joined_records([{**ONE, "formats": ["exr", "png"]}], OTHER))
    kept = kept_records(read_records(path, ()), ["exr"])
    assert kept == [ONE]
    assert kept_records(kept, ["png"]) == []
    assert joined_records([], OTHER) == OTHER


def test_a_record_of_an_early_version_describes_all_files_that_there_are(path):
    save(path, {"hands": ["a"]})
    assert read_records(path, ("exr",)) == [ONE]


@pytest.mark.parametrize("text", ["", "5", "[]", '{"added": 5', '"formats"'])
def test_a_file_that_holds_no_record_describes_nothing(path, text):
    path.write_text(text)
    assert read_records(path, ("exr",)) == []


def test_odd_parts_of_a_record_are_left_out(path):
    save(path, {"formats": [3], "added": [5, {"formats": "png"}]})
    assert [one["formats"] for one in read_records(path, ("exr",))] == [["exr"], ["exr"]]
    save(path, {"formats": ["exr"], "added": 5})
    assert read_records(path, ()) == [{"formats": ["exr"]}]
