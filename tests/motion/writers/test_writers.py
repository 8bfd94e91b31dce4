"""Every format that needs no Blender, out and in again by our own readers: angles, positions, times, both sides."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.poses import POSES
from livehand.backend.motion.document import load_document
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.motion.landmarks.landmark_file import read_landmarks
from livehand.backend.motion.mano_basis import ManoBasis
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.spaces import rest_wrists, to_blender, transformed
from livehand.backend.motion.writers.posed_joints import pose_joints
from livehand.backend.motion.writers.registry import WRITERS, choose_writer
from livehand.backend.motion.writers.take import Take, TakenHand, take_of
from livehand.backend.motion.writers.writer import WriteOptions
from livehand.backend.records.errors import LiveHandError

pytestmark = pytest.mark.slow

MOST_DEG, MOST_M = 0.1, 0.001
FPS = 30000 / 1001


def motion(side="right", count=12, seed=0):
    """Gestures in turn, twisted a little, while the wrist turns all the way round and moves."""
    rng = np.random.default_rng(seed)
    axes = FingerAxes.of_default_hand()
    poses = [theta_of(GESTURES[name].angles_deg(), axes) for name in ("fist", "point", "spread", "relaxed")]
    theta = np.array([poses[k * len(poses) // count] for k in range(count)]) + rng.normal(size=(count, 16, 3)) * 0.05
    theta[:, 0] = rng.normal(size=(count, 3)) * 1.5
    beta, transl = rng.normal(size=10) * 0.7, rng.normal(size=(count, 3)) * 0.2
    if side == "left":
        theta, transl = theta * MIRROR_AXIS_ANGLE, transl * MIRROR_POINT
    return HandMotion(theta, beta, transl, FPS, side, rng.normal(size=(count, 3)) * 0.2)


def taken(hand, side="right", **changes):
    return TakenHand(motion(side), hand, **changes)


def written(name, take, folder, **options):
    writer = next(writer for writer in WRITERS if writer.name == name)
    path = folder / f"take{writer.suffixes[0]}"
    return path, writer.write(take, path, WriteOptions(**options))


def in_world(file, model, basis=None):
    """The motion of a pose file in Blender's world."""
    motion = file.motion(basis)
    return transformed(
        motion, to_blender(file.info.space), rest_wrists(model.for_side(motion.side), motion.betas)
    )  # fmt: skip


def apart_deg(a, b):
    """The angle between each joint's rotations."""
    turns = axis_angle_to_matrix(a).swapaxes(-1, -2) @ axis_angle_to_matrix(b)
    sines = np.stack([turns[..., 2, 1] - turns[..., 1, 2], turns[..., 0, 2] - turns[..., 2, 0]], -1)
    sines = np.concatenate([sines, (turns[..., 1, 0] - turns[..., 0, 1])[..., None]], -1)
    cosine = np.trace(turns, axis1=-2, axis2=-1) - 1
    return np.rad2deg(np.arctan2(np.linalg.norm(sines, axis=-1), cosine))


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", ["livehand", "mano", "smplx", "openxr", "csv"])
def test_a_motion_comes_back(hand, tmp_path, name, side):
    take = Take((taken(hand, side),), FPS)
    path, _ = written(name, take, tmp_path)
    file = open_motion_file(path)
    back, sent = in_world(file, hand), take.hands[0].motion
    assert (back.side, len(back), file.info.first) == (side, len(sent), 0)
    assert back.fps == pytest.approx(FPS, rel=1e-12)
    assert apart_deg(back.theta, sent.theta).max() < MOST_DEG
    if name != "smplx":
        np.testing.assert_allclose(back.beta, sent.beta, atol=1e-9)
        np.testing.assert_allclose(back.transl, sent.transl, atol=MOST_M)
    if name in ("livehand", "csv"):
        assert apart_deg(back.forearms, sent.forearms).max() < MOST_DEG


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_angles_of_exact_landmarks_come_back(hand, tmp_path, side):
    """Of any shape, and what points tell: fingers that bend and spread, the thumb's base that twists."""
    axes, mirror = FingerAxes.of_default_hand(), 1 if side == "right" else MIRROR_AXIS_ANGLE
    theta = np.array([theta_of(pose.gesture.angles_deg(), axes) for pose in POSES.values()]) * mirror
    theta[:, 0] = np.random.default_rng(1).normal(size=(len(theta), 3))
    sent = HandMotion(theta, np.tile([2.0, -2.0], 5), np.zeros((len(theta), 3)), FPS, side)
    path, _ = written("mediapipe", Take((TakenHand(sent, hand),), FPS), tmp_path)
    file = open_motion_file(path)
    back = file.motion(hand)
    world = transformed(back, to_blender(file.info.space), rest_wrists(hand.for_side(side), back.betas))
    assert apart_deg(world.theta, theta).max() < MOST_DEG


