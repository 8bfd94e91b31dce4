"""The record beside a frame equals what was rendered."""

import hashlib
import json
import shutil
from importlib import metadata

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.model_file import builtin_hand_path, load_default_hand
from livehand.livehand_blender.render.plan import SequencePlan
from livehand.livehand_blender.render.sequence import write_sequence
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.sliders import write_slider


@pytest.fixture
def shot_path(hand_scene, tmp_path):
    (armature,) = (thing for thing in hand_scene.objects if thing.type == "ARMATURE")
    write_slider(armature, "beta", np.linspace(-1, 1, 10))
    for frame in (1, 3):
        armature.pose.bones["index1.R"].rotation_quaternion = (1, 0.1 * frame, 0, 0)
        armature.pose.bones["index1.R"].keyframe_insert("rotation_quaternion", frame=frame)
    path = tmp_path / "wave.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def records(shot_path, folder, **choices):
    write_sequence(SequencePlan(shot_path, folder, **choices), lambda event: None)
    return [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]


def test_the_record_holds_what_the_renderer_got(shot_path, tmp_path, fake_session):
    avatar = tmp_path / "mine.safetensors"
    shutil.copy(shipped_avatar_path("lena"), avatar)
    found = records(shot_path, tmp_path / "out", frames=(1, 3), avatar=avatar)
    (renderer,) = fake_session.made
    assert [record["frame"] for record in found] == [1, 3]
    assert found[0]["hands"][0]["theta"] != found[1]["hands"][0]["theta"]
    for record, shot in zip(found, renderer.shots, strict=True):
        assert set(record) == {"livehand", "shot", "frame", "size_px", "camera", "hands", "formats", "version"}
        assert record["livehand"] == metadata.version("livehand")
        assert (record["shot"], record["size_px"]) == (str(shot_path), [48, 64])
        assert record["formats"] == ["exr"]
        assert record["version"] == {
            "livehand": metadata.version("livehand"),
            "blender": bpy.app.version_string,
            "shot": hashlib.sha256(shot_path.read_bytes()).hexdigest(),
            "linked": {},
            "avatars": [hashlib.sha256(avatar.read_bytes()).hexdigest()],
            "hand_models": [hashlib.sha256(builtin_hand_path().read_bytes()).hexdigest()],
            "size_px": [48, 64],
            "settings": {"device": "auto", "precision": "fp32"},
        }
        assert record["camera"] == {
            "K": shot.camera.K.tolist(),
            "cam2world": shot.camera.cam2world.tolist(),
            "size_px": [48, 64],
            "projection": "perspective",
        }
        assert record["hands"] == [
            {
                "side": "right",
                "theta": shot.pose.theta.tolist(),
                "beta": shot.pose.beta.tolist(),
                "transl": shot.pose.transl.tolist(),
                "hand_sha256": load_default_hand().sha256,
                "avatar": {
                    "name": "fake",
                    "path": str(avatar),
                    "sha256": hashlib.sha256(avatar.read_bytes()).hexdigest(),
                    "licence": "CC0",
                    "consent": "to all",
                },
            }
        ]


def test_a_frame_without_a_hand_has_no_hands_in_its_record(hand_scene, shot_path, tmp_path, fake_session):
    hand_scene.view_layers.new("Second")
    for layer in hand_scene.view_layers:
        layer.layer_collection.exclude = True
    for thing in hand_scene.objects:
        if thing.type == "MESH":
            thing.hide_render = True
    bpy.ops.wm.save_mainfile()
    (record,) = records(shot_path, tmp_path / "out", frames=(1,))
    assert record["camera"]["size_px"] == [48, 64]
    assert record["hands"] == []


def test_finished_frames_need_no_record(shot_path, tmp_path, fake_session):
    records(shot_path, tmp_path / "out", frames=(1,))
    (tmp_path / "out" / "wave_0001.json").unlink()
    assert records(shot_path, tmp_path / "out", frames=(1,)) == []


def test_every_hand_is_recorded_once_even_in_a_blurred_frame_of_two_layers(
    hand_scene, shot_path, tmp_path, fake_session
):
    add_hand(bpy.context, load_default_hand().for_side("left"), name="Left")
    hand_scene.view_layers.new("Second")
    hand_scene.render.use_motion_blur, hand_scene.livehand.blur_samples = True, 2
    bpy.ops.wm.save_mainfile()
    (record,) = records(shot_path, tmp_path / "out", frames=(1,))
    assert [hand["side"] for hand in record["hands"]] == ["left", "right"]
