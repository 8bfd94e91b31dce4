"""Others' pose files, written by hand with known answers; the mean, the components and the left hand are the traps.

MANO's own mean and components are never at hand: a made-up mean, and made-up orthogonal components, stand for them.
"""

import json
import os
import pickle
import re

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.motion.files.open_files import open_motion_file, open_pose_file, open_pose_files
from livehand.backend.motion.files.summary import file_summary
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.gate import bends_backwards
from livehand.backend.motion.mano_basis import ManoBasis, load_mano_basis
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.errors import LiveHandError
from scipy.spatial.transform import Rotation

RNG = np.random.default_rng(5)
MIRROR = np.array([1, -1, -1])
MEAN = RNG.normal(size=(15, 3)) * 0.3
COMPONENTS = np.linalg.qr(RNG.normal(size=(45, 45)))[0] * np.linspace(1.3, 0.04, 45)[:, None]
BASIS = ManoBasis(MEAN, COMPONENTS, "right")
T = 4
POSE = RNG.normal(size=(T, 48)) * 0.4
BETA = RNG.normal(size=10)
TRANS = RNG.normal(size=(T, 3))


def absolute(pose, mean=0.0):
    theta = pose.reshape(-1, 16, 3).copy()
    theta[:, 1:] += mean
    return theta


def same_turns(theta, expected, atol=1e-7):
    np.testing.assert_allclose(axis_angle_to_matrix(theta), axis_angle_to_matrix(expected), atol=atol)


def opened(path, **expected):
    file = open_pose_file(path)
    for name, value in expected.items():
        assert getattr(file.info, name) == value, name
    return file


# Our own.


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"fps": None, "side": "left"},
        {"beta": np.random.default_rng(0).normal(size=(T, 10))},
        {"forearm": np.random.default_rng(1).normal(size=(T, 3))},
        {"forearm": np.array([0.1, -0.2, 0.3])},
    ],
)
def test_own_format_round_trip(tmp_path, changes):
    motion = HandMotion(**{"theta": absolute(POSE), "beta": BETA, "transl": TRANS, "fps": 23.976, **changes})
    write_motion(motion, tmp_path / "wave.npz")
    again = opened(tmp_path / "wave.npz", format="LiveHand", space="hand", has_mean_added=True).motion()
    for name in ("theta", "beta", "transl", "forearm"):
        np.testing.assert_allclose(getattr(again, name), getattr(motion, name), atol=1e-12)
    with np.load(tmp_path / "wave.npz") as file:
        assert ("forearm" in file) == ("forearm" in changes)
    assert (again.fps, again.side) == (motion.fps, motion.side)
    assert [path.name for path in tmp_path.iterdir()] == ["wave.npz"]


def test_a_motion_is_written_as_npz_and_its_folder_made(tmp_path):
    motion = HandMotion(absolute(POSE), BETA, TRANS)
    with pytest.raises(LiveHandError, match=r"\.npz file, got wave\.json"):
        write_motion(motion, tmp_path / "wave.json")
    write_motion(motion, tmp_path / "new" / "wave.npz")
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["wave.npz"]


def test_a_forearm_is_read_from_json_and_checked(tmp_path):
    path = tmp_path / "wave.json"
    entries = {"theta": absolute(POSE).tolist(), "forearm": [0.1, 0.2, 0.3]}
    path.write_text(json.dumps(entries))
    np.testing.assert_array_equal(open_pose_file(path).motion().forearm, entries["forearm"])
    path.write_text(json.dumps(entries | {"forearm": [0.1, 0.2]}))
    with pytest.raises(LiveHandError, match=r"forearm must be \['?3'?\] or"):
        open_pose_file(path)


def test_files_of_one_frame_each_keep_their_forearms(tmp_path):
    poses, forearms = absolute(POSE), np.array([[0.1, 0, 0], [0, 0.2, 0]])
    for number, forearm in enumerate(forearms):
        write_motion(
            HandMotion(poses[number : number + 1], BETA, TRANS[:1], forearm=forearm), tmp_path / f"{number}.npz"
        )
    np.testing.assert_array_equal(open_pose_files(sorted(tmp_path.iterdir())).motion().forearm, forearms)


# Bodies.


