"""The plan of a capture: poses, cameras and splits by value."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.capture.capture import index_document
from livehand.backend.capture.plan import NEARLY_STRAIGHT_DEG, WRIST_LIMITS_DEG, CapturePlan, sample_forearms
from livehand.backend.hand.lbs import posed_arrays, posed_vertices
from livehand.backend.hand.model import UPRIGHT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose
from scipy.spatial.transform import Rotation

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("relieved_once")]

SMALL = CapturePlan(poses=23, cameras=11, cameras_per_pose=4, size_px=(24, 32), eval_views=5)


@pytest.fixture(scope="session")
def hand(hand_without_arm):
    """A hand without an arm, as MANO's is; `armed` is the one that ships."""
    return hand_without_arm


@pytest.fixture(scope="module")
def made(hand, tmp_path_factory):
    return SMALL.make(tmp_path_factory.mktemp("plan"), hand, {"made_by": "test"})


def test_equal_plans_give_equal_captures_and_another_seed_another_capture(made, hand):
    again = SMALL.make(made.folder, hand, {"made_by": "test"})
    assert index_document(again) == index_document(made)
    for one, other in zip(again.poses, made.poses, strict=True):
        np.testing.assert_array_equal(one.theta, other.theta)
        np.testing.assert_array_equal(one.transl, other.transl)
    other = replace(SMALL, seed=1).make(made.folder, hand, {"made_by": "test"})
    assert index_document(other) != index_document(made)
    assert not np.allclose(other.poses[0].theta, made.poses[0].theta)


def test_held_out_poses_and_cameras_are_never_trained_on(made):
    train = made.of_split("train")
    trained_poses, trained_cameras = ({getattr(v, n) for v in train} for n in ("pose_index", "camera_index"))
    assert trained_poses == {k for k in range(23) if k % 11 != 5}
    assert trained_cameras == {k for k in range(11) if k % 5 != 3}
    for split, is_new_pose, is_new_camera in (
        ("novel_pose", True, False),
        ("novel_camera", False, True),
        ("test", True, True),
    ):
        views = made.of_split(split)
        assert views
        for view in views:
            assert (view.pose_index not in trained_poses) == is_new_pose
            assert (view.camera_index not in trained_cameras) == is_new_camera


def test_the_number_of_views_follows_the_plan(made):
    assert len(made.poses) == 23
    assert len(made.of_split("train")) == 21 * 4
    assert [len(made.of_split(s)) for s in ("novel_pose", "novel_camera", "test")] == [5, 5, 4]
    assert len({view.file for view in made.views}) == len(made.views)
    assert [view.file for view in made.views] == sorted(view.file for view in made.views)


def test_held_out_views_are_spread_over_poses_and_cameras(hand):
    capture = CapturePlan(poses=66).make(Path(), hand, {})
    for split in ("novel_pose", "novel_camera", "test"):
        views = capture.of_split(split)
        assert len(views) == 12
        assert len({view.pose_index for view in views}) >= 6
        assert len({view.camera_index for view in views}) >= 3


def test_the_first_poses_equal_those_of_the_whole_plan(made, hand):
    some = replace(SMALL, first_poses=7).make(made.folder, hand, {})
    assert [view.file for view in some.views] == [view.file for view in made.views if view.pose_index < 7]
    np.testing.assert_array_equal(some.poses[6].theta, made.poses[6].theta)


def test_every_training_camera_is_used_and_poses_differ_in_their_cameras(made):
    visible_to = {}
    for view in made.of_split("train"):
        visible_to.setdefault(view.pose_index, set()).add(view.camera_index)
    assert {len(cameras) for cameras in visible_to.values()} == {4}
    assert set.union(*visible_to.values()) == {k for k in range(11) if k % 5 != 3}
    assert len({tuple(sorted(cameras)) for cameras in visible_to.values()}) > 10


@pytest.mark.parametrize("seed", range(4))
def test_held_out_cameras_lie_within_25_degrees_of_a_training_one(seed, hand):
    plan = CapturePlan(seed=seed, poses=6, cameras_per_pose=20)
    cameras = {view.camera_index: view.camera for view in plan.make(Path(), hand, {}).views}
    assert len(cameras) == plan.cameras
    towards = {index: camera.cam2world[:3, 2] for index, camera in cameras.items()}
    training = np.array([d for index, d in towards.items() if not plan.is_held_out_camera(index)])
    angles_deg = [
        np.rad2deg(np.arccos((training @ d).max())) for index, d in towards.items() if plan.is_held_out_camera(index)
    ]
    assert len(angles_deg) == 5
    assert 10 < min(angles_deg)
    assert max(angles_deg) < 25


