"""Digests of files, large ones and missing ones among them."""

import hashlib
import os

from livehand.backend.batch import digests
from livehand.backend.batch.digests import file_digest, files_digest


def test_a_files_digest_is_its_sha256_and_follows_it(tmp_path):
    path = tmp_path / "a"
    for content in (b"one", b"another"):
        path.write_bytes(content)
        assert file_digest(path) == hashlib.sha256(content).hexdigest()
    path.unlink()
    assert file_digest(path) is file_digest(tmp_path) is file_digest(tmp_path / "no\0name") is None


def test_of_a_large_file_pieces_from_its_start_to_its_end_count(tmp_path, monkeypatch):
    monkeypatch.setattr(digests, "_WHOLE_BYTES", 1000)
    monkeypatch.setattr(digests, "_PIECE_BYTES", 10)
    path, found = tmp_path / "film", set()
    for place in (0, 1035, 2035, 2039):
        content = bytearray(2040)
        content[place] = 1
        path.write_bytes(content)
        os.utime(path, ns=(place, place))
        found.add(file_digest(path))
    path.write_bytes(bytes(2041))
    found.add(file_digest(path))
    assert len(found) == 5
    assert all(digest.startswith("pieces-") for digest in found)


def test_a_sequence_is_known_by_its_names_and_sizes(tmp_path):
    for name in ("a_1.png", "a_2.png"):
        (tmp_path / name).write_bytes(b"1")
    before = files_digest(tmp_path.iterdir())
    assert before == files_digest(reversed(list(tmp_path.iterdir())))
    (tmp_path / "a_2.png").write_bytes(b"12")
    assert files_digest(tmp_path.iterdir()) not in (before, None)
    assert files_digest([tmp_path / "none"]) is None
