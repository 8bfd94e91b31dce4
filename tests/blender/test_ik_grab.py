"""Moving a fingertip target turns its finger's IK on; cancelling turns it off again."""

import bpy
import numpy as np
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rig.sliders import write_slider
from livehand.livehand_blender.ui.ik_grab import grab_targets, release_targets


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