def test_amass_hands_are_absolute_and_wrists_turn_with_the_body(tmp_path):
    poses = RNG.normal(size=(T, 156)) * 0.3
    poses[:, :3] = [np.pi / 2, 0, 0]  # upright along Z
    np.savez(
        tmp_path / "a.npz", poses=poses, trans=TRANS, betas=np.zeros(16), gender="male", mocap_framerate=np.array(120.0)
    )
    file = opened(tmp_path / "a.npz", format="AMASS SMPL-H", has_mean_added=True, space="z_up", fps=120.0, side="right")
    assert file.sides == ("right", "left")
    for side, start, chain in (
        ("right", 111, (0, 3, 6, 9, 14, 17, 19, 21)),
        ("left", 66, (0, 3, 6, 9, 13, 16, 18, 20)),
    ):
        motion = file.with_changes(side=side).motion()
        np.testing.assert_array_equal(motion.theta[:, 1:], poses[:, start : start + 45].reshape(T, 15, 3))
        for t in range(T):
            turn = np.eye(3)
            for joint in chain:
                turn = turn @ axis_angle_to_matrix(poses[t, 3 * joint : 3 * joint + 3])
            np.testing.assert_allclose(axis_angle_to_matrix(motion.theta[t, 0]), turn, atol=1e-9)
        assert not motion.transl.any()
        assert not motion.beta.any()
        assert motion.side == side


def test_smplx_by_its_own_names_and_arctics(tmp_path):
    content = {
        "global_orient": np.zeros((T, 3)),
        "body_pose": np.zeros((T, 63)),
        "left_hand_pose": POSE[:, 3:],
        "right_hand_pose": -POSE[:, 3:],
        "transl": TRANS,
    }
    np.savez(tmp_path / "x.npz", **content)
    np.save(tmp_path / "s01.smplx.npy", content, allow_pickle=True)
    for name, format, fps in (("x.npz", "SMPL-X", None), ("s01.smplx.npy", "ARCTIC SMPL-X", 30.0)):
        file = opened(tmp_path / name, format=format, has_mean_added=True, fps=fps)
        np.testing.assert_allclose(file.motion().theta[:, 1:].reshape(T, 45), -POSE[:, 3:])
        np.testing.assert_allclose(file.with_changes(side="left").motion().theta[:, 1:].reshape(T, 45), POSE[:, 3:])


def test_smplx_with_few_components_counts_from_the_mean(tmp_path):
    coefficients = RNG.normal(size=(T, 12))
    np.savez(
        tmp_path / "x.npz",
        global_orient=np.zeros((T, 3)),
        body_pose=np.zeros((T, 63)),
        left_hand_pose=coefficients,
        right_hand_pose=coefficients,
    )
    file = opened(tmp_path / "x.npz", pca_components=12, has_mean_added=False)
    right = file.motion(BASIS).theta[:, 1:]
    np.testing.assert_allclose(right, (coefficients @ COMPONENTS[:12]).reshape(T, 15, 3) + MEAN)
    # MANO's left mean and components are the right ones mirrored, so equal coefficients are mirror images.
    np.testing.assert_allclose(file.with_changes(side="left").motion(BASIS).theta[:, 1:], right * MIRROR)
    np.testing.assert_allclose(file.motion(BASIS.for_side("left")).theta[:, 1:], right)
    with pytest.raises(LiveHandError, match=r"hands_mean and hands_components, got no MANO file.*MANO_RIGHT"):
        file.motion()
    with pytest.raises(LiveHandError, match="pca_components must be one of 12"):
        file.with_changes(pca_components=45)


def body(tmp_path, name, up, **more):
    """A body that stands along the direction up [3]."""
    poses = np.zeros((T, 165))
    poses[:, :3] = Rotation.align_vectors([up], [[0.0, 1, 0]])[0].as_rotvec()
    np.savez(tmp_path / name, poses=poses, mocap_frame_rate=30, **more)
    return tmp_path / name


@pytest.mark.parametrize(("up", "space"), [((0, 0, 1), "z_up"), ((0, 1, 0), "y_up"), ((0, -1, 0), "opencv")])
def test_a_bodys_own_axis_tells_which_is_up(tmp_path, up, space):
    up = np.add(up, [0.3, 0.2, 0.3])
    opened(body(tmp_path, "a.npz", up / np.linalg.norm(up)), space=space, format="AMASS SMPL-X")
    root = Rotation.align_vectors([up], [[0.0, 1, 0]])[0].as_rotvec()
    np.savez(tmp_path / "x.npz", global_orient=[root], body_pose=np.zeros((1, 21, 3)), left_hand_pose=np.zeros((1, 45)))
    opened(tmp_path / "x.npz", space=space)


