"""The panel Other Rig: bones are guessed, operators do the same as the functions, and errors change nothing."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model import JOINT_NAMES
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rigs.follow import is_following
from livehand.livehand_blender.ui.rigs import LIVEHAND_PT_other_rig, LIVEHAND_PT_other_rig_bones

# What is the same for both.
ONE_SIDE = pytest.mark.parametrize("model", ["right"], indirect=True)


@pytest.fixture
def chosen(other_rigs, model):
    """An animated rig that is chosen on our hand."""
    made = other_rigs.make_rigged_hand(model.side)
    made.animate()
    ours = add_hand(bpy.context, model)
    ours.livehand.other_rig.armature = made.armature
    return made, ours


def theta(hand, frame):
    bpy.context.scene.frame_set(frame)
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta


def test_following_and_baking_agree(chosen):
    made, ours = chosen
    bpy.ops.livehand.guess_bones()
    assert tuple(getattr(ours.livehand.other_rig, joint) for joint in JOINT_NAMES) == made.joint_map.bones
    assert ours.livehand.other_rig.pinky_tip == "pinky-finger-tip"
    assert not bpy.ops.livehand.stop_following.poll()
    bpy.ops.livehand.follow_rig()
    live = [theta(ours, frame) for frame in (1, 8, 21)]
    bpy.ops.livehand.bake_rig()
    assert not is_following(ours)
    for frame, seen in zip((1, 8, 21), live, strict=True):
        np.testing.assert_allclose(theta(ours, frame), seen, atol=2e-4)
    assert tuple(ours.animation_data.action.frame_range) == (1, 21)


@ONE_SIDE
def test_stopping_keeps_the_pose(chosen):
    _, ours = chosen
    bpy.ops.livehand.guess_bones()
    bpy.ops.livehand.follow_rig()
    seen = theta(ours, 6)
    bpy.ops.livehand.stop_following()
    np.testing.assert_allclose(theta(ours, 6), seen, atol=1e-5)


@ONE_SIDE
def test_following_works_in_pose_mode_and_is_one_undo_step(chosen):
    _, ours = chosen
    name = ours.name
    bpy.ops.livehand.guess_bones()
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.livehand.follow_rig("EXEC_DEFAULT", True)
    assert ours.mode == "POSE"
    assert bpy.context.selected_objects == [ours]
    bpy.ops.ed.undo()
    assert not is_following(bpy.data.objects[name])


@ONE_SIDE
def test_missing_and_duplicate_bones_are_reported(chosen):
    _, ours = chosen
    with pytest.raises(RuntimeError, match="none is chosen for wrist, index1"):
        bpy.ops.livehand.follow_rig()
    bpy.ops.livehand.guess_bones()
    ours.livehand.other_rig.thumb1 = "wrist"
    with pytest.raises(RuntimeError, match="chosen more than once: wrist"):
        bpy.ops.livehand.bake_rig()
    ours.livehand.other_rig.thumb1 = "nothing"
    with pytest.raises(RuntimeError, match="must have a bone 'nothing'"):
        bpy.ops.livehand.follow_rig()
    assert not is_following(ours)
    assert ours.animation_data.action is None


def test_a_missing_side_leaves_the_fields_empty(chosen):
    made, ours = chosen
    ours.livehand.other_rig.side = "left" if made.side == "right" else "right"
    bpy.ops.livehand.guess_bones()
    assert ours.livehand.other_rig.wrist == ""


def test_operators_need_a_rig(hand):
    assert not bpy.ops.livehand.guess_bones.poll()
    assert not bpy.ops.livehand.follow_rig.poll()
    assert not LIVEHAND_PT_other_rig_bones.poll(bpy.context)


class Layout:
    """Records what is drawn."""

    def __init__(self, drawn):
        self.drawn = drawn

    def row(self, align=False):
        return self

    column = row

    def prop(self, owner, name, **_):
        assert name in owner.bl_rna.properties or owner.path_resolve(name) is not None
        self.drawn.append(name.strip('["]'))

    def prop_search(self, owner, name, data, collection):
        assert hasattr(data, collection)
        self.prop(owner, name)

    def operator(self, name, **_):
        self.drawn.append(name)


@ONE_SIDE
def test_what_the_panel_shows(chosen):
    def drawn(panel):
        layout = Layout([])
        panel.draw(type("Self", (), {"layout": layout})(), bpy.context)
        return layout.drawn

    assert "livehand.stop_following" not in drawn(LIVEHAND_PT_other_rig)
    assert len(set(drawn(LIVEHAND_PT_other_rig_bones))) == 22
    bpy.ops.livehand.guess_bones()
    bpy.ops.livehand.follow_rig()
    assert {"livehand.stop_following", "follow"} <= set(drawn(LIVEHAND_PT_other_rig))


@ONE_SIDE
def test_a_following_hand_that_cannot_be_edited_is_not_keyed(chosen):
    _, ours = chosen
    bpy.ops.livehand.guess_bones()
    bpy.ops.livehand.follow_rig()
    ours.hide_viewport = True
    bpy.context.view_layer.objects.active = ours
    with pytest.raises(RuntimeError, match="must be visible"):
        bpy.ops.livehand.bake_rig()
    assert is_following(ours)
    assert ours.animation_data.action is None


@ONE_SIDE
def test_only_an_armature_is_a_rig(chosen):
    _, ours = chosen
    assert bpy.ops.livehand.guess_bones.poll()
    ours.livehand.other_rig.armature = ours.livehand.mesh  # as scripts and Blender 4.2's field can
    for button in ("guess_bones", "follow_rig", "bake_rig"):
        assert not getattr(bpy.ops.livehand, button).poll()
    assert not LIVEHAND_PT_other_rig_bones.poll(bpy.context)
    ours.livehand.other_rig.armature = None
    assert not bpy.ops.livehand.guess_bones.poll()
