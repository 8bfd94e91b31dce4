"""JSON read entry by entry equals JSON read at once, wherever the chunks end."""

import json

import pytest
from livehand.backend.captures.importers import json_stream
from livehand.backend.captures.importers.json_stream import list_entries, member
from livehand.backend.records.errors import LiveHandError

DOCUMENT = {
    "info": {"images": [1, 2], "deep": [[{}], []]},
    "images": [{"id": 12345, "name": 'a "quoted" \\ näme'}, {"id": -1.5e-7, "list": [True, None]}],
    "skipped": [[1, 2], {"a": "]"}],
    "empty": [],
    "number": 1234567890,
    "annotations": [7, "text", None, 12.5],
}


@pytest.fixture(params=[1, 2, 3, 7, 1000])
def document(request, monkeypatch, tmp_path):
    monkeypatch.setattr(json_stream, "_CHUNK", request.param)
    path = tmp_path / "document.json"
    path.write_text(json.dumps(DOCUMENT, indent=1, ensure_ascii=False), encoding="utf-8")
    return path


def test_entries_come_in_order_with_their_keys(document):
    expected = [(key, entry) for key in ("images", "annotations") for entry in DOCUMENT[key]]
    assert list(list_entries(document, ("annotations", "images"))) == expected
    assert list(list_entries(document, ("empty",))) == []


def test_members_are_whole(document):
    for key, value in DOCUMENT.items():
        assert member(document, key) == value


def test_what_is_not_there_is_named(document):
    with pytest.raises(LiveHandError, match=r"must hold 'gone', got \['info', 'images'"):
        member(document, "gone")
    with pytest.raises(LiveHandError, match=r"got none under \['gone', 'number'\]"):
        list(list_entries(document, ("images", "gone", "number")))


def test_every_cut_is_an_error_of_ours(tmp_path):
    text, path = json.dumps(DOCUMENT), tmp_path / "cut.json"
    for length in range(len(text)):
        path.write_text(text[:length])
        with pytest.raises(LiveHandError, match="well-formed JSON"):
            list(list_entries(path, ("annotations",)))


@pytest.mark.parametrize("text", ['{"a" 1}', "{1: 2}", '{"a": [1 2]}', "[]", '{"a": [1], "b": nope}'])
def test_what_is_no_json_is_an_error_of_ours(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(LiveHandError, match=r"other\.json must be whole, well-formed JSON"):
        list(list_entries(path, ("a",)))