def test_a_body_that_lies_does_not_tell_which_axis_is_up(tmp_path):
    file = opened(body(tmp_path, "a.npz", (1.0, 0, 0)), space="z_up")
    assert "does not stand: check the axes" in " ".join(file.info.notes)


def test_beat2_counts_from_the_mean(tmp_path):
    path = body(tmp_path, "b.npz", (0, 1.0, 0), expressions=np.zeros((T, 100)), model="smplx2020")
    file = opened(path, format="BEAT2 SMPL-X", has_mean_added=False, space="y_up")
    np.testing.assert_allclose(file.motion(BASIS).theta[:, 1:], np.tile(MEAN, (T, 1, 1)))


def test_amass_with_objects_and_in_parts(tmp_path):
    """Objects beside the poses stay unread, even such as would run code."""

    class Harm:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "made"),)

    path = body(tmp_path, "a_stageii.npz", (0, 0, 1.0), markers_latent_vids=np.array(Harm(), object))
    whole = opened(path, format="AMASS SMPL-X", space="z_up").motion()
    assert not (tmp_path / "made").exists()
    with np.load(path, allow_pickle=False) as arrays:
        poses = arrays["poses"]
    parts = {"root_orient": poses[:, :3], "pose_body": poses[:, 3:66], "pose_hand": POSE[:, 3:].repeat(2, 1)}
    np.savez(tmp_path / "parts.npz", **parts)
    motion = opened(tmp_path / "parts.npz", space="z_up").motion()
    np.testing.assert_allclose(motion.theta[:, 0], whole.theta[:, 0], atol=1e-9)
    np.testing.assert_array_equal(motion.theta[:, 1:].reshape(T, 45), POSE[:, 3:].repeat(2, 1)[:, 45:])


def test_grabs_dictionaries_are_read_as_plain_pickles(tmp_path):
    hand = {
        "params": {"global_orient": POSE[:, :3], "fullpose": POSE[:, 3:], "hand_pose": POSE[:, :24], "transl": TRANS}
    }
    content = {"rhand": np.array(hand, object), "object": np.array({"mesh": "cup.ply"}, object), "framerate": 120.0}
    np.savez(tmp_path / "cup_lift.npz", **content)
    file = opened(tmp_path / "cup_lift.npz", format="GRAB", fps=120.0, space="z_up", has_mean_added=True)
    np.testing.assert_allclose(file.motion().theta, absolute(POSE))
    np.testing.assert_allclose(file.motion().transl, TRANS)
    del hand["params"]["fullpose"]
    np.savez(tmp_path / "cup_lift.npz", rhand=np.array(hand, object))
    assert opened(tmp_path / "cup_lift.npz", pca_components=24).motion(BASIS).theta.shape == (T, 16, 3)
    np.savez(tmp_path / "cup_lift.npz", rhand=np.array({"vtemp": "hand.ply"}, object))
    with pytest.raises(LiveHandError, match="rhand must hold params with global_orient"):
        open_pose_file(tmp_path / "cup_lift.npz")


def test_frames_begin_where_the_first_file_does_and_missing_files_are_gaps(tmp_path):
    for number in (0, 5, 10, 20, 25):
        np.savez(tmp_path / f"labels_{number:06d}.npz", pose_m=np.ones((1, 51)) * (number > 0))
    opened(tmp_path, first=1, frames=5, missing=1)


# Data sets of hands.


def test_arctic_mano_counts_from_the_mean_of_its_side(tmp_path):
    hand = {"rot": POSE[:, :3], "pose": POSE[:, 3:], "trans": TRANS, "shape": BETA, "fitting_err": [0.1] * T}
    np.save(tmp_path / "box.mano.npy", {"right": hand, "left": hand}, allow_pickle=True)
    file = opened(tmp_path / "box.mano.npy", format="ARCTIC MANO", has_mean_added=False, fps=30.0)
    np.testing.assert_allclose(file.motion(BASIS).theta, absolute(POSE, MEAN))
    left = file.with_changes(side="left").motion(BASIS)
    np.testing.assert_allclose(left.theta, absolute(POSE, MEAN * MIRROR))
    np.testing.assert_allclose(left.transl, TRANS)
    np.testing.assert_allclose(left.beta, BETA)