@pytest.mark.parametrize("name", ["smplx", "openxr", "csv"])
def test_two_hands_come_back_and_each_at_its_own_time(hand, tmp_path, name):
    take = take_of([taken(hand, "left", first=5), taken(hand, "right")], FPS)
    assert [one.side for one in take.hands] == ["right", "left"]
    file = open_motion_file(written(name, take, tmp_path)[0])
    for sent in take.hands:
        of_side = file.with_changes(side=sent.side)
        if name == "smplx":  # holds every frame of a body: a hand that is not there yet holds still
            assert len(of_side.motion()) == take.count
            back = of_side.motion().theta[sent.frames]
            assert (of_side.motion().theta[: sent.first] == back[0]).all()
        else:
            assert of_side.info.first == sent.first
            back = of_side.motion().theta
        assert apart_deg(back[:, 1:], sent.motion.theta[:, 1:]).max() < MOST_DEG


def test_angles_that_count_from_manos_mean_come_back(hand, tmp_path):
    rng = np.random.default_rng(3)
    basis = ManoBasis(rng.normal(size=(15, 3)) * 0.3, np.eye(45), "right")
    take = Take((taken(hand, "left"),), FPS)
    path, _ = written("mano", take, tmp_path, counts_from_mean=True, basis=basis)
    with np.load(path) as arrays:
        fingers = take.hands[0].motion.theta[:, 1:] - basis.mean * MIRROR_AXIS_ANGLE
        np.testing.assert_allclose(arrays["poses"][:, 3:], fingers.reshape(-1, 45), atol=1e-12)
        assert not arrays["flat_hand_mean"]
    file = open_motion_file(path)
    assert not file.info.has_mean_added
    assert apart_deg(in_world(file, hand, basis).theta, take.hands[0].motion.theta).max() < MOST_DEG


