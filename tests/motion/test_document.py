"""Pose files that are damaged, mean harm, or are something else."""

import os
import pickle

import numpy as np
import pytest
from livehand.backend.motion.document import load_document
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.records.errors import LiveHandError


class Harm:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def refused(path, message):
    with pytest.raises(LiveHandError, match=rf"(?s){path.name}.*{message}"):
        open_motion_file(path)


@pytest.mark.parametrize("name", ["bad.pkl", "bad.npy", "bad.npz"])
def test_pickles_that_would_run_code_are_refused_before_they_run(tmp_path, name):
    path, made = tmp_path / name, tmp_path / "made"
    if name == "bad.npz":
        np.savez(path, poses=np.array([Harm(made)], object))
        refused(path, "must be of a known format")
        np.savez(path, rhand=np.array(Harm(made), object))
        refused(path, r"rhand.*may not use (posix|nt)\.mkdir")
    elif name == "bad.npy":
        np.save(path, {"poses": Harm(made)}, allow_pickle=True)
        refused(path, r"may not use (posix|nt)\.mkdir")
    else:
        path.write_bytes(pickle.dumps({"handPose": Harm(made)}))
        refused(path, r"may not use (posix|nt)\.mkdir")
    assert not made.exists()


def test_arrays_of_objects_in_pickles_are_refused(tmp_path):
    path = tmp_path / "bad.pkl"
    path.write_bytes(pickle.dumps({"handPose": np.array([1, "x"], object)}))
    refused(path, "array of objects")
    path.write_bytes(pickle.dumps({"handPose": {1, 2}}))
    refused(path, "plain data")


@pytest.mark.parametrize("name", ["a.npz", "a.npy", "a.pkl"])
def test_files_cut_short_anywhere_are_refused(tmp_path, name):
    path = tmp_path / name
    if name == "a.npz":
        np.savez_compressed(path, poses=np.random.default_rng(0).normal(size=(9, 48)))
    elif name == "a.npy":
        np.save(path, {"right": {"rot": np.ones((2, 3))}}, allow_pickle=True)
    else:
        path.write_bytes(pickle.dumps({"handPose": np.ones(48)}))
    whole = path.read_bytes()
    for length in {0, 1, 7, 60, len(whole) // 2, len(whole) - 1}:
        path.write_bytes(whole[:length])
        refused(path, "")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "[[1, 2", "well-formed JSON"),
        ("a.json", "[[1, 2], [3]]", "known format"),
        ("a.json", '{"x": 1}', r"known format .*got keys x; "),
        ("a.json", "[]", "known format"),
        ("a.json", "\xff\xfe", "known format|well-formed"),
        ("a.csv", "x0,y0\n1\n", "as many cells"),
        ("a.csv", "", "known format"),
        ("a.txt", "hello", r"must be a pose file .* got '.txt'"),
    ],
)
def test_text_without_poses_is_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text, encoding="latin1")
    refused(tmp_path / name, message)


def test_malformed_numbers_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    poses = np.zeros((3, 48))
    poses[1, 7] = np.nan
    np.savez(path, poses=poses)
    refused(path, "poses must be finite")
    np.savez(path, poses=np.full((3, 48), "a"))
    refused(path, "must hold numbers")
    np.savez(path, theta=np.zeros((3, 15, 3)))
    refused(path, r"theta must be \['N', 16, 3\], got \[3, 15, 3\]")
    np.savez(path, theta=np.zeros((3, 16, 3)), side="middle")
    refused(path, "side must be")
    np.savez(path, theta=np.zeros((3, 16, 3)), fps=-5)
    with pytest.raises(LiveHandError, match="fps must be a positive"):
        open_motion_file(path).motion()
    np.savez(path, theta=np.zeros((0, 16, 3)))
    refused(path, "at least one frame")


def test_a_missing_file_and_an_empty_folder(tmp_path):
    refused(tmp_path / "gone.npz", "give the path")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "must hold pose files")


def test_pickles_are_read_unchanged(tmp_path):
    content = {
        "f": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "scalar": np.float32(2.5),
        "int": 3,
        "list": [np.arange(3, dtype=">i2"), None, "text"],
    }
    for protocol in range(6):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, protocol=protocol))
        entries = load_document(tmp_path / "a.pkl").entries
        np.testing.assert_array_equal(entries["f"], content["f"])
        assert entries["scalar"] == 2.5
        assert entries["int"] == 3
        np.testing.assert_array_equal(entries["list"][0], [0, 1, 2])
        assert entries["list"][1:] == [None, "text"]


def test_a_body_without_its_own_rotation_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", body_pose=np.zeros((4, 63)), left_hand_pose=np.zeros((4, 45)))
    refused(tmp_path / "a.npz", "must hold global_orient")