def test_neural_annot_counts_from_the_mean_and_bridges_frames_without_the_hand(tmp_path):
    def fit(k):
        return {"pose": POSE[k].tolist(), "shape": BETA.tolist(), "trans": TRANS[k].tolist()}

    frames = {
        "30": {"right": fit(2), "left": None},
        "10": {"right": fit(0), "left": fit(3)},
        "20": {"right": None, "left": fit(1)},
    }
    path = tmp_path / "InterHand2.6M_test_MANO_NeuralAnnot.json"
    path.write_text(json.dumps({"7": frames, "8": {"1": {"right": None, "left": fit(0)}}}))
    file = opened(path, has_mean_added=False, frames=3, missing=1, side="right")
    right = file.motion(BASIS)
    same_turns(right.theta[[0, 2]], absolute(POSE[[0, 2]], MEAN))
    np.testing.assert_allclose(right.transl, [TRANS[0], (TRANS[0] + TRANS[2]) / 2, TRANS[2]])
    left = file.with_changes(side="left")
    assert (left.info.frames, left.info.missing) == (2, 0)
    same_turns(left.motion(BASIS).theta, absolute(POSE[[3, 1]], MEAN * MIRROR))
    assert open_pose_file(path, capture=8).sides == ("left",)
    with pytest.raises(LiveHandError, match="must hold '9'"):
        open_pose_file(path, capture=9)


def hamer(right, **more):
    turns = axis_angle_to_matrix(absolute(POSE))
    return {
        "pred_mano_params.global_orient": turns[:, :1],
        "pred_mano_params.hand_pose": turns[:, 1:],
        "pred_mano_params.betas": np.tile(BETA, (T, 1)),
        "right": np.array(right),
        **more,
    }


def test_hamer_left_hands_are_mirrored_right_ones(tmp_path):
    np.savez(tmp_path / "right.npz", **hamer([1.0] * T, pred_cam_t=TRANS))
    np.savez(tmp_path / "left.npz", **hamer([0] * T, pred_cam_t=TRANS))
    right = opened(tmp_path / "right.npz", has_mean_added=True, space="opencv", side="right").motion()
    left = opened(tmp_path / "left.npz", side="left").motion()
    same_turns(right.theta, absolute(POSE))
    same_turns(left.theta, absolute(POSE) * MIRROR)
    np.testing.assert_allclose(left.transl, TRANS * [-1, 1, 1])
    np.testing.assert_allclose(left.beta[2], BETA)


def test_hamer_both_hands_in_one_file_and_a_side_that_was_wrong(tmp_path):
    np.savez(tmp_path / "both.npz", **hamer([1, 0, 0, 1]))
    file = opened(tmp_path / "both.npz", has_translation=False)
    same_turns(file.motion().theta, absolute(POSE[[0, 3]]))
    same_turns(file.with_changes(side="left").motion().theta, absolute(POSE[[1, 2]]) * MIRROR)
    np.savez(tmp_path / "one.npz", **hamer([1] * T))
    wrong = open_pose_file(tmp_path / "one.npz").with_changes(side="left").motion()
    same_turns(wrong.theta, absolute(POSE) * MIRROR)


def natural(count=12):
    """Poses [count, 16, 3] of a right hand that closes, its wrist turned."""
    fist, axes = GESTURES["fist"].angles_deg(), FingerAxes.of_default_hand()
    return np.array(
        [theta_of(share * fist, axes, np.array([0.4, 0.3, -0.2])) for share in np.linspace(0.2, 0.9, count)]
    )


@pytest.mark.parametrize("layout", ["matrices", "axis-angle", "45 numbers"])
@pytest.mark.parametrize("is_mirrored_back", [True, False])
def test_a_left_hands_mirroring_is_told_by_its_fingers(tmp_path, layout, is_mirrored_back):
    stored = natural() * (MIRROR if is_mirrored_back else 1)
    turns = axis_angle_to_matrix(stored) if layout == "matrices" else stored
    fingers = stored[:, 1:].reshape(-1, 45) if layout == "45 numbers" else turns[:, 1:]
    transl = RNG.normal(size=(12, 3))
    np.savez(
        tmp_path / "h.npz", hand_pose=fingers, global_orient=turns[:, :1], is_right=np.zeros(12), pred_cam_t=transl
    )
    motion = opened(tmp_path / "h.npz", side="left").motion()
    same_turns(motion.theta, natural() * MIRROR)
    np.testing.assert_allclose(motion.transl, transl if is_mirrored_back else transl * [-1, 1, 1])
    assert not bends_backwards(motion.theta, "left")


