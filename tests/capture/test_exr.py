"""OpenEXR files: there and back to the last bit, and every fault named with its file."""

import struct

import numpy as np
import pytest
from livehand.backend.capture.exr import read_exr, read_exr_header, write_exr
from livehand.backend.records.errors import LiveHandError


def channels_of(height, width, dtype=np.float16):
    rng = np.random.default_rng(0)
    smooth = np.cumsum(rng.normal(0, 0.1, (height, width)), 1).astype(dtype)
    return {"R": smooth, "G": rng.normal(size=(height, width)).astype(dtype), "B": smooth * 2}


@pytest.mark.parametrize("size", [(1, 1), (15, 7), (16, 8), (37, 21)])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_pictures_come_back_to_the_last_bit(tmp_path, size, dtype):
    written = channels_of(*size, dtype) | {"A": np.ones(size, np.float32)}
    path = tmp_path / "folder" / "image.exr"
    write_exr(path, written)
    back = read_exr(path)
    assert set(back) == set(written)
    for name, channel in written.items():
        assert back[name].dtype == channel.dtype
        np.testing.assert_array_equal(back[name], channel)
    assert read_exr_header(path) == (("A", "B", "G", "R"), size[::-1])
    assert [file.name for file in path.parent.iterdir()] == ["image.exr"]


def test_extremes_come_back(tmp_path):
    values = np.array([[0.0, -0.0, 65504.0, 6e-8, np.inf, -1.5]], np.float16)
    write_exr(tmp_path / "a.exr", {"Y": values})
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr")["Y"].view(np.uint16), values.view(np.uint16))


def test_an_empty_ground_takes_little_room(tmp_path):
    write_exr(tmp_path / "a.exr", dict.fromkeys("RGBA", np.zeros((512, 334), np.float16)))
    assert (tmp_path / "a.exr").stat().st_size < 20_000


def moved(data, name, box):
    """The file with another window; an attribute is its name, type, size and value."""
    start = data.index(name + b"\0box2i\0") + len(name) + 7 + 4
    return data[:start] + struct.pack("<4i", *box) + data[start + 16 :]


def test_data_may_cover_a_part_of_the_picture_or_more(tmp_path):
    channels = {"Y": np.arange(12, dtype=np.float32).reshape(3, 4)}
    path = tmp_path / "a.exr"
    write_exr(path, channels)
    path.write_bytes(moved(path.read_bytes(), b"displayWindow", (-1, -2, 5, 4)))
    whole = np.zeros((7, 7), np.float32)
    whole[2:5, 1:5] = channels["Y"]
    np.testing.assert_array_equal(read_exr(path)["Y"], whole)
    path.write_bytes(moved(path.read_bytes(), b"displayWindow", (1, 1, 2, 7)))
    np.testing.assert_array_equal(read_exr(path)["Y"][:2], channels["Y"][1:, 1:3])
    assert not read_exr(path)["Y"][2:].any()


@pytest.mark.parametrize("share", [0, 0.01, 0.2, 0.5, 0.9, 0.999])
def test_cut_files_are_named(tmp_path, share):
    path = tmp_path / "cut.exr"
    write_exr(path, channels_of(40, 30))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(LiveHandError, match=r"cut\.exr must be"):
        read_exr(path)


def test_a_block_that_is_listed_twice_leaves_lines_missing(tmp_path):
    path = tmp_path / "twice.exr"
    write_exr(path, channels_of(40, 30))
    data = path.read_bytes()
    table = data.index(b"screenWindowWidth") + len(b"screenWindowWidth\0float\0") + 4 + 4 + 1
    first = data[table : table + 8]
    assert struct.unpack("<Q", first) == (table + 3 * 8,)
    path.write_bytes(data[: table + 8] + first + data[table + 16 :])
    with pytest.raises(LiveHandError, match=r"twice\.exr must be a whole OpenEXR file \(16 of 40 lines are missing\)"):
        read_exr(path)


@pytest.mark.slow
def test_damaged_files_are_errors_of_ours(tmp_path):
    path, rng = tmp_path / "damaged.exr", np.random.default_rng(0)
    write_exr(path, channels_of(20, 20))
    data = path.read_bytes()
    for _ in range(200):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), 3):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read_exr(path)
        except LiveHandError:
            pass


COMPRESSION, CHANNEL = b"compression\0compression\0\1\0\0\0", b"G\0" + struct.pack("<iIii", 1, 0, 1, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: b"\x89PNG" + d[4:], "its first bytes are not OpenEXR's"),
        (lambda d: d[:5] + b"\x02" + d[6:], "it has tiles, several parts or deep pixels"),
        (lambda d: d.replace(COMPRESSION + b"\3", COMPRESSION + b"\4"), "is PIZ; save"),
        (lambda d: d.replace(CHANNEL, b"G\0" + struct.pack("<iIii", 1, 0, 2, 1)), "subsampled"),
        (lambda d: d.replace(CHANNEL, b"G\0" + struct.pack("<iIii", 0, 0, 1, 1)), "whole numbers"),
        (lambda d: moved(d, b"dataWindow", (0, 0, 2**30, 2**30)), "a window of"),
    ],
)
def test_other_kinds_are_named(tmp_path, change, message):
    path = tmp_path / "other.exr"
    write_exr(path, channels_of(20, 20))
    path.write_bytes(change(path.read_bytes()))
    for read in (read_exr, read_exr_header):
        with pytest.raises(LiveHandError, match=rf"other\.exr must be an OpenEXR image that .* read here .*{message}"):
            read(path)


def test_missing_files_and_full_places_are_named(tmp_path):
    with pytest.raises(LiveHandError, match=r"nowhere\.exr must be a readable image"):
        read_exr(tmp_path / "nowhere.exr")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(LiveHandError, match="must be writable"):
        write_exr(tmp_path / "file" / "a.exr", channels_of(2, 2))


def test_text_stands_in_the_header_and_changes_no_pixel(tmp_path):
    path, written = tmp_path / "image.exr", channels_of(5, 7)
    write_exr(path, written, {"LiveHand/Consent": "Zoë, this film"})
    entry = "Zoë, this film".encode()
    assert b"LiveHand/Consent\0string\0" + struct.pack("<i", len(entry)) + entry in path.read_bytes()
    np.testing.assert_array_equal(read_exr(path)["R"], written["R"])
