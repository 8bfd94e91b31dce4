"""Twelve rigs, both sides: a motion is keyed on the rig's own bones, and baked back onto a hand that has forgotten it.

`python -m livehand.tools.results.collect round_trips` runs these and keeps what they record.
"""

import bpy
import numpy as np
import pytest
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.livehand_blender.motion.keying import sample_motion
from livehand.livehand_blender.motion.taking import sample_take
from livehand.livehand_blender.rig.keyframes import keyframe_theta, keyframe_transl
from livehand.livehand_blender.rigs.aimed_bones import with_twists
from livehand.livehand_blender.rigs.bake import bake
from livehand.livehand_blender.rigs.sending import send
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton
from livehand.tests.blender.characters import CHARACTERS, make_character
from livehand.tests.blender.test_send import FRAMES, MOST_DEG, MOST_M, apart_deg, keyed_hand, within_reach

RIGIFY = {"Rigify's metarig": ("metarig", "FK"), "Rigify, FK": ("generated", "FK"), "Rigify, IK": ("generated", "IK")}
RIGS = (*CHARACTERS, *RIGIFY)


def rig_and_hand(kind, model, other_rigs, rigify_file):
    """(the rig's armature, the joints found in it, our keyed hand, the arm that is keyed)."""
    if kind in RIGIFY:
        bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
        name, arm = RIGIFY[kind]
        found = guess_joints(read_skeleton(bpy.data.objects[name]), model.side).joint_map()
        return bpy.data.objects[name], found, within_reach(bpy.data.objects[name], found, model), arm
    armature = make_character(other_rigs, model.side, kind)
    return armature, guess_joints(read_skeleton(armature), model.side).joint_map(), keyed_hand(model), "FK"


def forget(hand):
    """Leave nothing of a hand's motion."""
    hand.armature.animation_data.action = None
    keyframe_theta(hand, np.zeros((1, 16, 3)), [FRAMES[0]])
    keyframe_transl(hand, np.zeros((1, 3)), [FRAMES[0]])
    hand.armature.animation_data.action = None


@pytest.mark.nightly
@pytest.mark.parametrize("kind", RIGS)
def test_a_motion_comes_back_from_a_rig(other_rigs, rigify_file, model, curves_of, record_property, kind):
    rig, found, ours, arm = rig_and_hand(kind, model, other_rigs, rigify_file)
    assert found.missing == ()
    source = SourceRig(rig, with_twists(rig, found))
    before = sample_motion(bpy.context, ours, FRAMES)
    sent = send(bpy.context, sample_take(bpy.context, [ours], FRAMES).hands[0], source, FRAMES, arm=arm)
    assert sent.doubt is None
    forget(ours)
    assert apart_deg(sample_motion(bpy.context, ours, FRAMES).theta, before.theta).max() > 30
    doubt = bake(bpy.context, ours, source, FRAMES, fits_shape=False).doubt
    assert doubt is None or (arm == "IK" and doubt.startswith("the wrist bends"))  # the elbow aims the forearm
    after = sample_motion(bpy.context, ours, FRAMES)
    joints_deg = apart_deg(after.theta, before.theta).max(0)
    wrist_m = np.linalg.norm(after.transl - before.transl, axis=1).max()
    rigs_times, times = (key_times(curves_of(one.animation_data.action)) for one in (rig, ours.armature))
    for name, value in {
        "rig": kind,
        "side": model.side,
        "bones": sent.bones,
        "joints_deg": joints_deg.max(),
        "wrist_mm": 1000 * wrist_m,
        "keys": len(max(rigs_times, key=len)),
    }.items():
        record_property(name, value)
    assert joints_deg.max() < MOST_DEG
    if kind in CHARACTERS:  # Rigify's arms end at a shoulder, so that their elbows cannot be anywhere
        assert apart_deg(after.forearms, before.forearms).max() < MOST_DEG
    assert wrist_m < MOST_M
    whole, ends = tuple(map(float, FRAMES)), (float(FRAMES[0]), float(FRAMES[-1]))
    assert {whole} <= rigs_times <= {whole, ends}  # a switch is keyed at both ends
    assert times == {whole}


def key_times(curves):
    """The frames of the keys of each of some curves."""
    return {tuple(point.co.x for point in curve.keyframe_points) for curve in curves}