@pytest.mark.slow
def test_a_hand_of_no_side_is_that_like_which_its_fingers_bend(tmp_path):
    for side, stored in (("right", natural()), ("left", natural() * MIRROR)):
        np.save(tmp_path / "take.npy", stored.reshape(12, 48))
        same_turns(opened(tmp_path / "take.npy", side=side).motion().theta, stored)
        np.savez(tmp_path / "own.npz", theta=stored)
        same_turns(opened(tmp_path / "own.npz", side=side).motion().theta, stored)
        turns = axis_angle_to_matrix(stored)
        np.savez(tmp_path / "h.npz", hand_pose=turns[:, 1:], global_orient=turns[:, :1])
        same_turns(opened(tmp_path / "h.npz", side=side).motion().theta, stored)
    np.save(tmp_path / "left_take.npy", natural().reshape(12, 48))
    same_turns(opened(tmp_path / "left_take.npy", side="left").motion().theta, natural() * MIRROR)


@pytest.mark.slow
def test_files_of_one_frame_each_are_one_hands(tmp_path):
    """The flat ones among them would be taken for a right hand's."""
    for number, theta in enumerate(np.concatenate([0 * natural(3), natural(9) * MIRROR])):
        np.save(tmp_path / f"{number:03d}.npy", theta.reshape(1, 48))
    file = opened(tmp_path, side="left", frames=12, missing=0)
    assert file.sides == ("left",)


def test_plain_angles_in_degrees_are_told_by_their_size(tmp_path):
    np.save(tmp_path / "take.npy", np.rad2deg(natural()).reshape(12, 48))
    file = opened(tmp_path / "take.npy", side="right")
    same_turns(file.motion().theta, natural())
    assert "read as degrees" in " ".join(file.info.notes)


def wilor_frames(stored, first=0):
    """WiLoR-mini's return value: a list of frames, each a list of hands."""
    hands = [
        {
            "hand_bbox": [0, 0, 9, 9],
            "is_right": 0.0,
            "wilor_preds": {
                "hand_pose": theta[None, 1:].astype(np.float32),
                "global_orient": theta[None, :1].astype(np.float32),
                "betas": np.zeros((1, 10), np.float32),
                "pred_cam_t_full": np.array([[0.0, 0, k]]),
            },
        }
        for k, theta in enumerate(stored)
    ]
    return [[] for _ in range(first)] + [[hand] for hand in hands]


def test_wilor_minis_frames_are_read_and_numbered(tmp_path):
    path = tmp_path / "wilor.pkl"
    frames = wilor_frames(natural() * MIRROR, first=3)
    path.write_bytes(pickle.dumps([*frames[:5], [], *frames[6:]]))
    file = opened(path, side="left", first=3, frames=12, missing=1, has_mean_added=True, space="opencv")
    kept = [0, 1, *range(3, 12)]
    same_turns(file.motion().theta[kept], (natural() * MIRROR)[kept], 1e-5)
    np.testing.assert_allclose(file.motion().transl[:, 2], np.arange(12.0))
    path.write_bytes(pickle.dumps(frames[3]))  # of one picture
    same_turns(opened(path, frames=1).motion().theta, natural()[:1] * MIRROR, 1e-5)


def test_hamer_in_the_whole_camera(tmp_path):
    """A weak-perspective camera by hand: scale 0.5 in a box of 200 px, its centre 30 px right of the image's."""
    boxes = {
        "pred_cam": np.tile([0.5, 0.01, -0.02], (T, 1)),
        "box_center": np.tile([350.0, 240.0], (T, 1)),
        "box_size": np.full(T, 200.0),
        "img_size": np.tile([640.0, 480.0], (T, 1)),
    }
    np.savez(tmp_path / "r.npz", **hamer([1] * T, **boxes))
    depth = 2 * (5000 / 256 * 640) / (200 * 0.5)
    transl = open_pose_file(tmp_path / "r.npz").motion().transl
    np.testing.assert_allclose(transl, np.tile([0.01 + 2 * 30 / 100, -0.02, depth], (T, 1)))
    np.savez(tmp_path / "l.npz", **hamer([0] * T, **boxes))
    np.testing.assert_allclose(open_pose_file(tmp_path / "l.npz").motion().transl[:, 0], -0.01 + 0.6)


