"""The animator's operators: selecting, snapping, keying, and mirroring between two hands."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.bones import FINGERS, bone_name, target_name
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, mesh_of
from livehand.livehand_blender.rig.pose import read_hand_pose, write_theta
from livehand.livehand_blender.rig.sliders import read_slider, write_slider


def read(hand):
    hand.update_tag()
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta


def selected(hand):
    return {bone.name for bone in hand.pose.bones if (bone if hasattr(bone, "select") else bone.bone).select}


def test_a_finger_is_selected_by_its_bones_or_by_its_target(hand, model):
    letter = model.side[0].upper()
    bpy.context.view_layer.objects.active = mesh_of(hand)
    bpy.ops.livehand.select_finger(finger="index")
    assert (bpy.context.active_object, hand.mode) == (hand, "POSE")
    assert selected(hand) == {f"index{k}.{letter}" for k in (1, 2, 3)}
    write_slider(hand, "thumb.ik", 1)
    bpy.ops.livehand.select_finger(finger="thumb", extend=True)
    assert len(selected(hand)) == 4
    bpy.ops.livehand.select_bone(bone=f"wrist.{letter}")
    assert selected(hand) == {f"wrist.{letter}"}
    assert hand.data.bones.active.name == f"wrist.{letter}"
    with pytest.raises(RuntimeError, match=r"no bone nose\.X"):
        bpy.ops.livehand.select_bone(bone="nose.X")


@pytest.mark.parametrize("finger", ["all", "ring"])
def test_snapping_there_and_back_moves_nothing(hand, finger):
    write_slider(hand, "fist", 0.4)
    write_slider(hand, "opposition", 0.3)
    before = read(hand)
    bpy.ops.livehand.snap_ik_to_fk(finger=finger)
    assert [hand[f"{name}.ik"] for name in FINGERS] == [finger in ("all", name) for name in FINGERS]
    np.testing.assert_allclose(read(hand), before, atol=1e-4)
    bpy.ops.livehand.snap_fk_to_ik(finger=finger)
    assert not any(hand[f"{name}.ik"] for name in FINGERS)
    np.testing.assert_allclose(read(hand), before, atol=1e-4)


def test_snapping_keys_the_switch_where_auto_keying_is_on(hand, model):
    settings = bpy.context.scene.tool_settings
    settings.use_keyframe_insert_auto = True
    try:
        bpy.context.scene.frame_set(5)
        bpy.ops.livehand.snap_ik_to_fk(finger="index")
        bpy.context.scene.frame_set(9)
        hand.pose.bones[target_name("index", model.side)].location = (0.02, -0.02, 0.01)
        by_target = read(hand)
        bpy.ops.livehand.snap_fk_to_ik(finger="index")
    finally:
        settings.use_keyframe_insert_auto = False
    bpy.context.scene.frame_set(5)
    np.testing.assert_allclose(read(hand), 0, atol=1e-4)
    assert hand["index.ik"] == 1
    bpy.context.scene.frame_set(9)
    np.testing.assert_allclose(read(hand), by_target, atol=1e-4)
    assert hand["index.ik"] == 0


def test_a_hand_whose_control_bones_were_deleted_is_still_reset(hand):
    bpy.context.view_layer.objects.active = hand
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in [bone for bone in hand.data.edit_bones if bone.name.startswith(("IK-", "CTL-"))]:
        hand.data.edit_bones.remove(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    for name in ("snap_ik_to_fk", "snap_fk_to_ik", "select_finger", "select_bone"):
        assert not getattr(bpy.ops.livehand, name).poll()
    write_theta(RiggedHand.of(hand), np.full((16, 3), 0.1))
    assert bpy.ops.livehand.reset_pose() == {"FINISHED"}
    np.testing.assert_allclose(read(hand), 0, atol=1e-6)


def press_i():
    """Insert keys by the keying set, as in a 3D view."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        assert bpy.ops.anim.keyframe_insert_by_name(type="LIVEHAND_KS_hand") == {"FINISHED"}


def test_the_keying_set_brings_poses_back(hand):
    bpy.context.view_layer.objects.active = hand
    scene = bpy.context.scene
    poses = {}
    for frame, fist in ((1, 0.0), (11, 0.6)):
        scene.frame_set(frame)
        write_theta(RiggedHand.of(hand), np.full((16, 3), 0.02 * frame))
        write_slider(hand, "fist", fist)
        write_slider(hand, "pinky.spread", -fist)
        poses[frame] = read(hand)
        press_i()
    for frame, theta in poses.items():
        scene.frame_set(frame)
        np.testing.assert_allclose(read(hand), theta, atol=1e-5)


def test_one_click_keys_the_hand(hand):
    bpy.context.view_layer.objects.active = hand
    scene = bpy.context.scene
    poses = {}
    for frame, fist in ((1, 0.0), (11, 0.6)):
        scene.frame_set(frame)
        write_theta(RiggedHand.of(hand), np.full((16, 3), 0.02 * frame))
        write_slider(hand, "fist", fist)
        poses[frame] = read(hand)
        assert bpy.ops.livehand.key_hand() == {"FINISHED"}
    for frame, theta in poses.items():
        scene.frame_set(frame)
        np.testing.assert_allclose(read(hand), theta, atol=1e-5)