def test_hands_stand_upright_at_the_origin(made, hand):
    """Fingers up, on average, in Blender's world; the middle knuckle near the origin."""
    knuckles, up = [], []
    for pose in made.poses:
        _, joints = posed_arrays(hand, pose)
        knuckles.append(joints[4])
        up.append(joints[4] - joints[0])
    assert np.linalg.norm(knuckles, axis=1).max() < 0.03
    up = np.array(up) / np.linalg.norm(up, axis=1, keepdims=True)
    assert up[:, 2].mean() > 0.7
    np.testing.assert_allclose(UPRIGHT @ [-1, 0, 0], [0, 0, 1])  # fingers
    np.testing.assert_allclose(UPRIGHT @ [0, 1, 0], [0, -1, 0])  # back of the hand


def test_cameras_stand_all_around_and_see_the_hand(made, hand):
    cameras = {view.camera_index: view.camera for view in made.views}
    directions = np.array([camera.origin / np.linalg.norm(camera.origin) for camera in cameras.values()])
    assert len(cameras) == 11
    assert np.linalg.norm(directions.mean(0)) < 0.15
    inside = []
    for view in made.views[::9]:
        pixels, depth = view.camera.project(posed_vertices(hand, made.poses[view.pose_index]))
        inside.append(((pixels >= 0) & (pixels < SMALL.size_px)).all(1).mean())
        assert depth.min() > 0.4
    assert min(inside) > 0.25
    assert np.mean(inside) > 0.7


@pytest.fixture(scope="module")
def armed():
    return load_default_hand()


def test_forearms_turn_within_human_limits_and_half_are_nearly_straight():
    turns = sample_forearms(np.random.default_rng(0), 400)
    deviation, flexion, twist = np.rad2deg(Rotation.from_rotvec(turns).as_euler("YZX")).T
    angles = np.stack([-flexion, deviation, twist], 1)
    assert (angles >= WRIST_LIMITS_DEG[:, 0] - 1e-9).all()
    assert (angles <= WRIST_LIMITS_DEG[:, 1] + 1e-9).all()
    assert np.abs(angles[::2]).max(0) == pytest.approx([60, 30, 30], abs=1.0)
    assert np.sqrt((angles[1::2] ** 2).mean(0)) == pytest.approx([NEARLY_STRAIGHT_DEG] * 3, rel=0.2)


def test_a_flexed_wrist_takes_the_arm_to_the_palm_and_an_ulnar_one_to_the_little_finger(armed):
    end = armed.v_template[:, 0].argmax()
    rest = posed_vertices(armed, HandPose.rest())[end]
    turned = [posed_vertices(armed, replace(HandPose.rest(), forearm=turn))[end] for turn in np.diag([0, 0.5, -0.5])]
    assert turned[2][1] < rest[1] - 0.05
    assert turned[1][2] < rest[2] - 0.05


def test_the_same_plan_moves_a_hand_with_an_arm_alike(made, armed):
    capture, stiff = (
        SMALL.make(made.folder, model, {})
        for model in (armed, replace(armed, arm_weights=np.zeros_like(armed.arm_weights)))
    )
    for one, other in zip(capture.poses, stiff.poses, strict=True):
        np.testing.assert_allclose(one.theta, other.theta, atol=1e-9)
        np.testing.assert_allclose(one.transl, other.transl, atol=1e-9)
        assert one.forearm.any()
        assert not other.forearm.any()
    left = SMALL.make(made.folder, armed.for_side("left"), {})
    np.testing.assert_allclose(left.poses[3].forearm, capture.poses[3].mirrored().forearm)


def test_whole_views_show_the_near_half_of_the_arm(made, armed):
    capture = CapturePlan(poses=49, cameras=12, size_px=(334, 512)).make(made.folder, armed, {})
    beyond = armed.v_template[:, 0] - armed.joints[0, 0]
    straight = [index for index in range(49) if index % 2]
    seen = {"near": [], "all": []}
    for view in (view for view in capture.views if view.pose_index in straight):
        pixels, _ = view.camera.project(posed_vertices(armed, capture.poses[view.pose_index]))
        inside = ((pixels >= 0) & (pixels < (334, 512))).all(1)
        seen["near"].append(inside[(beyond > 0) & (beyond < 0.06)].mean())
        seen["all"].append(inside[beyond > 0.1].mean())
    assert np.mean(np.array(seen["near"]) > 0.9) > 0.4  # half of the cameras are close
    assert 0.05 < np.mean(np.array(seen["all"]) > 0.9) < 0.5