def test_hamer_in_a_pickle_of_plain_arrays(tmp_path):
    content = hamer([1] * T)
    nested = {"pred_mano_params": {k.partition(".")[2]: v for k, v in content.items() if "." in k}, "right": [1.0] * T}
    for protocol in range(6):
        (tmp_path / "h.pkl").write_bytes(pickle.dumps(nested, protocol=protocol))
        same_turns(open_pose_file(tmp_path / "h.pkl").motion().theta, absolute(POSE))


def test_hamer_refuses_what_does_not_turn(tmp_path):
    content = hamer([1] * T)
    content["pred_mano_params.hand_pose"] = content["pred_mano_params.hand_pose"] * 1.1
    np.savez(tmp_path / "h.npz", **content)
    with pytest.raises(LiveHandError, match=r"rotation matrices, got ones off by 0\.2"):
        open_pose_file(tmp_path / "h.npz")


def test_dexycb_labels_are_components_from_the_mean_and_zeros_are_gaps(tmp_path):
    coefficients = RNG.normal(size=(T, 45))
    for k in range(T):
        numbers = np.concatenate([POSE[k, :3], coefficients[k], TRANS[k]])[None] * (k != 1)
        np.savez(tmp_path / f"labels_{k:06d}.npz", pose_m=numbers.astype(np.float32), joint_3d=np.zeros((1, 21, 3)))
    file = opened(tmp_path, format="DexYCB", pca_components=45, has_mean_added=False, frames=T, missing=1)
    motion = file.motion(BASIS)
    expected = (coefficients @ COMPONENTS).reshape(T, 15, 3) + MEAN
    kept = [0, 2, 3]
    same_turns(motion.theta[kept, 1:], expected[kept], 1e-5)
    same_turns(motion.theta[kept, 0], POSE[kept, :3], 1e-5)
    np.testing.assert_allclose(motion.transl[kept], TRANS[kept], atol=1e-6)
    left = file.with_changes(side="left").motion(BASIS)
    same_turns(left.theta[kept, 1:], expected[kept] * MIRROR, 1e-5)
    stacked = np.concatenate([POSE[:, :3], coefficients, TRANS], 1) * [[1], [0], [1], [1]]
    np.savez(tmp_path / "all.npz", pose_m=stacked)
    whole = opened(tmp_path / "all.npz", frames=T, missing=1).motion(BASIS)
    same_turns(whole.theta, motion.theta, 1e-5)
    with pytest.raises(LiveHandError, match="a frame without one"):
        open_pose_file(tmp_path / "labels_000001.npz")


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_ho3d_is_absolute_in_opengl_axes(tmp_path, protocol):
    for k in range(T):
        meta = {"handPose": POSE[k], "handTrans": TRANS[k], "handBeta": BETA, "camMat": np.eye(3), "objName": "can"}
        (tmp_path / f"{k:04d}.pkl").write_bytes(pickle.dumps(meta, protocol=protocol))
    lacking = {"handPose": None, "handJoints3D": np.zeros(3), "camMat": np.eye(3)}
    (tmp_path / "0004.pkl").write_bytes(pickle.dumps(lacking, protocol=protocol))
    file = opened(tmp_path, format="HO-3D", space="opengl", has_mean_added=True, frames=T)
    np.testing.assert_allclose(file.motion().theta, absolute(POSE))
    np.testing.assert_allclose(file.motion().transl, TRANS)
    np.testing.assert_allclose(file.motion().beta, BETA)


def test_freihand_counts_from_the_mean_and_has_no_place(tmp_path):
    rows = np.concatenate([POSE, np.tile(BETA, (T, 1)), TRANS], 1)[:, None].tolist()
    (tmp_path / "training_mano.json").write_text(json.dumps(rows))
    motion = opened(tmp_path / "training_mano.json", format="FreiHAND", has_mean_added=False).motion(BASIS)
    np.testing.assert_allclose(motion.theta, absolute(POSE, MEAN))
    np.testing.assert_allclose(motion.beta[1], BETA)
    assert not motion.transl.any()
    opened(tmp_path / "training_mano.json", has_translation=False)


# Bare numbers.


