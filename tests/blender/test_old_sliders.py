"""A file of the version whose sliders played with LiveHand only: values, keys, strips and drivers."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.rig.hand import find_hands
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rig.sliders import SLIDERS, slider_path

FILE = str(Path(__file__).with_name("earlier_sliders.blend"))
# theta of index1, thumb1 and ring1 as that version evaluated it in Blender 4.2, to 1e-4 rad.
THETA = {
    1: [[0.0, 0.0, 0.0], [-0.0223, -0.3353, 0.0658], [-0.0003, 0.002, -0.0003]],
    6: [[0.0677, -0.0893, 0.636], [0.0056, -0.3687, 0.0706], [0.0139, -0.011, -0.1088]],
    11: [[0.1353, -0.1786, 1.272], [0.0335, -0.402, 0.0754], [0.022, -0.0185, -0.1716]],
}
JOINTS = [1, 13, 10]


@pytest.fixture
def opened():
    bpy.ops.wm.open_mainfile(filepath=FILE)
    return find_hands(bpy.context.scene)[0]


def pose_at(hand, frame):
    bpy.context.scene.frame_set(frame)
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def check_plays(hand):
    for frame, theta in THETA.items():
        pose = pose_at(hand, frame)
        np.testing.assert_allclose(pose.theta[JOINTS], theta, atol=1e-4)
        np.testing.assert_allclose(pose.beta[:3], (0.2 * (frame - 1), 1.5, 0), atol=1e-6)


def test_values_are_kept(opened):
    sliders = opened.livehand
    assert (sliders.ring.ik, sliders.follow, sliders.limit_joints, sliders.pinky.spread) == (0.25, 0.5, True, -0.5)
    assert (opened["ring.ik"], opened["follow"], opened["limit_joints"], opened["pinky.spread"]) == (
        0.25,
        0.5,
        True,
        -0.5,
    )
    assert sliders.opposition == 0.5  # driven
    assert SLIDERS.keys() <= set(opened.keys())


def test_it_plays_as_before(opened):
    check_plays(opened)


def test_curves_of_used_and_of_spare_actions_are_renamed(opened, curves_of):
    paths = {action.name: {curve.data_path for curve in curves_of(action)} for action in bpy.data.actions}
    assert paths == {
        "Keyed": {slider_path("index.curl"), slider_path("beta")},
        "Strip": {slider_path("thumb.curl")},
        "Spare": {slider_path("middle.curl")},
    }


def test_nothing_refers_to_the_earlier_names(opened):
    shapes = [shape_keys for shape_keys in bpy.data.shape_keys]
    curves = [
        curve
        for owner in (*bpy.data.objects, *shapes)
        if owner.animation_data
        for curve in owner.animation_data.drivers
    ]
    targets = [target for curve in curves for variable in curve.driver.variables for target in variable.targets]
    assert len(targets) > 100
    references = [*curves, *targets, *bpy.context.scene.keying_sets["Own"].paths]
    assert not [one.data_path for one in references if one.data_path.startswith("livehand")]


def test_the_users_own_property_of_a_sliders_name_still_drives_it(opened):
    assert opened["opposition (own)"] == 0.25
    (driver,) = [curve for curve in opened.animation_data.drivers if curve.data_path == slider_path("opposition")]
    assert driver.driver.variables[0].targets[0].data_path == '["opposition (own)"]'


def test_other_objects_read_the_sliders_of_the_same_frame(opened):
    reader = bpy.data.objects["Reader"]
    for frame in (11, 1, 6):
        bpy.context.scene.frame_set(frame)
        moved = reader.evaluated_get(bpy.context.evaluated_depsgraph_get()).location.x
        assert moved == pytest.approx(0.3 * (frame - 1), abs=1e-5)


def test_it_stays_so_when_it_is_saved_and_opened_again(opened, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "new.blend"))
    opened.livehand.ring.ik = 0.75
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "new.blend"))
    (hand,) = find_hands(bpy.context.scene)
    assert hand.livehand.ring.ik == hand["ring.ik"] == 0.75
    assert hand["opposition (own)"] == 0.25


def test_an_appended_hand_is_renewed():
    bpy.ops.wm.append(directory=f"{FILE}/Object/", filename="Hand")
    bpy.context.view_layer.update()
    (hand,) = find_hands(bpy.context.scene)
    assert hand["ring.ik"] == 0.25
    check_plays(hand)


def linked(overridden):
    with bpy.data.libraries.load(FILE, link=True) as (_, wanted):
        wanted.objects = ["Hand"]
    (hand,) = wanted.objects
    bpy.context.collection.objects.link(hand)
    bpy.context.view_layer.update()
    if overridden:
        hand = hand.override_hierarchy_create(bpy.context.scene, bpy.context.view_layer, do_fully_editable=True)
    return hand


@pytest.mark.parametrize("overridden", [False, True])
def test_a_hand_linked_from_such_a_file_plays_as_before(overridden):
    hand = linked(overridden)
    check_plays(hand)
    assert hand.livehand.ring.ik == 0.25


def test_an_override_of_a_hand_in_such_a_file_keeps_its_values(tmp_path):
    hand = linked(True)
    hand.livehand.middle.spread, hand.livehand.beta[4] = 0.75, 2.0
    before = pose_at(hand, 6)
    for _ in range(2):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"), relative_remap=False)
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
        (hand,) = [thing for thing in find_hands(bpy.context.scene) if thing.override_library]
        assert (hand.livehand.middle.spread, hand.livehand.beta[4]) == (0.75, 2.0)
        np.testing.assert_allclose(pose_at(hand, 6).theta, before.theta, atol=1e-6)
