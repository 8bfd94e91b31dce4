"""Files of a few bytes that claim to be huge, deep or endless, and things that are no files."""

import io
import json
import os
import pickle
import struct
import time
import zipfile

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.motion.motion import MOST_FRAMES, HandMotion
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import pickle_scan
from livehand.backend.system.files import inner_path, read_regular
from livehand.backend.system.pickle_scan import scan_pickle
from livehand.backend.system.readers import nesting, opened_picture, parse_json, read_json, read_npz
from PIL import Image

NESTED_TUPLES = b"\x80\x02)" + b"\x85" * 20_000 + b"."
HASHED_TUPLES = b"\x80\x02}(" + b")" + b"\x85" * 20_000 + b"K\x01u."
MEMO_INDEX = b"\x80\x02]r" + struct.pack("<I", 1 << 28) + b"."
DOUBLED = b"\x80\x02]q\x00K\x01a" + b"".join(
    b"]" + b"r" + struct.pack("<I", n + 1) + (b"j" + struct.pack("<I", n)) * 1 + b"a"
    + b"j" + struct.pack("<I", n) + b"a"
    for n in range(60)
) + b"."  # fmt: skip
ITSELF = b"\x80\x02]q\x00h\x00a."
DEEP_LISTS = b"\x80\x02" + b"]" * 5_000 + b"a" * 4_999 + b"."
MANY_OPCODES = b"\x80\x02" + b"N0" * 10_000 + b"N."


def bounded(limit_s=10):
    began = time.monotonic()
    return lambda: time.monotonic() - began < limit_s


@pytest.mark.parametrize("suffix", [".pkl", ".npy"])
@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (NESTED_TUPLES, "nest tuples at most 50"),
        (HASHED_TUPLES, "nest tuples at most 50"),
        (MEMO_INDEX, "memo must be filled in order"),
        (DOUBLED, "nest at most 50 deep|at most 50000000 numbers"),
        (ITSELF, "must not hold themselves"),
        (DEEP_LISTS, "at most 50 deep"),
        (MANY_OPCODES, "at most 5000 opcodes"),
    ],
    ids=["tuples", "hashed", "memo", "doubled", "itself", "lists", "opcodes"],
)
def test_pickles_of_a_few_bytes_are_refused_before_they_are_loaded(tmp_path, monkeypatch, raw, message, suffix):
    if raw == MANY_OPCODES:
        monkeypatch.setattr(pickle_scan, "MOST_OPCODES", 5000)
    if suffix == ".npy":
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "|O", "fortran_order": False, "shape": ()})
        raw = header.getvalue() + raw
    path, in_time = tmp_path / f"a{suffix}", bounded()
    path.write_bytes(raw)
    with pytest.raises(LiveHandError, match=message):
        open_motion_file(path)
    if suffix == ".pkl":
        with pytest.raises(LiveHandError):
            load_hand_model(path)
    assert in_time()


def test_shared_lists_are_converted_once_but_counted_each(tmp_path):
    row = list(range(1000))
    for depth, is_read in ((3, True), (6, False)):
        content = row
        for _ in range(depth):
            content = [content] * 10
        (tmp_path / "a.pkl").write_bytes(pickle.dumps({"x": content}))
        with pytest.raises(LiveHandError, match="known format" if is_read else "at most 50000000 numbers"):
            open_motion_file(tmp_path / "a.pkl")


def test_sound_pickles_pass_the_scan():
    content = {"a": np.arange(6.0), ("k", 1): [(1, 2), ((3,), {4})], "b": np.float32(2), "t": b"x" * 300}
    for protocol in range(6):
        scan_pickle(pickle.dumps(content, protocol=protocol))


def npz_claiming(path, shape, data=b"\0" * 64, **changes):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("theta.npy", header.getvalue() + data)
    raw = bytearray(path.read_bytes())
    for offset_local, offset_central, value in changes.values():
        struct.pack_into("<H", raw, offset_local, value)
        struct.pack_into("<H", raw, raw.rindex(b"PK\x01\x02") + offset_central, value)
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("reader", [open_motion_file, load_hand_model], ids=["motion", "hand"])
def test_archives_that_claim_too_much_are_refused(tmp_path, reader):
    path, in_time = tmp_path / "a.npz", bounded(3)
    with pytest.raises(LiveHandError, match="must be whole"):
        reader(npz_claiming(path, (1 << 20, 1 << 20)))
    with pytest.raises(LiveHandError, match="encrypted"):
        reader(npz_claiming(path, (8,), flags=(6, 8, 1)))
    with pytest.raises(LiveHandError, match=r"readable .npz"):
        reader(npz_claiming(path, (8,), method=(8, 10, 97)))
    assert in_time()