@pytest.mark.parametrize("width", [48, 51, 61])
@pytest.mark.parametrize("suffix", ["npz", "json", "npy"])
def test_raw_numbers(tmp_path, width, suffix):
    columns = {48: [POSE], 51: [POSE, TRANS], 61: [POSE, np.tile(BETA, (T, 1)), TRANS]}[width]
    numbers, path = np.concatenate(columns, 1), tmp_path / f"take.{suffix}"
    if suffix == "npz":
        np.savez(path, poses=numbers, fps=25)
    elif suffix == "npy":
        np.save(path, numbers)
    else:
        path.write_text(json.dumps(numbers.tolist()))
    file = opened(path, format="Raw MANO", has_mean_added=True, fps=25.0 if suffix == "npz" else None)
    assert file.info.has_translation == (width > 48)
    motion = file.motion()
    np.testing.assert_allclose(motion.theta, absolute(POSE))
    np.testing.assert_allclose(motion.transl, TRANS if width > 48 else np.zeros((T, 3)))
    if width == 61:
        np.testing.assert_allclose(motion.beta[0], BETA)


def test_a_reading_is_turned_round_without_the_file(tmp_path):
    path = tmp_path / "take.npz"
    np.savez(path, poses=np.concatenate([POSE, TRANS], 1))
    file = open_pose_file(path)
    path.unlink()
    np.testing.assert_allclose(file.with_changes(has_mean_added=False).motion(BASIS).theta, absolute(POSE, MEAN))
    left = file.with_changes(has_mean_added=False, side="left", unit="mm", fps=12.0)
    np.testing.assert_allclose(left.motion(BASIS).theta, absolute(POSE, MEAN * MIRROR))
    np.testing.assert_allclose(left.motion(BASIS).transl, TRANS / 1000)
    assert (left.motion(BASIS).side, left.motion(BASIS).fps) == ("left", 12.0)
    components = file.with_changes(pca_components=45, has_mean_added=True).motion(BASIS).theta
    np.testing.assert_allclose(components[:, 1:], (POSE[:, 3:] @ COMPONENTS).reshape(T, 15, 3))
    same = file.with_changes(has_mean_added=False).with_changes(has_mean_added=True)
    np.testing.assert_array_equal(same.motion().theta, file.motion().theta)
    for change in ({"side": "both"}, {"space": "w_up"}, {"unit": "ft"}):
        with pytest.raises(LiveHandError, match=f"{next(iter(change))} must be one of"):
            file.with_changes(**change)


def test_a_doubtful_mean_gives_a_warning(tmp_path):
    flat = np.concatenate([np.zeros((20, 3)), RNG.normal(size=(20, 45)) * 0.1], 1)
    np.savez(tmp_path / "take.npz", poses=flat)
    file = open_pose_file(tmp_path / "take.npz")
    assert "may count from MANO's mean" in file.warning()
    relative = file.with_changes(has_mean_added=False)
    assert relative.warning(BASIS) is None
    np.savez(tmp_path / "take.npz", poses=flat + np.r_[np.zeros(3), MEAN.ravel()])
    file = open_pose_file(tmp_path / "take.npz")
    assert file.warning(BASIS) is None
    assert "may be absolute already" in file.with_changes(has_mean_added=False).warning(BASIS)


def test_mean_and_components_come_from_the_users_file(hand, tmp_path):
    model = hand
    arrays = {"v_template": model.v_template, "hands_mean": MEAN.ravel(), "hands_components": COMPONENTS}
    np.savez(tmp_path / "MANO_LEFT.npz", **arrays)
    basis = load_mano_basis(tmp_path / "MANO_LEFT.npz")
    assert basis.side == "left"
    np.testing.assert_array_equal(basis.for_side("right").mean, MEAN * MIRROR)
    np.savez(tmp_path / "short.npz", hands_mean=MEAN, hands_components=COMPONENTS[:6])
    with pytest.raises(LiveHandError, match="hands_components must be 2025 finite numbers"):
        load_mano_basis(tmp_path / "short.npz")


def test_files_of_a_take_must_be_alike(tmp_path):
    np.savez(tmp_path / "a.npz", poses=POSE)
    np.savez(tmp_path / "b.npz", pose_m=np.ones((1, 51)))
    with pytest.raises(LiveHandError, match="of one format, got DexYCB, Raw MANO"):
        open_pose_files([tmp_path / "a.npz", tmp_path / "b.npz"])
    joined = open_pose_files([tmp_path / "a.npz", tmp_path / "a.npz"])
    np.testing.assert_array_equal(joined.motion().theta, absolute(np.concatenate([POSE, POSE])))