def test_angles_that_count_from_a_mean_need_one(hand, tmp_path):
    with pytest.raises(LiveHandError, match="hands_mean"):
        written("mano", Take((taken(hand),), FPS), tmp_path, counts_from_mean=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("side", ["right", "left"])
def test_joints_are_where_skinning_has_them(hand, side):
    one = taken(hand, side)
    model = hand.for_side(side)
    posed = pose_joints(one.motion, model)
    for index in (0, 7):
        joints = posed_arrays(model, one.motion.pose(index))[1]
        ours = posed.nodes[index, [0, *(4 * finger + k for finger in range(5) for k in (1, 2, 3))]]
        np.testing.assert_allclose(ours, joints, atol=1e-6)


def test_a_hand_of_another_size_grows_about_its_wrist(hand):
    one = taken(hand)
    small, large = (pose_joints(one.motion, hand, scale).nodes for scale in (1.0, 1.3))
    np.testing.assert_allclose(large[:, 0], small[:, 0])
    np.testing.assert_allclose(large - large[:, :1], 1.3 * (small - small[:, :1]), atol=1e-12)


@pytest.mark.parametrize("name", ["openxr", "mediapipe"])
def test_the_positions_are_read_as_any_trackers(hand, tmp_path, name):
    """By the reader of landmarks, which knows nothing of ours: the joints' positions, sides and times."""
    take = take_of([taken(hand, "left", scale=1.1), taken(hand, "right", first=2)], FPS)
    path, _ = written(name, take, tmp_path)
    file = read_landmarks(load_document(path))
    assert file.info.fps == pytest.approx(FPS)
    for sent in take.hands:
        read = file.with_changes(side=sent.side)
        assert read.info.first == sent.first
        axes = to_blender(read.info.space)[:3, :3]
        wanted = pose_joints(sent.motion, sent.own_model, sent.scale).landmarks
        np.testing.assert_allclose(read.points @ axes.T, wanted, atol=1e-6)


def test_openxr_joints_point_along_their_bones_and_up_from_the_back(hand, tmp_path):
    still = HandMotion(np.zeros((1, 16, 3)), np.zeros(10), np.zeros((1, 3)), 30.0, "left")
    path, _ = written("openxr", Take((TakenHand(still, hand),), 30.0), tmp_path)
    joints = json.loads(path.read_text())["hands"]["left"]["rest"]
    assert len(joints) == 26
    positions = {name: np.array(joint["position"]) for name, joint in joints.items()}
    for finger in ("INDEX", "MIDDLE", "RING", "LITTLE"):
        name, ahead = (f"XR_HAND_JOINT_{finger}_{part}_EXT" for part in ("PROXIMAL", "INTERMEDIATE"))
        x, y, z, w = joints[name]["orientation"]
        turn = axis_angle_to_matrix(2 * np.arccos(w) * np.array([x, y, z]) / np.sin(np.arccos(w)))
        along = positions[ahead] - positions[name]
        assert -turn[:, 2] @ along / np.linalg.norm(along) > 0.99
        assert turn[1, 1] > 0.8  # the template's back of the hand is +Y


def test_what_a_format_cannot_hold_is_told(hand, tmp_path):
    one = taken(hand, scale=1.2)
    losses = written("mano", Take((one,), FPS), tmp_path)[1]
    assert "1.2 times" in losses[0]
    assert "forearm" in losses[1]
    assert "place" in written("smplx", Take((one,), FPS), tmp_path)[1][0]
    assert written("mano", Take((taken(hand),), FPS), tmp_path)[1][0].startswith("the forearm")


@pytest.mark.parametrize("name", ["livehand", "mano"])
def test_a_file_of_one_hand_refuses_two(hand, tmp_path, name):
    with pytest.raises(LiveHandError, match="holds one hand, got right and left"):
        written(name, take_of([taken(hand), taken(hand, "left")], FPS), tmp_path)


def test_a_take_has_each_hand_once(hand):
    with pytest.raises(LiveHandError, match="got right and right"):
        Take((taken(hand), taken(hand)), FPS)
    with pytest.raises(LiveHandError, match="got none"):
        Take((), FPS)


@pytest.mark.parametrize(
    ("file", "name", "found"),
    [
        ("a.npz", None, "livehand"),
        ("a.NPZ", "mano", "mano"),
        ("a.json", None, "openxr"),
        ("a.json", "mediapipe", "mediapipe"),
        ("a.csv", None, "csv"),
        ("a.bvh", None, "bvh"),
    ],
)
def test_a_name_means_a_format(tmp_path, file, name, found):
    assert choose_writer(tmp_path / file, name).name == found


@pytest.mark.parametrize(
    ("file", "name", "message"),
    [
        ("a.txt", None, r"one of \.npz, \.json, \.csv, \.bvh, got 'a\.txt'"),
        ("a", None, "got 'a'"),
        ("a.json", "mano", r"MANO must end in \.npz"),
        ("a.json", "vrm", "one of livehand, mano, .*, got 'vrm'"),
    ],
)
def test_another_name_is_refused(tmp_path, file, name, message):
    with pytest.raises(LiveHandError, match=message):
        choose_writer(tmp_path / file, name)


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("openxr", lambda text: text.replace('"orientation"', '"turn"', 30), "must have XR_HAND_JOINT_WRIST_EXT"),
        ("openxr", lambda text: text.replace('"rest"', '"nothing"'), "must have a rest pose"),
        ("csv", lambda text: text.replace(",right,", ",both,", 1), "right or left in every row, got 'both'"),
        ("csv", lambda text: text.replace("\n2,", "\n1,"), "frames of the right hand must increase"),
    ],
)
def test_a_damaged_file_is_refused(hand, tmp_path, name, damage, message):
    path, _ = written(name, Take((taken(hand),), FPS), tmp_path)
    path.write_text(damage(path.read_text()))
    with pytest.raises(LiveHandError, match=message):
        open_motion_file(path)


def test_a_held_hand_stands_still_outside_its_frames(hand):
    one = taken(hand, first=3)
    held = one.held(20)
    assert len(held.motion) == 20
    assert (held.motion.theta[:4] == one.motion.theta[0]).all()
    assert (held.motion.transl[15:] == one.motion.transl[-1]).all()
    assert (held.motion.theta[3:15] == one.motion.theta).all()
    shaped = replace(one, motion=replace(one.motion, beta=np.tile(one.motion.beta, (12, 1))))
    assert shaped.held(20).motion.beta.shape == (20, 10)