def test_the_unpacked_size_is_bounded_before_anything_is_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("v_template.npy", b"\0" * (4 << 20))
    assert (tmp_path / "bomb.npz").stat().st_size < 10_000
    with pytest.raises(LiveHandError, match=r"at most 1 MiB, got 4 unpacked"):
        read_npz(tmp_path / "bomb.npz", most_bytes=1 << 20)
    with pytest.raises(LiveHandError, match="at most 0 MiB"):
        read_regular(tmp_path / "bomb.npz", 100)


def test_json_of_great_depth_or_with_endless_numbers(tmp_path):
    path = tmp_path / "a.json"
    for text in ("[" * 100_000, "[" * 100_000 + "]" * 100_000, '{"a":' * 5000 + "1" + "}" * 5000):
        path.write_text(text)
        with pytest.raises(LiveHandError, match="at most 60 deep"):
            read_json(path)
        with pytest.raises(LiveHandError, match="at most 60 deep"):
            open_motion_file(path)
    assert nesting(b'["[[[[", {"a\\"[": [1]}]') == 3
    assert parse_json(b'[12, "\\u00e9"]', "x") == [12, "é"]
    for number in ("1" * 5000, "1e400", "Infinity", "-Infinity"):
        path.write_text(f'{{"theta": [[[{number}, 0, 0]]], "poses": [{"[" + ", ".join([number] * 48) + "]"}]}}')
        with pytest.raises(LiveHandError):
            open_motion_file(path)
    with pytest.raises(LiveHandError, match="well-formed JSON"):
        parse_json(b"\xff", "x")


def test_takes_have_a_bounded_number_of_frames(tmp_path):
    path = tmp_path / "a.json"
    with pytest.raises(LiveHandError, match="at most 300000, got 300001"):
        HandMotion(np.broadcast_to(np.zeros((1, 16, 3)), (MOST_FRAMES + 1, 16, 3)), np.zeros(10), np.zeros((1, 3)))
    points = np.random.default_rng(0).normal(size=(2, 21, 3)).tolist()
    for last in (10**9, 10**30):
        path.write_text(json.dumps([{"frame": 0, "points": points[0]}, {"frame": last, "points": points[1]}]))
        with pytest.raises(LiveHandError, match="must lie within 300000"):
            open_motion_file(path)
    np.savez(tmp_path / "slow.npz", theta=np.zeros((100, 16, 3)), fps=1e-9)
    with pytest.raises(LiveHandError, match="fps must be a positive number"):
        open_motion_file(tmp_path / "slow.npz").motion()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("name", ["a.npz", "a.pkl", "a.json", "a.csv", "a.npy", "a.png", "a.safetensors"])
def test_pipes_and_devices_are_refused_without_waiting(tmp_path, name):
    os.mkfifo(tmp_path / name)
    (tmp_path / f"zero_{name}").symlink_to("/dev/zero")
    in_time = bounded(2)
    for path in (tmp_path / name, tmp_path / f"zero_{name}"):
        with pytest.raises(LiveHandError, match="pipe, socket or device"):
            read_regular(path, 1 << 20)
        for reader in (open_motion_file, load_hand_model):
            with pytest.raises(LiveHandError):
                reader(path)
        with pytest.raises(LiveHandError), opened_picture(path):
            pass
    assert in_time()


def test_names_that_are_none(tmp_path):
    for name in ("a\0b.npz", "x" * 300 + ".npz"):
        with pytest.raises(LiveHandError):
            open_motion_file(tmp_path / name)
        with pytest.raises(LiveHandError):
            load_hand_model(tmp_path / name)
        with pytest.raises(LiveHandError), opened_picture(tmp_path / name):
            pass


def test_pictures_of_other_formats_are_refused_whatever_their_name(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(" + str(tmp_path).encode() + b") run\n%%EOF\n")
    with pytest.raises(LiveHandError, match="readable image"), opened_picture(path) as picture:
        picture.load()
    Image.new("L", (4, 4)).save(path, "GIF")
    with pytest.raises(LiveHandError, match="readable image"), opened_picture(path):
        pass
    Image.new("L", (4, 4)).save(path, "PNG")
    raw = bytearray(path.read_bytes())
    struct.pack_into(">II", raw, 16, 60_000, 60_000)
    path.write_bytes(raw)
    with pytest.raises(LiveHandError, match=r"at most 134217728 pixels|readable image"), opened_picture(path):
        pass


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../x", "a/../../x", "C:\\x", "..\\x", "\\\\host\\x", "", "a\0b", 5, None, ["a"]]
)
def test_names_that_lead_out_of_the_folder(tmp_path, name):
    with pytest.raises(LiveHandError):
        inner_path(tmp_path, name)


def test_links_that_lead_out_of_the_folder(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link").symlink_to("/etc")
    assert inner_path(tmp_path / "in", "link/passwd") == tmp_path / "in/link/passwd"
    with pytest.raises(LiveHandError, match="a link that leads out"):
        inner_path(tmp_path / "in", "link/passwd", follows_links=True)
    assert inner_path(tmp_path / "in", "images/a.png", follows_links=True) == tmp_path / "in/images/a.png"