@pytest.mark.parametrize("turn_wrist", [True, False])
def test_a_pose_is_mirrored_to_the_nearest_other_hand(turn_wrist):
    right, left, far = (
        add_hand(bpy.context, load_default_hand().for_side(side), name=side) for side in ("right", "left", "left")
    )
    far.location.x = 3
    theta = theta_of(GESTURES["point"].angles_deg(), FingerAxes.of_default_hand(), np.array([0.2, -0.3, 0.4]))
    write_theta(RiggedHand.of(right), theta)
    write_slider(right, "fist", 0.2)
    bpy.context.view_layer.objects.active = right
    mirrored = read(right) * MIRROR_AXIS_ANGLE
    if not turn_wrist:
        mirrored[0] = 0
    assert bpy.ops.livehand.mirror_pose(turn_wrist=turn_wrist) == {"FINISHED"}
    np.testing.assert_allclose(read(left), mirrored, atol=1e-5)
    np.testing.assert_allclose(read(far), 0, atol=1e-6)


def test_without_another_hand_nothing_is_mirrored(hand):
    with pytest.raises(RuntimeError, match=r"the scene must have a (left|right) hand"):
        bpy.ops.livehand.mirror_pose()


def copy_and_paste_flipped(source, target):
    """As an animator does it: Ctrl-C on one armature, Shift-Ctrl-V on the other, both in pose mode."""
    for hand, run in ((source, bpy.ops.pose.copy), (target, lambda: bpy.ops.pose.paste(flipped=True))):
        bpy.context.view_layer.objects.active = hand
        bpy.ops.object.mode_set(mode="POSE")
        bpy.ops.pose.select_all(action="SELECT")
        run()
        bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("source", [0, 1])
def test_a_pose_pasted_flipped_on_the_other_hand_is_its_mirror_image(source):
    hands = [add_hand(bpy.context, load_default_hand().for_side(side)) for side in ("right", "left")]
    theta = theta_of(GESTURES["point"].angles_deg(), FingerAxes.of_default_hand(), np.array([0.2, -0.3, 0.4]))
    theta = theta if source == 0 else theta * MIRROR_AXIS_ANGLE
    write_theta(RiggedHand.of(hands[source]), theta)
    copy_and_paste_flipped(hands[source], hands[1 - source])
    np.testing.assert_allclose(read(hands[1 - source]), theta * MIRROR_AXIS_ANGLE, atol=1e-5)


def test_targets_pasted_flipped_move_the_other_hand_symmetrically():
    right, left = (add_hand(bpy.context, load_default_hand().for_side(side)) for side in ("right", "left"))
    right.pose.bones["IK-index.R"].location = (0.01, -0.02, 0.02)
    write_slider(right, "index.ik", 1.0)
    write_slider(left, "index.ik", 1.0)
    copy_and_paste_flipped(right, left)
    theta = read(right)
    assert np.abs(theta[1:4]).max() > 0.2
    np.testing.assert_allclose(read(left), theta * MIRROR_AXIS_ANGLE, atol=2e-3)


def test_bone_shapes_are_made_once_and_are_in_no_scene(hand, model):
    other = add_hand(bpy.context, model.for_side("left"))
    worn = {bone.custom_shape for thing in (hand, other) for bone in thing.pose.bones if bone.custom_shape}
    assert len(worn) == 2
    assert all(not shape.users_scene for shape in worn)
    shown = {c.name: {bone.name for bone in c.bones} for c in hand.data.collections if c.is_visible}
    assert {name: len(bones) for name, bones in shown.items()} == {"FK": 17, "IK": 5, "Masters": 5}
    assert {bone.name for bone in hand.pose.bones if bone.custom_shape} == shown["FK"] | shown["IK"] | shown["Masters"]


def test_copied_poses_have_the_sliders_once_they_are_applied(hand, model):
    """Blender's Copy Pose and Paste Pose Flipped know bones alone."""
    other = add_hand(bpy.context, load_default_hand().for_side("left" if model.side == "right" else "right"))
    write_slider(hand, "index.curl", 0.8)
    write_slider(hand, "fist", 0.2)
    hand.update_tag()
    wanted = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())
    bpy.context.view_layer.objects.active = hand
    assert bpy.ops.livehand.apply_sliders() == {"FINISHED"}
    assert (read_slider(hand, "index.curl"), read_slider(hand, "fist")) == (0, 0)
    hand.update_tag()
    np.testing.assert_allclose(
        read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta, wanted.theta, atol=1e-5
    )
    for joint in range(1, 16):  # what Paste Pose Flipped does
        of_joint = hand.pose.bones[bone_name(joint, model.side)].rotation_quaternion
        w, x, y, z = of_joint
        other.pose.bones[bone_name(joint, other.livehand.side)].rotation_quaternion = (w, x, -y, -z)
    other.update_tag()
    flipped = read_hand_pose(other, bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(flipped.theta[1:], wanted.mirrored().theta[1:], atol=1e-5)
