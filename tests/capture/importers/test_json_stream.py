"""JSON read entry by entry equals JSON read at once, whatever the size of the buffer."""

import json
import sys
import tracemalloc

import pytest
from livehand.backend.capture.importers.json_stream import list_entries, member, member_names
from livehand.backend.records.errors import LiveHandError

DOCUMENT = {
    "info": {"images": [1, 2], "deep": [[{}], []]},
    "images": [{"id": 12345, "name": 'a "quoted" \\ näme'}, {"id": -1.5e-7, "list": [True, None]}],
    "skipped": [[1, 2], {"a": "]"}],
    "empty": [],
    "number": 1234567890,
    "annotations": [7, "text", None, 12.5],
}


@pytest.fixture
def document(tmp_path):
    path = tmp_path / "document.json"
    path.write_text(json.dumps(DOCUMENT, indent=1, ensure_ascii=False), encoding="utf-8")
    return path


@pytest.fixture(params=[1, 2, 3, 7, 1000])
def buffer_bytes(request):
    return request.param


def test_entries_come_in_order_with_their_keys(document, buffer_bytes):
    expected = [(key, entry) for key in ("images", "annotations") for entry in DOCUMENT[key]]
    assert list(list_entries(document, ("annotations", "images"), buffer_bytes)) == expected
    assert list(list_entries(document, ("empty",), buffer_bytes)) == []


def test_members_are_whole(document, buffer_bytes):
    for key, value in DOCUMENT.items():
        assert member(document, key, buffer_bytes) == value


def test_member_names_come_in_the_order_of_the_file(document):
    assert list(member_names(document)) == list(DOCUMENT)


def test_missing_keys_are_named(document):
    with pytest.raises(LiveHandError, match=r"must hold 'gone', got \['info', 'images'"):
        member(document, "gone")
    with pytest.raises(LiveHandError, match=r"got none under \['gone', 'number'\]"):
        list(list_entries(document, ("images", "gone", "number")))


def test_a_missing_file_is_an_error_of_ours(tmp_path):
    with pytest.raises(LiveHandError, match="must be a readable JSON file"):
        member(tmp_path / "gone.json", "a")


@pytest.mark.slow
def test_a_file_cut_anywhere_is_an_error_of_ours(tmp_path):
    text, path = json.dumps(DOCUMENT), tmp_path / "cut.json"
    for length in range(len(text)):
        path.write_text(text[:length])
        with pytest.raises(LiveHandError, match="well-formed JSON"):
            list(list_entries(path, ("annotations",)))


@pytest.mark.parametrize(
    "text", ['{"a" 1}', "{1: 2}", '{"a": [1 2]}', "[]", '{"a": [1], "b": nope}', '{"a": NaN}', '{"a":' + "[" * 9999]
)
def test_malformed_json_is_an_error_of_ours(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(LiveHandError, match=r"other\.json must be whole, well-formed JSON"):
        list(list_entries(path, ("a",)))


@pytest.mark.slow
def test_a_large_file_is_never_in_memory_as_a_whole(tmp_path):
    path = tmp_path / "large.json"
    path.write_text(json.dumps({"a": [{"id": k, "text": "x" * 100} for k in range(20_000)]}))
    tracemalloc.start()
    try:
        assert sum(1 for _ in list_entries(path, ("a",))) == 20_000
        assert tracemalloc.get_traced_memory()[1] < path.stat().st_size / 4
    finally:
        tracemalloc.stop()


def test_a_missing_package_is_named(document, monkeypatch):
    monkeypatch.setitem(sys.modules, "ijson", None)
    with pytest.raises(LiveHandError, match="large JSON files need ijson"):
        member(document, "info")
