"""Moving a fingertip target turns its finger's IK on; cancelling turns it off again."""

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rig.sliders import write_slider
from livehand.livehand_blender.ui.ik_grab import fetch_targets, grab_targets, release_targets


def theta(hand):
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta


def test_a_grabbed_target_moves_its_finger(hand, model):
    suffix = model.side[0].upper()
    write_slider(hand, "thumb.ik", 0.5)
    grabbed = grab_targets(RiggedHand.of(hand), [f"IK-index.{suffix}", f"IK-thumb.{suffix}", f"ring1.{suffix}"])
    assert [one.finger for one in grabbed] == ["index"]
    assert hand["thumb.ik"] == 0.5
    hand.pose.bones[f"IK-index.{suffix}"].location = (0.01, -0.02, 0.02)
    hand.update_tag()
    assert np.abs(theta(hand)[1:4]).max() > 0.2
    release_targets(grabbed, is_cancelled=False)
    assert hand["index.ik"] == 1


def test_a_cancelled_move_changes_nothing(hand, model):
    grabbed = grab_targets(RiggedHand.of(hand), [f"IK-ring.{model.side[0].upper()}"])
    release_targets(grabbed, is_cancelled=True)
    assert hand["ring.ik"] == 0
    assert np.abs(theta(hand)).max() < 1e-5


def test_automatic_keying_keys_the_switch(hand, model, curves_of):
    settings = bpy.context.scene.tool_settings
    settings.use_keyframe_insert_auto = True
    try:
        release_targets(grab_targets(RiggedHand.of(hand), [f"IK-ring.{model.side[0].upper()}"]), is_cancelled=False)
    finally:
        settings.use_keyframe_insert_auto = False
    assert any("ik" in curve.data_path.lower() for curve in curves_of(hand.animation_data.action))


def drawn_and_tip(hand, finger):
    """Where a finger's target is drawn, and its fingertip, in the armature's space."""
    hand.update_tag()
    bones = hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    suffix = hand.livehand.side[0].upper()
    target = bones[f"IK-{finger}.{suffix}"]
    shown = target.custom_shape_transform or target
    return np.array(shown.head), np.array(bones[f"{finger}3.{suffix}"].tail)


@pytest.mark.parametrize("finger", ["thumb", "index", "pinky"])
def test_targets_are_drawn_at_the_fingertips_of_curled_fingers(hand, finger):
    write_slider(hand, "fist", 0.8)
    hand.pose.bones[f"wrist.{hand.livehand.side[0].upper()}"].rotation_quaternion = (0.9, 0.2, 0.1, 0.3)
    drawn, tip = drawn_and_tip(hand, finger)
    np.testing.assert_allclose(drawn, tip, atol=1e-6)
    assert (
        np.abs(tip - np.array(hand.data.bones[f"IK-{finger}.{hand.livehand.side[0].upper()}"].head_local)).max() > 0.01
    )


def test_with_ik_a_target_is_drawn_where_it_is(hand, model):
    suffix = model.side[0].upper()
    hand.pose.bones[f"IK-index.{suffix}"].location = (0.0, 0.3, 0.0)  # out of reach
    write_slider(hand, "index.ik", 1)
    drawn, tip = drawn_and_tip(hand, "index")
    bones = hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    np.testing.assert_allclose(drawn, bones[f"IK-index.{suffix}"].head, atol=1e-6)
    assert np.linalg.norm(drawn - tip) > 0.1


def test_a_selected_target_is_put_where_it_is_drawn_so_that_a_grabbed_finger_does_not_jump(hand, model):
    suffix = model.side[0].upper()
    write_slider(hand, "fist", 0.8)
    write_slider(hand, "ring.ik", 1)
    hand.update_tag()
    before = theta(hand)
    ring = tuple(hand.pose.bones[f"IK-ring.{suffix}"].location)
    selected = [f"IK-index.{suffix}", f"IK-ring.{suffix}", f"wrist.{suffix}"]
    fetch_targets(bpy.context, RiggedHand.of(hand), selected)
    np.testing.assert_allclose(theta(hand), before, atol=1e-6)
    assert [one.finger for one in grab_targets(RiggedHand.of(hand), selected)] == ["index"]
    hand.update_tag()
    np.testing.assert_allclose(theta(hand), before, atol=5e-3)
    assert tuple(hand.pose.bones[f"IK-ring.{suffix}"].location) == ring


def test_only_selected_targets_of_fingers_without_ik_are_moved(hand, model):
    suffix = model.side[0].upper()
    write_slider(hand, "fist", 0.8)
    write_slider(hand, "ring.ik", 1)
    hand.pose.bones[f"IK-ring.{suffix}"].location = (0.0, 0.3, 0.0)  # out of reach
    hand.update_tag()
    targets = [bone for bone in hand.pose.bones if bone.name.startswith("IK-")]
    before = {bone.name: tuple(bone.location) for bone in targets}
    fetch_targets(bpy.context, RiggedHand.of(hand), [f"IK-index.{suffix}", f"IK-ring.{suffix}"])
    assert {bone.name for bone in targets if tuple(bone.location) != before[bone.name]} == {f"IK-index.{suffix}"}
