"""Every fault that can be planted in a file of poses is named by `livehand render`, refused, or read right."""

import json

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.motion.landmarks.sighting import MEDIAPIPE_IN_WEBXR
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.cli import main
from PIL import Image

pytestmark = pytest.mark.slow

COUNT = 20
AXES = FingerAxes.of_default_hand()
FIST = GESTURES["fist"].angles_deg()
SHARES = 0.5 - 0.5 * np.cos(np.linspace(0, 2 * np.pi, COUNT))
CLOSING = np.array([theta_of(share * FIST, AXES, np.array([0.2, -0.1, 0.3])) for share in SHARES])
GOOD = {"theta": CLOSING, "beta": np.zeros(10), "transl": np.zeros((COUNT, 3)), "side": "right", "fps": 30.0}


def rendered(tmp_path, capsys, path, *options):
    """The exit code, what was said, and the picture of frame 10; None: there is none."""
    out = tmp_path / f"pictures of {path.stem}"
    code = main(["render", str(path), "-o", str(out), "--size", "40x40", "--frames", "10", *options])
    picture = out / "0010.png"
    return code, capsys.readouterr().err, np.asarray(Image.open(picture)) if picture.is_file() else None


def with_joint(joint, turn, frames):
    theta = CLOSING.copy()
    theta[frames, joint] = turn
    return theta


def with_nan():
    theta = CLOSING.copy()
    theta[7, 3, 1] = np.nan
    return theta


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"side": "left"}, "degrees backwards on average, as a mirrored hand's or the other hand's would"),
        ({"theta": CLOSING * MIRROR_AXIS_ANGLE}, "degrees backwards on average, as a mirrored hand's"),
        ({"theta": CLOSING[:, :, [0, 2, 1]]}, "beyond what a hand can"),  # other axes
        ({"transl": np.full((COUNT, 3), 400.0)}, "the wrist is up to 693 m away: the unit may be another"),
        ({"theta": np.rad2deg(CLOSING)}, "rad: they may be in degrees"),
        ({"theta": CLOSING * np.r_[1, np.full(15, 0.1)][:, None]}, "the angles may count from MANO's mean"),
        ({"theta": with_joint(2, AXES.flexion[2] * -1.5, [9])}, "in 1 of 20 frames, first in its frame 10"),
        ({"theta": with_joint(0, [0, 0, 2.2], slice(15, None))}, "from its frame 15 to the next"),
        ({"beta": np.full(10, 9.0)}, "a shape of 9 standard deviations is no hand's"),
    ],
)
def test_a_fault_of_poses_is_named_before_they_are_rendered(tmp_path, capsys, fault, said):
    np.savez(tmp_path / "faulty.npz", **(GOOD | fault))
    code, err, picture = rendered(tmp_path, capsys, tmp_path / "faulty.npz")
    assert code == 0
    assert f"check the motion: {said}" in err or f"{said}" in err.partition("check the motion: ")[2]
    assert picture is not None


def test_poses_without_a_fault_are_rendered_without_a_word(tmp_path, capsys):
    np.savez(tmp_path / "good.npz", **GOOD)
    code, err, picture = rendered(tmp_path, capsys, tmp_path / "good.npz")
    assert code == 0
    assert "check" not in err
    assert picture[..., 3].max() == 255


@pytest.mark.parametrize(
    ("fault", "said"),
    [({"theta": with_nan()}, "NaN"), ({"fps": np.nan}, "fps"), ({"theta": CLOSING[:, :15]}, "theta")],
)
def test_poses_that_are_none_are_refused(tmp_path, capsys, fault, said):
    np.savez(tmp_path / "broken.npz", **(GOOD | fault))
    code, err, picture = rendered(tmp_path, capsys, tmp_path / "broken.npz")
    assert code == 1
    assert said in err
    assert picture is None


def joints(hand, side):
    """[COUNT, 25, 3] m of a hand as WebXR has them."""
    points = np.full((COUNT, 25, 3), 9.0)
    poses = [HandPose(theta, np.zeros(10), np.zeros(3)) for theta in CLOSING]
    points[:, list(MEDIAPIPE_IN_WEBXR)] = [
        landmarks_of(hand.for_side(side), pose if side == "right" else pose.mirrored()) for pose in poses
    ]
    return points + np.array([0.1, 1.2, -0.4])


@pytest.mark.parametrize(
    ("side", "change"),
    [("right", np.array([1, 1, -1])), ("left", 100), ("right", 1000)],
    ids=["mirrored axes", "centimeters", "millimeters"],
)
def test_a_fault_that_landmarks_tell_is_put_right(tmp_path, capsys, hand, side, change):
    points = joints(hand, side)
    np.savez(tmp_path / "good.npz", joints=points, handedness=side)
    np.savez(tmp_path / "faulty.npz", joints=points * change, handedness=side)
    _, _, good = rendered(tmp_path, capsys, tmp_path / "good.npz")
    code, _, picture = rendered(tmp_path, capsys, tmp_path / "faulty.npz")
    assert code == 0
    assert np.abs(picture.astype(int) - good).max() <= 2


def test_a_side_that_landmarks_do_not_have_is_named(tmp_path, capsys, hand):
    np.savez(tmp_path / "right.npz", joints=joints(hand, "right"), handedness="right")
    code, err, _ = rendered(tmp_path, capsys, tmp_path / "right.npz", "--side", "left")
    assert code == 0
    assert "the landmarks bend like a right hand" in err


def test_landmarks_that_are_none_are_refused(tmp_path, capsys, hand):
    points = joints(hand, "right")
    points[:, 3] = np.nan  # in some frames only, it would be missing there
    np.savez(tmp_path / "broken.npz", joints=points, handedness="right")
    code, err, picture = rendered(tmp_path, capsys, tmp_path / "broken.npz")
    assert code == 1
    assert "broken.npz" in err
    assert picture is None
    (tmp_path / "none.json").write_text(json.dumps({"landmarks": []}))
    assert rendered(tmp_path, capsys, tmp_path / "none.json")[0] == 1
