"""The pose library: the contents of its files, and its poses on both hands."""

import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.poses import POSES
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_theta
from livehand.livehand_blender.rig.selection import select_bones, selected_bones
from livehand.livehand_blender.rig.sliders import write_slider
from livehand.livehand_blender.ui.pose_library import LIBRARY_NAME, library_folder, prepare_for_pose

SCRIPT = Path(__file__).parents[2] / "examples" / "make_pose_library.py"


@pytest.fixture
def actions():
    with bpy.data.libraries.load(str(library_folder() / "poses.blend")) as (stored, wanted):
        wanted.actions = stored.actions
    return {action.name: action for action in wanted.actions}


def theta_for(name, side):
    theta = theta_of(POSES[name].gesture.angles_deg(), FingerAxes.of_default_hand())
    return theta if side == "right" else theta * MIRROR_AXIS_ANGLE


def test_every_pose_of_the_table_gives_either_hand_its_theta(hand, model, actions):
    assert actions.keys() == POSES.keys()
    for name, action in actions.items():
        hand.pose.apply_pose_from_action(action, evaluation_time=1)
        hand.update_tag()
        theta = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
        np.testing.assert_allclose(theta, theta_for(name, model.side), atol=2e-6, err_msg=name)


def test_a_pose_does_not_move_the_wrist(hand, model, actions):
    theta = np.zeros((16, 3))
    theta[0] = 0.3, -0.2, 0.1
    write_theta(RiggedHand.of(hand), theta)
    hand.pose.apply_pose_from_action(actions["Fist"], evaluation_time=1)
    hand.update_tag()
    np.testing.assert_allclose(
        read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta[0], theta[0], atol=1e-6
    )


@pytest.mark.parametrize("selected", ["IK-index", "wrist", "index1"])
def test_a_pose_applies_to_the_whole_hand_whatever_is_selected_and_with_ik_on(hand, model, actions, selected):
    suffix = "." + model.side[0].upper()
    bpy.ops.object.mode_set(mode="POSE")
    for finger in ("index", "thumb"):
        hand[f"{finger}.ik"] = 1.0
    hand.pose.bones["IK-index" + suffix].location = (0.01, 0.02, 0.0)
    select_bones(hand, {selected + suffix})
    before = prepare_for_pose(bpy.context, RiggedHand.of(hand), keeps_fingers=False)
    hand.pose.apply_pose_from_action(actions["Fist"], evaluation_time=1)
    hand.update_tag()
    theta = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
    np.testing.assert_allclose(theta, theta_for("Fist", model.side), atol=2e-5)
    assert before == {selected + suffix}
    assert hand["index.ik"] == hand["thumb.ik"] == 0


def test_preparing_for_a_blend_keeps_the_visible_pose_and_selected_fingers(hand, model):
    suffix = "." + model.side[0].upper()
    bpy.ops.object.mode_set(mode="POSE")
    write_slider(hand, "index.ik", 1.0)
    hand.pose.bones["IK-index" + suffix].location = (0.01, 0.02, 0.0)
    hand.update_tag()
    before = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta
    select_bones(hand, {"index1" + suffix})
    prepare_for_pose(bpy.context, RiggedHand.of(hand), keeps_fingers=True)
    assert selected_bones(hand) == {"index1" + suffix}
    np.testing.assert_allclose(read_hand_pose(hand, bpy.context.evaluated_depsgraph_get()).theta, before, atol=1e-4)
    select_bones(hand, {"IK-index" + suffix})
    prepare_for_pose(bpy.context, RiggedHand.of(hand), keeps_fingers=True)
    assert selected_bones(hand) == set()


def test_every_pose_is_an_asset_with_a_catalog_tags_and_a_preview(actions):
    lines = (library_folder() / "blender_assets.cats.txt").read_text().splitlines()[2:]
    catalogs = {identity: path for identity, path, _ in (line.split(":") for line in lines)}
    pictures = []
    for name, action in actions.items():
        asset = action.asset_data
        assert catalogs[asset.catalog_id] == f"LiveHand/{POSES[name].catalog}"
        assert asset.description == POSES[name].description
        assert {"hand", *POSES[name].tags} <= set(asset.tags.keys())
        assert tuple(action.preview.image_size) == (128, 128)
        pictures.append(np.array(action.preview.image_pixels_float).reshape(128, 128, 4))
    drawn = np.abs(np.array(pictures)[..., :3] - np.array(pictures)[:, :1, :1, :3]).max(-1) > 0.05
    shares = drawn.mean((1, 2))
    assert shares.min() > 0.18  # the hand; with the whole arm in the picture it was 0.14
    assert shares.max() < 0.7
    assert drawn[:, 0].any(-1).all()  # bottom row first: the arm leaves the picture


@pytest.mark.skipif(bpy.app.version < (4, 4), reason="the script needs slotted actions")
def test_the_script_makes_the_same_poses(actions, monkeypatch):
    """Without the previews, which take seconds."""
    from livehand.backend.hand.model_file import load_default_hand
    from livehand.livehand_blender.rig.build import add_hand

    monkeypatch.syspath_prepend(SCRIPT.parent)
    script = runpy.run_path(str(SCRIPT))
    hands = [RiggedHand.of(add_hand(bpy.context, load_default_hand().for_side(side))) for side in ("right", "left")]
    for name in ("Fist", "Palmar Pinch"):
        saved, made = (keys(action) for action in (actions[name], script["pose_action"]("new", hands, POSES[name])))
        assert saved.keys() == made.keys()
        assert max(abs(saved[path] - made[path]) for path in saved) < 1e-6
    assert script["catalogs"]() == (library_folder() / "blender_assets.cats.txt").read_text()


def keys(action):
    curves = action.fcurves if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0].fcurves
    return {(curve.data_path, curve.array_index): curve.evaluate(1) for curve in curves}


def test_the_library_is_added_once_and_only_by_the_operator():
    libraries = bpy.context.preferences.filepaths.asset_libraries
    before = [library.path for library in libraries]
    assert str(library_folder()) not in before
    try:
        assert bpy.ops.livehand.add_pose_library() == {"FINISHED"}
        (added,) = [library for library in libraries if library.path == str(library_folder())]
        assert added.name == LIBRARY_NAME
        assert not bpy.ops.livehand.add_pose_library.poll()
    finally:
        libraries.remove(libraries[LIBRARY_NAME])
    assert [library.path for library in libraries] == before


def test_the_file_contains_no_local_path():
    zstandard = pytest.importorskip("zstandard")
    with zstandard.open(library_folder() / "poses.blend") as stream:
        data = stream.read()
    assert len(data) > 1e6
    assert b"poses.blend" not in data
    assert str(Path(__file__).parents[2]).encode() not in data
