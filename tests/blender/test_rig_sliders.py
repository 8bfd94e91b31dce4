"""Sliders are the armature's own properties: files play without LiveHand, and scripts write them."""

import json
import os
import subprocess
import sys

import bpy
import numpy as np
import pytest
from livehand.backend.hand.bones import FINGERS, bone_name, finger_joints
from livehand.livehand_blender.rig.controls import CONTROLS
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands
from livehand.livehand_blender.rig.keyframes import key_hand
from livehand.livehand_blender.rig.sliders import SLIDERS, read_slider, slider_path, write_slider

WITHOUT_LIVEHAND = """
import json, sys
import bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types.Object, "livehand")
positions = {}
for frame in json.loads(sys.argv[2]):
    bpy.context.scene.frame_set(frame)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hand = bpy.data.objects["LiveHand"].evaluated_get(depsgraph)
    mesh = bpy.data.objects["LiveHand Mesh"].evaluated_get(depsgraph).to_mesh()
    positions[frame] = [list(hand.pose.bones[sys.argv[3]].tail), list(mesh.vertices[0].co)]
print("POSITIONS " + json.dumps(positions))
"""


def tail_m(hand, bone):
    """A bone's end after the view layer has been updated, and nothing else."""
    bpy.context.view_layer.update()
    return np.array(hand.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones[bone].tail)


def last_bone(finger, side):
    return bone_name(finger_joints(finger)[-1], side)


def test_a_saved_file_plays_without_livehand(hand, model, tmp_path):
    for frame, value in ((1, 0.0), (11, 1.0)):
        hand["index.curl"], hand["beta"][0] = value, 2 * value
        for name in ("index.curl", "beta"):
            hand.keyframe_insert(slider_path(name), frame=frame)
    bone, path, frames = last_bone("index", model.side), str(tmp_path / "hand.blend"), [1, 6, 11]
    bpy.ops.wm.save_as_mainfile(filepath=path)
    command = [sys.executable, "-c", WITHOUT_LIVEHAND, path, json.dumps(frames), bone]
    output = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True, env=os.environ).stdout
    (line,) = [line for line in output.splitlines() if line.startswith("POSITIONS ")]
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        tail, vertex = json.loads(line[len("POSITIONS ") :])[str(frame)]
        mesh = hand.livehand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        np.testing.assert_allclose(tail, tail_m(hand, bone), atol=1e-6)
        np.testing.assert_allclose(vertex, mesh.vertices[0].co, atol=1e-6)
    bpy.context.scene.frame_set(1)
    assert np.linalg.norm(tail_m(hand, bone) - tail) > 0.05


@pytest.mark.parametrize("name", [*CONTROLS, "beta"])
def test_a_script_needs_no_update_tag(hand, model, name):
    bone = last_bone(name.partition(".")[0] if "." in name else "thumb", model.side)
    before = tail_m(hand, bone)
    write_slider(hand, name, (2,) * 10 if name == "beta" else 1)
    moved = tail_m(hand, bone)
    assert np.linalg.norm(moved - before) > 0.003
    write_slider(hand, name, SLIDERS[name].default)
    np.testing.assert_allclose(tail_m(hand, bone), before, atol=1e-6)
    hand[name] = [2.0] * 10 if name == "beta" else 1.0
    hand.update_tag()  # Blender's own rule for custom properties
    np.testing.assert_allclose(tail_m(hand, bone), moved, atol=1e-6)


@pytest.mark.parametrize("name", SLIDERS)
def test_a_slider_keeps_its_type_and_its_limits(hand, name):
    slider, value = SLIDERS[name], [1] * 10 if name == "beta" else 1
    write_slider(hand, name, value)  # whole numbers, of which Blender would make another property
    assert np.all(np.array(hand[name]) == 1)
    assert type(hand[name]) is type(slider.value(slider.default)) or hand[name].typecode == "d"
    interface = hand.id_properties_ui(name).as_dict()
    assert interface["description"] == slider.description
    assert {key: interface[key] for key in slider.limits} == dict(slider.limits)
    assert interface["default"] == (list(slider.default) if name == "beta" else slider.default)
    assert hand.is_property_overridable_library(slider_path(name))


def test_keys_are_of_the_armatures_own_properties(hand, curves_of):
    key_hand(RiggedHand.of(hand), 1)
    paths = {curve.data_path for curve in curves_of(hand.animation_data.action)}
    assert {slider_path(f"{finger}.ik") for finger in FINGERS} | {slider_path("fist")} < paths


def test_a_copy_has_sliders_of_its_own(hand, model):
    write_slider(hand, "index.curl", 1.0)
    hand.select_set(True)
    bpy.context.view_layer.objects.active = hand
    bpy.ops.object.duplicate()
    (copy,) = [thing for thing in find_hands(bpy.context.scene) if thing != hand]
    before = tail_m(hand, last_bone("index", model.side))
    np.testing.assert_allclose(tail_m(copy, last_bone("index", model.side)), before, atol=1e-6)
    write_slider(copy, "index.curl", 0.0)
    np.testing.assert_allclose(tail_m(hand, last_bone("index", model.side)), before, atol=1e-6)
    assert np.linalg.norm(tail_m(copy, last_bone("index", model.side)) - before) > 0.03


def test_a_removed_slider_rests(hand, model):
    del hand["fist"]
    assert read_slider(hand, "fist") == 0
    write_slider(hand, "index.curl", 1.0)
    assert np.isfinite(tail_m(hand, last_bone("index", model.side))).all()


def test_whole_numbers_stay_a_slider(hand):
    hand["beta"], hand["fist"] = [1] * 10, 1
    assert hand["beta"].typecode == "d"
    assert isinstance(hand["fist"], float)
