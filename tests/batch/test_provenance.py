"""The record of a frame's provenance."""

import hashlib
import json
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.batch.provenance import HandRecord, frame_record, save_record
from livehand.backend.batch.shot_version import ShotVersion
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose

VERSION = ShotVersion("1", "4.5", "5407", {}, frozenset(), frozenset(), (8, 6), {})


def test_a_record_has_the_camera_and_every_hand(tmp_path):
    avatar = tmp_path / "mine.safetensors"
    avatar.write_bytes(b"avatar")
    camera = Camera(np.diag([50.0, 50.0, 1.0]), np.eye(4), (4, 3))
    hand = HandRecord(HandPose.rest("left"), "mine", avatar, "ab12", "CC0", "to all")
    version = replace(VERSION, avatars=frozenset([hashlib.sha256(b"avatar").hexdigest()]))
    record = frame_record(Path("wave.blend"), 7, (8, 6), camera, [hand], ("exr", "png"), version)
    save_record(record, tmp_path / "wave_0007.json")
    assert json.loads((tmp_path / "wave_0007.json").read_text()) == {
        "livehand": metadata.version("livehand"),
        "shot": str(Path("wave.blend").resolve()),
        "frame": 7,
        "size_px": [8, 6],
        "camera": {
            "K": camera.K.tolist(),
            "cam2world": np.eye(4).tolist(),
            "size_px": [4, 3],
            "projection": "perspective",
        },
        "hands": [
            {
                "side": "left",
                "theta": [[0.0] * 3] * 16,
                "beta": [0.0] * 10,
                "transl": [0.0] * 3,
                "hand_sha256": "ab12",
                "avatar": {
                    "name": "mine",
                    "path": str(avatar),
                    "sha256": hashlib.sha256(b"avatar").hexdigest(),
                    "licence": "CC0",
                    "consent": "to all",
                },
            }
        ],
        "formats": ["exr", "png"],
        "version": version.to_record(),
    }


def test_the_hash_of_an_avatar_follows_its_file(tmp_path):
    avatar = tmp_path / "mine.safetensors"
    camera = Camera(np.diag([50.0, 50.0, 1.0]), np.eye(4), (4, 3))
    hashes = []
    for content in (b"one", b"another"):
        avatar.write_bytes(content)
        hand = HandRecord(HandPose.rest(), "mine", avatar, "ab12")
        version = replace(VERSION, avatars=frozenset([hashlib.sha256(content).hexdigest()]))
        record = frame_record(Path("w.blend"), 1, (8, 6), camera, [hand], ("exr",), version)
        hashes.append(record["hands"][0]["avatar"]["sha256"])
    assert hashes == [hashlib.sha256(content).hexdigest() for content in (b"one", b"another")]


def test_an_avatar_that_changes_while_a_shot_is_rendered_is_an_error(tmp_path):
    avatar = tmp_path / "mine.safetensors"
    avatar.write_bytes(b"another")
    version = replace(VERSION, avatars=frozenset([hashlib.sha256(b"one").hexdigest()]))
    hand = HandRecord(HandPose.rest(), "mine", avatar, "ab12")
    camera = Camera(np.diag([50.0, 50.0, 1.0]), np.eye(4), (4, 3))
    with pytest.raises(LiveHandError, match=r"mine\.safetensors must stay as it is"):
        frame_record(Path("w.blend"), 1, (8, 6), camera, [hand], ("exr",), version)
