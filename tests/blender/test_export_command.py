"""`livehand export` of scenes and onto characters, and its operators."""

import json

import bpy
import numpy as np
import pytest
from livehand.backend.commands.export import BLENDER_SUFFIXES, FORMATS
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.livehand_blender import cli
from livehand.livehand_blender.motion.keying import sample_motion
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta
from livehand.livehand_blender.rigs.blender_writers import ALL_WRITERS, BLENDER_WRITERS


def keyed(model, count=4):
    hand = add_hand(bpy.context, model)
    hand.location = (1, 0, 0)
    rng = np.random.default_rng(0)
    keyframe_theta(RiggedHand.of(hand), rng.normal(size=(count, 16, 3)) * 0.1, range(1, count + 1))
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, count
    bpy.context.view_layer.objects.active = hand
    return hand


def test_the_names_are_those_of_the_writers():
    assert FORMATS == (*(writer.name for writer in ALL_WRITERS), "splats")
    assert set(BLENDER_SUFFIXES) == {suffix for writer in BLENDER_WRITERS for suffix in writer.suffixes}


def test_a_scene_is_exported(model, tmp_path, capsys):
    hand = keyed(model)
    before = sample_motion(bpy.context, RiggedHand.of(hand), range(2, 4))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    words = [str(tmp_path / "shot.blend"), "-o", str(tmp_path / "out.csv"), "--frames", "2-3", "--json"]
    assert cli.main(["export", *words]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["frames"] == 2
    back = open_motion_file(tmp_path / "out.csv").motion()
    np.testing.assert_allclose(back.theta, before.theta, atol=1e-6)
    np.testing.assert_allclose(back.transl, before.transl + np.array([1.0, 0, 0]), atol=1e-6)


def test_a_scene_is_exported_as_fbx_and_read_again(model, tmp_path):
    keyed(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert cli.main(["export", str(tmp_path / "shot.blend"), "-o", str(tmp_path / "out.fbx")]) == 0
    assert cli.main(["export", str(tmp_path / "out.fbx"), "-o", str(tmp_path / "back.csv")]) == 0
    assert open_motion_file(tmp_path / "back.csv").info.side == model.side


def test_a_scene_without_a_hand_is_refused(tmp_path, capsys):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert cli.main(["export", str(tmp_path / "shot.blend"), "-o", str(tmp_path / "out.csv")]) == 1
    assert "must have a LiveHand hand" in capsys.readouterr().err


def test_a_characters_bones_get_keys(other_rigs, model, tmp_path, capsys):
    other_rigs.make_rigged_hand(model.side)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "character.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    keyed(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    rig, output = f"{tmp_path / 'character.blend'}:Elsewhere", tmp_path / "out.blend"
    assert cli.main(["export", str(tmp_path / "shot.blend"), "--rig", rig, "-o", str(output), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["hands"][model.side]["worst_deg"] < 0.1
    bpy.ops.wm.open_mainfile(filepath=str(output))
    armature = bpy.data.objects["Elsewhere"]
    assert tuple(armature.animation_data.action.frame_range) == (1, 4)
    assert not list(tmp_path.glob("*.partial*"))


@pytest.mark.parametrize(
    ("rig", "output", "message"),
    [
        ("none.blend", "out.blend", "no character at"),
        ("character.blend:Nobody", "out.blend", "armature"),
        ("character.blend", "out.fbx", "must be written to a .blend"),
    ],
)
def test_a_wrong_character_is_refused(other_rigs, tmp_path, capsys, rig, output, message):
    other_rigs.make_rigged_hand("right")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "character.blend"))
    np.savez(tmp_path / "take.npz", theta=np.zeros((2, 16, 3)), fps=30.0, side="right")
    words = [str(tmp_path / "take.npz"), "--rig", str(tmp_path / rig), "-o", str(tmp_path / output)]
    assert cli.main(["export", *words]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / output).exists()


@pytest.mark.parametrize(
    ("source", "more", "message"),
    [
        ("take.npz", ["-o", "out.fbx", "--texture-size", "64"], "--texture-size is of a skin, got none"),
        ("take.npz", ["-o", "out.fbx", "--views", "20"], "--views is of splats"),
        ("take.npz", ["-o", "out.blend", "--rig", "a.blend", "--format", "mano"], "--format is of files for other"),
        ("take.npz", ["-o", "out.blend", "--rig", "a.blend", "--avatar", "light"], "--avatar is of fbx"),
        ("shot.blend", ["-o", "out.csv", "--fps", "25"], "--fps is of a file of poses and a rig's file, got a .blend"),
        ("shot.blend", ["-o", "out.csv", "--mano", "a.pkl"], "--mano is of a file of poses, got a .blend"),
        ("rig.bvh", ["-o", "out.csv", "--frames", "1-2"], "--frames is of a .blend, got a rig's file"),
    ],
)
def test_an_option_that_would_not_be_heeded_is_refused(tmp_path, capsys, source, more, message):
    np.savez(tmp_path / "take.npz", theta=np.zeros((2, 16, 3)), fps=30.0, side="right")
    words = [str(tmp_path / word) if word.startswith("out.") else word for word in more]
    assert cli.main(["export", str(tmp_path / source), *words]) == 1
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["take.npz"]


def test_the_operator_writes_the_chosen_format(model, tmp_path):
    hand = keyed(model)
    path = tmp_path / "take.npz"
    with pytest.raises(RuntimeError, match="MANO's hands_mean"):
        bpy.ops.livehand.export_take(filepath=str(path), format="mano", from_mean=True)
    assert not path.exists()
    assert bpy.ops.livehand.export_take(filepath=str(path), format="mano") == {"FINISHED"}
    file = open_motion_file(path)
    assert (file.info.format, file.info.side, file.info.frames) == ("MANO", hand.livehand.side, 4)


def test_the_operator_sends_to_the_chosen_rig(other_rigs, model):
    made = other_rigs.make_rigged_hand(model.side)
    hand = keyed(model)
    hand.livehand.other_rig.armature = made.armature
    bpy.ops.livehand.guess_bones()
    assert bpy.ops.livehand.send_to_rig() == {"FINISHED"}
    assert tuple(made.armature.animation_data.action.frame_range) == (1, 4)
