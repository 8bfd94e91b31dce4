"""A file that version 0.2 has saved stays readable: its settings, its sliders, its keys, and its hand's render."""

import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.render.hand_source import hand_source
from livehand.livehand_blender.rig.controls import CONTROLS
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands
from livehand.livehand_blender.rig.pose import read_pose, write_theta
from livehand.livehand_blender.rig.sliders import write_slider

HERE = Path(__file__).parent
SAVED = runpy.run_path(str(HERE / "make_saved_file.py"))
SINCE_0_2 = {"watermark"}  # of the scene; off


@pytest.fixture
def opened():
    bpy.ops.wm.open_mainfile(filepath=str(HERE / "saved_by_0_2.blend"))
    return find_hands(bpy.context.scene)[0]


def read(group, values):
    found = {name: getattr(group, name) for name in values}
    return {name: tuple(value) if isinstance(values[name], tuple) else value for name, value in found.items()}


def test_every_setting_is_read(opened):
    scene = bpy.context.scene
    assert read(opened.livehand, SAVED["HAND"]) == SAVED["HAND"]
    assert read(scene.livehand, SAVED["SCENE"]) == SAVED["SCENE"]
    assert read(scene.view_layers[0].livehand, SAVED["LAYER"]) == SAVED["LAYER"]
    assert not hasattr(scene.livehand, "rough_light")
    assert hand_source(opened).avatar_path.stem == "middle"


def test_no_setting_is_missing_from_the_file(opened):
    """A new one needs a place in a file of the version that has it."""
    others = {"is_hand", "is_skin", "side", "model_path", "model_sha256", "avatar_path", "mesh", "bone_shapes"}
    for group, names in (
        (opened.livehand, {*SAVED["HAND"], *others, "other_rig"}),
        (bpy.context.scene.livehand, {*SAVED["SCENE"], *SINCE_0_2}),
        (bpy.context.scene.view_layers[0].livehand, SAVED["LAYER"].keys()),
    ):
        assert {one.identifier for one in group.bl_rna.properties} - {"rna_type", "name"} == set(names)


def test_its_sliders_and_keys_play(opened):
    assert {name: opened[name] for name in SAVED["SLIDERS"]} == SAVED["SLIDERS"]
    assert list(opened["beta"]) == SAVED["BETA"]
    hand, scene = RiggedHand.of(opened), bpy.context.scene
    for name in SAVED["SLIDERS"]:
        write_slider(opened, name, 0)
    for frame, curl in SAVED["KEYED"].items():
        scene.frame_set(frame)
        pose = read_pose(hand, bpy.context.evaluated_depsgraph_get())
        assert opened["index.curl"] == pytest.approx(curl)
        expected = theta_of(curl * CONTROLS["index.curl"].angles_deg(), FingerAxes.of_default_hand())
        np.testing.assert_allclose(pose.theta, expected, atol=1e-5)
        np.testing.assert_array_equal(pose.beta, SAVED["BETA"])


def test_its_master_bones_curl_their_fingers(opened):
    """They are the root's children there, and do not follow the wrist."""
    hand = RiggedHand.of(opened)
    write_theta(hand, np.zeros((16, 3)))
    opened.pose.bones[f"CTL-index.{hand.side[0].upper()}"].rotation_euler.x = 0.5
    opened.update_tag()
    pose = read_pose(hand, bpy.context.evaluated_depsgraph_get())
    curled = CONTROLS["index.curl"].angles_deg()
    share = np.rad2deg(0.5) / np.abs(curled).max()
    np.testing.assert_allclose(pose.theta, theta_of(share * curled, FingerAxes.of_default_hand()), atol=1e-5)


def test_its_hand_is_posed_and_rendered(opened, fake_session):
    write_theta(RiggedHand.of(opened), np.zeros((16, 3)))
    bpy.context.scene.livehand.mode = "HAND"
    (visible,) = visible_hands(bpy.context.evaluated_depsgraph_get())
    bpy.ops.render.render()
    (shot,) = fake_session.made[-1].shots
    assert len(shot.vertices) == len(visible.mesh.data.vertices)
    assert (shot.wrist_fade_m, shot.hair) == (0.02, 0.25)
    assert fake_session.made[-1].avatar_path.stem == "middle"
    assert fake_session.made[-1].device.name == "cpu"