def test_a_reading_in_words(tmp_path):
    np.savez(tmp_path / "labels_0.npz", pose_m=np.ones((1, 51)))
    facts = file_summary(open_motion_file(tmp_path / "labels_0.npz"))
    assert facts["format"] == "DexYCB"
    assert facts["mean"] == "to be added (needs a MANO file)"
    assert facts["angles"] == "45 components (needs a MANO file)"
    assert facts["axes"] == "camera, y down, z forward"
    assert facts["place"] == "in the file"


# HOT3D, and files that come with poses but hold none.


def test_hot3ds_trajectories_are_components_with_times(tmp_path):
    def hand(k):
        quaternion = Rotation.from_rotvec(POSE[k, :3]).as_quat()[[3, 0, 1, 2]]
        wrist = {"q_wxyz": quaternion.tolist(), "t_xyz": TRANS[k].tolist()}
        return {"pose": POSE[k, 3:18].tolist(), "wrist_xform": wrist, "betas": BETA.tolist()}

    times = [0, 33_333_333, 66_666_666, 133_333_333]
    poses = [{}, {"1": hand(1)}, {"1": hand(2), "0": hand(0)}, {"1": hand(3)}]
    lines = [{"timestamp_ns": t, "hand_poses": each} for t, each in zip(times, poses, strict=True)]
    path = tmp_path / "mano_hand_pose_trajectory.jsonl"
    path.write_text("\n".join(map(json.dumps, lines)))
    file = opened(path, format="HOT3D", has_mean_added=False, pca_components=15, first=1, frames=4, missing=1)
    assert file.info.fps == pytest.approx(30, abs=1e-3)
    motion = file.motion(BASIS)
    expected = (POSE[1:, 3:18] @ COMPONENTS[:15]).reshape(3, 15, 3) + MEAN
    same_turns(motion.theta[[0, 1, 3], 1:], expected)
    same_turns(motion.theta[[0, 1, 3], 0], POSE[1:, :3])
    np.testing.assert_allclose(motion.transl[[0, 1, 3]], TRANS[1:])
    assert file.with_changes(side="left").info.first == 2
    path.write_text(json.dumps({"timestamp_ns": 0, "hand_poses": {"0": {"joint_angles": [0.0] * 22}}}))
    with pytest.raises(LiveHandError, match=r"UmeTrack's joint angles .* mano_hand_pose_trajectory\.jsonl"):
        open_pose_file(path)


def test_hot3ds_clips_are_files_of_one_frame(tmp_path):
    for k in range(T):
        pose = {"thetas": POSE[k, 3:18].tolist(), "wrist_xform": [*POSE[k, :3], *TRANS[k]]}
        content = {"right": {"mano_pose": pose, "boxes": {}}}
        (tmp_path / f"{k:06d}.hands.json").write_text(json.dumps(content))
    motion = opened(tmp_path, format="HOT3D", frames=T, pca_components=15).motion(BASIS)
    same_turns(motion.theta[:, 0], POSE[:, :3])
    np.testing.assert_allclose(motion.transl, TRANS)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("InterHand2.6M_test_camera.json", {"0": {"campos": {}, "camrot": {}}}, "MANO_NeuralAnnot"),
        ("InterHand2.6M_test_joint_3d.json", {"0": {"5": {"world_coord": [], "joint_valid": []}}}, "MANO_NeuralAnnot"),
        ("InterHand2.6M_test_data.json", {"images": [], "annotations": []}, "MANO_NeuralAnnot"),
        ("umetrack.json", [{"joint_angles": [0.1] * 22, "wrist_xform": {}}], "UmeTrack"),
        ("glove.csv", "Frame,Index_MCP_Spread,Index_MCP_Stretch\n0,1,2\n", "joint angles .* FBX or BVH"),
        ("take.mvnx", "<mvnx/>", "Xsens MVN: export BVH or FBX"),
        ("scene.casc", "", "Cascadeur: export FBX"),
        ("take.uasset", "", "Unreal: export the take"),
        ("meta.yml", "", r"DexYCB's poses are in labels_"),
        ("film.mp4", "", "livehand track"),
    ],
)
def test_a_file_without_poses_names_the_one_that_is_meant(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(LiveHandError, match=f"(?s)^{re.escape(str(path))} must .*{words}"):
        open_motion_file(path)


def test_an_unknown_files_keys_are_counted(tmp_path):
    np.savez(tmp_path / "many.npz", **{f"key{k:03d}": np.zeros(1) for k in range(300)})
    with pytest.raises(LiveHandError, match=r"got keys key000, .*key011 and 288 more; a landmark file"):
        open_motion_file(tmp_path / "many.npz")
