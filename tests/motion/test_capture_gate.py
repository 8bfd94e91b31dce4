"""Poses that come in with images pass the gate: every planted fault is told by each road that reads a capture."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import Capture, save_capture_index
from livehand.backend.capture.plan import CapturePlan
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.motion.capture_gate import capture_doubt, imported_doubt
from livehand.backend.records.shot import HandPose
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image

AXES = FingerAxes.of_default_hand()
FIST = GESTURES["fist"].angles_deg()
MEAN = theta_of(0.3 * FIST, AXES)[1:]
BACKWARDS = "degrees backwards on average, as a mirrored hand's or the other hand's would"


@pytest.fixture(scope="module")
def planned(hand, tmp_path_factory):
    """A capture as `livehand capture` plans it."""
    return CapturePlan(size_px=(36, 54)).make(tmp_path_factory.mktemp("planned"), hand, {})


@pytest.fixture(scope="module")
def closing(planned, hand):
    """A hand that closes before the planned capture's first camera, in twenty images."""
    camera = planned.views[0].camera
    place = planned.poses[planned.views[0].pose_index]
    thetas = [theta_of(share * FIST, AXES, place.theta[0]) for share in np.linspace(0, 1, 20)]
    poses = tuple(replace(place, theta=theta) for theta in thetas)
    view = replace(planned.views[0], camera=camera)
    views = tuple(replace(view, file=f"{index}.png", pose_index=index) for index in range(20))
    return Capture(planned.folder, hand.sha256, {}, poses, views)


def changed(capture, change):
    return replace(capture, poses=tuple(map(change, capture.poses)))


def test_captures_of_ours_pass_without_a_word(planned, closing, hand):
    assert capture_doubt(planned, hand) is None
    assert capture_doubt(closing, hand, np.arange(20) / 30) is None
    assert imported_doubt(closing, hand, None) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pose: replace(pose, theta=pose.theta * MIRROR_AXIS_ANGLE), BACKWARDS),
        (lambda pose: replace(pose, side="left"), BACKWARDS),
        (lambda pose: replace(pose, theta=np.rad2deg(pose.theta)), "rad: they may be in degrees"),
        (lambda pose: replace(pose, transl=1000 * pose.transl), "do not show the hand: the unit of the poses"),
        (lambda pose: replace(pose, transl=pose.transl + 60), "m away: the unit may be another"),
        (lambda pose: replace(pose, transl=pose.transl[[0, 2, 1]] - [0, 0.7, 0]), "world's axes"),
        (lambda pose: replace(pose, beta=pose.beta + 40), "a shape of 4"),
    ],
)
def test_a_fault_of_all_poses_is_told(closing, hand, change, said):
    assert said in (capture_doubt(changed(closing, change), hand) or "")


def test_a_joint_beyond_its_limits_is_counted_by_poses(closing, hand):
    poses, theta = list(closing.poses), closing.poses[0].theta.copy()
    theta[2] = theta_of(np.eye(15, 3, -1) * -60.0, AXES)[2]
    poses[6] = replace(poses[6], theta=theta)
    said = capture_doubt(replace(closing, poses=tuple(poses)), hand)
    assert said == "index2 bend up to 35 degrees beyond what a hand can, in 1 of 20 poses, first in its pose 7"


def test_a_jump_is_told_where_times_are_known(closing, hand):
    poses = list(closing.poses)
    turned = np.array([[0.0, 0.0, 2.0]])
    poses[10:] = [replace(pose, theta=np.concatenate([turned, pose.theta[1:]])) for pose in poses[10:]]
    jumping = replace(closing, poses=tuple(poses))
    assert capture_doubt(jumping, hand) is None
    assert "wrist turns by" in capture_doubt(jumping, hand, np.arange(20) / 30)
    steps = [replace(pose, transl=pose.transl + 2.0 * index * np.eye(3)[0]) for index, pose in enumerate(closing.poses)]
    fast = capture_doubt(replace(closing, poses=tuple(steps)), hand, np.arange(20) / 30)
    assert "the wrist moves at 60 m/s: the unit or the rate may be another" in fast


