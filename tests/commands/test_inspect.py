"""`livehand inspect`, by kind of file."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.capture.capture import Capture, CaptureView, save_capture_index
from livehand.backend.commands.inspect import inspect
from livehand.backend.field.field import FieldConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.skin_version import SKIN_VERSION, skin_version
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from livehand.tools.builtin_hand import TEMPLATE


def test_a_hand_model():
    facts = inspect(TEMPLATE)
    assert (facts["kind"], facts["side"], facts["vertices"]) == ("hand model", "right", 1272)
    assert len(facts["sha256"]) == 64
    assert 150 < max(facts["extent_mm"]) < 260


def test_an_avatar(tmp_path):
    config = AvatarConfig(FieldConfig(width=4, planes=((8, 1, 1),), relief=8), SuperResConfig(width=4, depth=1))
    save_avatar(new_avatar("ada", "hand", "ab" * 32, config), tmp_path / "ada.safetensors")
    facts = inspect(tmp_path / "ada.safetensors")
    assert (facts["kind"], facts["name"], facts["hand_sha256"]) == ("avatar", "ada", "ab" * 32)
    assert facts["config"]["field"]["width"] == 4


def test_a_capture(tmp_path):
    camera = Camera(np.array([[50.0, 0, 8], [0, 50, 8], [0, 0, 1]]), np.eye(4), (16, 12))
    views = tuple(
        CaptureView(f"{k}.png", camera, k, 0, split) for k, split in enumerate(("train", "train", "novel_camera"))
    )
    save_capture_index(Capture(tmp_path, "cd" * 32, {"made_by": "test"}, (HandPose.rest(),), views))
    facts = inspect(tmp_path)
    assert facts["kind"] == "capture"
    assert (facts["poses"], facts["cameras"], facts["images"]) == (1, 3, 3)
    assert facts["splits"] == {"train": 2, "novel_camera": 1}
    assert facts["sizes_px"] == {"16x12": 3}


@pytest.mark.parametrize("known", [{}, {SKIN_VERSION: skin_version()}, {SKIN_VERSION: "000000000000"}])
def test_whether_a_skin_is_that_of_this_version(tmp_path, known):
    camera = Camera(np.array([[50.0, 0, 8], [0, 50, 8], [0, 0, 1]]), np.eye(4), (16, 12))
    views = (CaptureView("0.png", camera, 0, 0, "train"),)
    save_capture_index(Capture(tmp_path, "cd" * 32, known, (HandPose.rest(),), views))
    config = AvatarConfig(FieldConfig(width=4, planes=((8, 1, 1),), relief=8), SuperResConfig(width=4, depth=1))
    avatar = replace(new_avatar("ada", "hand", "ab" * 32, config), provenance={"capture": known})
    save_avatar(avatar, tmp_path / "ada.safetensors")
    reported = [inspect(path).get("skin_is_current") for path in (tmp_path, tmp_path / "ada.safetensors")]
    assert reported == 2 * [known[SKIN_VERSION] == skin_version() if known else None]


def test_poses(tmp_path):
    theta = np.zeros((5, 16, 3))
    theta[2, 3] = [0, np.pi / 2, 0]
    np.savez(tmp_path / "wave.npz", theta=theta, fps=24.0)
    facts = inspect(tmp_path / "wave.npz")
    assert (facts["kind"], facts["frames"], facts["is_finite"]) == ("poses", 5, True)
    assert facts["largest_angle_deg"] == 90.0
    assert facts["arrays"] == {"theta": [5, 16, 3], "fps": []}
    theta[0, 0, 0] = np.nan
    np.savez(tmp_path / "bad.npz", theta=theta)
    with pytest.raises(LiveHandError, match=r"bad\.npz must hold finite angles"):
        inspect(tmp_path / "bad.npz")
    for theta in (np.zeros((0, 16, 3)), np.float64(3), np.array(["a"])):
        np.savez(tmp_path / "bad.npz", theta=theta)
        with pytest.raises(LiveHandError, match=r"bad\.npz"):
            inspect(tmp_path / "bad.npz")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    np.savez(tmp_path / "other.npz", x=1)
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04nothing")
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "broken.safetensors").write_bytes(b"nothing")
    (tmp_path / "folder").mkdir()
    for name in ("gone", "notes.txt", "other.npz", "broken.npz", "empty.npz", "broken.safetensors", "folder"):
        with pytest.raises(LiveHandError, match=name):
            inspect(tmp_path / name)


def test_the_command_prints_facts_or_json(capsys):
    path = str(TEMPLATE)
    assert run_commands("livehand", "", COMMANDS, ["inspect", path]) == 0
    assert "vertices        1272" in capsys.readouterr().out
    assert run_commands("livehand", "", COMMANDS, ["inspect", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["vertices"] == 1272
    assert run_commands("livehand", "", COMMANDS, ["inspect", "nowhere"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("livehand inspect: nothing to inspect at nowhere")


@pytest.mark.slow
def test_pose_files_of_other_formats(tmp_path):
    (tmp_path / "take.json").write_text(json.dumps(np.zeros((2, 48)).tolist()))
    facts = inspect(tmp_path / "take.json")
    assert (facts["kind"], facts["format"], facts["frames"], facts["mean"]) == (
        "motion",
        "Raw MANO",
        "2",
        "in the angles",
    )
    meta = {"handPose": np.zeros(48), "handTrans": np.zeros(3), "handBeta": np.zeros(10)}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "0000.pkl").write_bytes(pickle.dumps(meta))
    assert inspect(tmp_path / "meta" / "0000.pkl")["format"] == "HO-3D"
    assert inspect(tmp_path / "meta")["axes"] == "camera, y up, z back"
    np.savez(tmp_path / "labels.npz", pose_m=np.ones((1, 51)))
    assert inspect(tmp_path / "labels.npz")["format"] == "DexYCB"
