"""The record of a frame's provenance."""

import hashlib
import json
from importlib import metadata
from pathlib import Path

import numpy as np
from livehand.backend.batch.provenance import HandRecord, frame_record, save_record
from livehand.backend.records.camera import Camera
from livehand.backend.records.shot import HandPose


def test_a_record_has_the_camera_and_every_hand(tmp_path):
    avatar = tmp_path / "mine.safetensors"
    avatar.write_bytes(b"avatar")
    camera = Camera(np.diag([50.0, 50.0, 1.0]), np.eye(4), (4, 3))
    hand = HandRecord(HandPose.rest("left"), "mine", avatar, "ab12")
    save_record(frame_record(Path("wave.blend"), 7, (8, 6), camera, [hand]), tmp_path / "wave_0007.json")
    assert json.loads((tmp_path / "wave_0007.json").read_text()) == {
        "livehand": metadata.version("livehand"),
        "shot": str(Path("wave.blend").resolve()),
        "frame": 7,
        "size_px": [8, 6],
        "camera": {"K": camera.K.tolist(), "cam2world": np.eye(4).tolist(), "size_px": [4, 3]},
        "hands": [
            {
                "side": "left",
                "theta": [[0.0] * 3] * 16,
                "beta": [0.0] * 10,
                "transl": [0.0] * 3,
                "hand_sha256": "ab12",
                "avatar": {"name": "mine", "path": str(avatar), "sha256": hashlib.sha256(b"avatar").hexdigest()},
            }
        ],
    }


def test_the_hash_of_an_avatar_follows_its_file(tmp_path):
    avatar = tmp_path / "mine.safetensors"
    camera = Camera(np.diag([50.0, 50.0, 1.0]), np.eye(4), (4, 3))
    hashes = []
    for content in (b"one", b"another"):
        avatar.write_bytes(content)
        hand = HandRecord(HandPose.rest(), "mine", avatar, "ab12")
        hashes.append(frame_record(Path("w.blend"), 1, (8, 6), camera, [hand])["hands"][0]["avatar"]["sha256"])
    assert hashes == [hashlib.sha256(content).hexdigest() for content in (b"one", b"another")]