def test_the_mean_that_was_added_or_not(closing, hand):
    flat = changed(closing, lambda pose: replace(pose, theta=np.r_[pose.theta[:1], 0.1 * pose.theta[1:]]))
    assert "a flat hand: the angles may count from MANO's mean" in imported_doubt(flat, hand, None)
    twice = changed(closing, lambda pose: replace(pose, theta=np.r_[pose.theta[:1], pose.theta[1:] + MEAN]))
    assert "the angles may be absolute already" in imported_doubt(twice, hand, MEAN)


def test_both_hands_are_told_apart(closing, hand):
    lefts = tuple(pose.mirrored() for pose in closing.poses)
    assert capture_doubt(replace(closing, poses=closing.poses + lefts), hand) is None
    backwards = tuple(replace(pose, theta=-pose.theta) for pose in lefts)
    said = capture_doubt(replace(closing, poses=closing.poses + backwards), hand)
    assert said.startswith("the left hand: the fingers bend")


def test_another_hand_model_does_not_tell_what_images_show(closing, hand):
    """Wrists rest elsewhere in another's template."""
    far = changed(closing, lambda pose: replace(pose, transl=pose.transl + np.array([0, 0, 5])))
    assert "do not show the hand" in capture_doubt(far, hand)
    assert capture_doubt(replace(far, hand_sha256="0" * 64), hand) is None


def written(capture, folder):
    folder.mkdir()
    for view in capture.views:
        Image.new("RGBA", view.camera.size_px, (90, 80, 70, 255)).save(folder / view.file)
    save_capture_index(replace(capture, folder=folder))
    return folder


def test_inspect_tells(closing, tmp_path, capsys):
    mirrored = changed(closing, lambda pose: replace(pose, theta=pose.theta * MIRROR_AXIS_ANGLE))
    for capture, name, said in ((closing, "own", None), (mirrored, "mirrored", BACKWARDS)):
        assert (
            run_commands("livehand", "", COMMANDS, ["inspect", str(written(capture, tmp_path / name)), "--json"]) == 0
        )
        check = json.loads(capsys.readouterr().out.splitlines()[-1]).get("check")
        assert (check is None) if said is None else (said in check)


def test_import_transforms_tells(closing, tmp_path, capsys):
    """By the command itself, which warns and goes on."""
    poses = changed(closing, lambda pose: replace(pose, theta=pose.theta * MIRROR_AXIS_ANGLE)).poses
    folder = written(closing, tmp_path / "theirs")
    columns = {name: np.array([getattr(pose, name) for pose in poses]) for name in ("theta", "beta", "transl")}
    np.savez(folder / "poses.npz", **columns, time=np.arange(20) / 30)
    view = closing.views[0]
    document = {"fl_x": view.camera.K[0, 0], "fl_y": view.camera.K[1, 1], "cx": view.camera.K[0, 2]}
    document["cy"] = view.camera.K[1, 2]
    matrix = (view.camera.cam2world @ np.diag([1.0, -1, -1, 1])).tolist()
    frames = [{"file_path": f"{index}.png", "transform_matrix": matrix, "pose_index": index} for index in range(20)]
    (folder / "transforms.json").write_text(json.dumps({**document, "frames": frames}))
    arguments = ["import-transforms", folder / "transforms.json", "--poses", folder / "poses.npz"]
    arguments += ["-o", tmp_path / "capture", "--json"]
    assert run_commands("livehand", "", COMMANDS, [str(argument) for argument in arguments]) == 0
    shown = capsys.readouterr()
    assert BACKWARDS in json.loads(shown.out.splitlines()[-1])["check"]
    assert "check the poses: the fingers bend" in shown.err
    assert (tmp_path / "capture/transforms.json").is_file()


def test_poses_that_are_no_numbers_are_refused(closing, tmp_path, capsys):
    folder = written(closing, tmp_path / "broken")
    with np.load(folder / "poses.npz") as arrays:
        columns = dict(arrays)
    columns["theta"][3, 2, 1] = np.nan
    np.savez(folder / "poses.npz", **columns)
    assert run_commands("livehand", "", COMMANDS, ["inspect", str(folder)]) == 1
    assert "pose 3: theta must be finite, got NaN" in capsys.readouterr().err


def test_one_pose_alone(closing, hand):
    rest = replace(closing, poses=(HandPose.rest(),), views=())
    assert capture_doubt(rest, hand, np.zeros(1)) is None
