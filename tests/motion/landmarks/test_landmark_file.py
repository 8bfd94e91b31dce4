"""Landmark files by hand, and whose hand they show: the picture that MediaPipe takes for a mirrored selfie."""

import json

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.files.import_options import ImportOptions, motion_and_warning
from livehand.backend.motion.files.open_files import open_motion_file, open_pose_file
from livehand.backend.motion.files.summary import file_summary
from livehand.backend.motion.landmarks.landmark_file import LandmarkFile
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton, landmarks_of
from livehand.backend.motion.spaces import TO_BLENDER
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose

POINTS = np.random.default_rng(0).normal(size=(3, 21, 3)).round(6)


def named(points):
    return [dict(zip("xyz", point, strict=True)) for point in points.tolist()]


def closing_landmarks():
    """[3, 21, 3] m of a right hand that closes, in a Y-up world, its wrist at the origin."""
    axes, skeleton = FingerAxes.of_default_hand(), HandSkeleton.of(load_default_hand())
    found = []
    for share in (0.3, 0.5, 0.7):
        theta = theta_of(share * GESTURES["fist"].angles_deg(), axes)
        points = landmarks_of(load_default_hand(), HandPose(theta, np.zeros(10), np.zeros(3)))
        found.append(points - skeleton.rest[0])
    return np.array(found)


def opened(path):
    file = open_motion_file(path)
    assert isinstance(file, LandmarkFile)
    return file


@pytest.mark.parametrize(
    "content",
    [
        POINTS.tolist(),
        [named(points) for points in POINTS],
        [[named(points)] for points in POINTS],
        {"world_landmarks": POINTS.tolist(), "handedness": "Left", "fps": 25},
        [{"hand_world_landmarks": [named(points)], "handedness": "Left"} for points in POINTS],
    ],
)
def test_mediapipe_json(tmp_path, content):
    (tmp_path / "take.json").write_text(json.dumps(content))
    file = opened(tmp_path / "take.json")
    np.testing.assert_allclose(file.points, POINTS)
    assert (file.info.format, file.info.space, file.info.side) == ("MediaPipe landmarks", "opencv", "right")
    assert file.info.fps == (25 if isinstance(content, dict) else None)


def test_mediapipe_npz_flat_or_not(tmp_path):
    for shape in ((3, 21, 3), (3, 63)):
        np.savez(tmp_path / "take.npz", landmarks=POINTS.reshape(shape), handedness="Right")
        file = opened(tmp_path / "take.npz")
        np.testing.assert_array_equal(file.points, POINTS)
        assert file.info.side == "left"


@pytest.mark.parametrize("pattern", ["{axis}{number}", "landmark_{number}_{axis}", "{axis}_{number}", "{number}{axis}"])
def test_mediapipe_csv_with_gaps(tmp_path, pattern):
    names = [pattern.format(number=number, axis=axis) for number in range(21) for axis in "xyz"]
    rows = [",".join(map(str, points.ravel())) for points in POINTS]
    lines = ["frame," + ",".join(names), f"0,{rows[0]}", "1" + "," * 63, f"2,{rows[1]}", f"3,{rows[2]}"]
    (tmp_path / "take.csv").write_text("\n".join(lines))
    file = opened(tmp_path / "take.csv")
    np.testing.assert_allclose(file.points, POINTS)
    np.testing.assert_array_equal(file.frame_indices, [0, 2, 3])
    assert (file.info.frames, file.info.missing) == (4, 1)


@pytest.mark.slow
def test_gaps_in_json_are_filled(hand, tmp_path):
    pose = HandSkeleton.of(hand).rest[list(NODES_OF_LANDMARKS)]
    (tmp_path / "take.json").write_text(json.dumps([pose.tolist(), None, [], (pose + 0.03).tolist()]))
    motion = opened(tmp_path / "take.json").motion(hand)
    assert len(motion) == 4
    np.testing.assert_allclose(motion.transl[1] - motion.transl[0], 0.01, atol=2e-4)


@pytest.mark.slow
def test_world_landmarks_have_no_translation_and_tracked_ones_have(hand, tmp_path):
    middle = HandSkeleton.of(hand).rest[list(NODES_OF_LANDMARKS)]
    middle, away = middle - middle.mean(0) + [0.02, 0, 0], np.array([0, 0, 0.4])
    for name, points in (("world", middle), ("tracked", middle + away), ("mm", 1000 * middle)):
        np.savez(tmp_path / f"{name}.npz", landmarks=np.tile(points, (3, 1, 1)))
        assert opened(tmp_path / f"{name}.npz").info.has_translation == (name == "tracked")
    np.savez(tmp_path / "xr.npz", joints=webxr(middle[None]))
    assert opened(tmp_path / "xr.npz").info.has_translation


def webxr(points):
    """25 joints of which MediaPipe's are the given; metacarpals far off."""
    joints = np.full((len(points), 25, 3), 9.0)
    joints[:, [0, 1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 16, 17, 18, 19, 21, 22, 23, 24]] = points
    return joints


@pytest.mark.slow
def test_webxr_matrices_are_column_major_and_y_is_up(tmp_path):
    joints = webxr(POINTS)
    matrices = np.tile(np.eye(4), (3, 25, 1, 1))
    matrices[..., :3, 3] = joints
    column_major = matrices.swapaxes(-1, -2).reshape(3, 25, 16)
    np.savez(tmp_path / "m.npz", joints=column_major, handedness="left")
    np.savez(tmp_path / "flat.npz", joints=column_major.reshape(3, 400), handedness="left")
    np.savez(tmp_path / "rows.npz", joints=matrices, handedness="left")
    np.savez(tmp_path / "p.npz", joints=joints, handedness="left")
    frames = [{"joints": [{"position": point} for point in named(one)], "handedness": "left"} for one in joints]
    (tmp_path / "p.json").write_text(json.dumps(frames))
    (tmp_path / "m.json").write_text(json.dumps(column_major.tolist()))
    for name in ("m.npz", "flat.npz", "rows.npz", "p.npz", "p.json", "m.json"):
        file = opened(tmp_path / name)
        np.testing.assert_allclose(file.points, POINTS)
        assert (file.info.format, file.info.space) == ("WebXR joints", "y_up")
        assert file.info.side == ("right" if name == "m.json" else "left")  # WebXR's label is the hand's own


@pytest.mark.slow
def test_webxr_measures_and_mediapipe_guesses_its_scale(hand, tmp_path):
    pose = 1.2 * HandSkeleton.of(hand).rest[list(NODES_OF_LANDMARKS)][None]
    np.savez(tmp_path / "m.npz", landmarks=pose)
    np.savez(tmp_path / "x.npz", joints=webxr(pose), handedness="right")
    assert opened(tmp_path / "m.npz").fit(hand).scale == pytest.approx(1.2, abs=1e-6)
    assert opened(tmp_path / "x.npz").fit(hand).scale == 1


@pytest.mark.slow
def test_a_mirrored_picture_is_unmirrored(hand, tmp_path):
    """A right hand before a selfie camera: MediaPipe says "Right", and sees the shape of a left hand."""
    pose = HandSkeleton.of(hand).rest[list(NODES_OF_LANDMARKS)]
    seen = pose * [-1, 1, 1]
    np.savez(tmp_path / "selfie.npz", landmarks=seen[None], handedness="Right")
    file = opened(tmp_path / "selfie.npz")
    assert file.info.side == "left"
    assert file.warning(hand) is None
    true = file.with_changes(is_picture_mirrored=True)
    assert true.info.side == "right"
    assert true.warning(hand) is None
    assert true.motion(hand).side == "right"
    assert true.fit(hand).rms_m < 0.002
    assert true.with_changes(is_picture_mirrored=False).info.side == "left"
    wrong = file.with_changes(side="right")
    assert wrong.warning(hand) == "the landmarks bend like a left hand"


def test_bad_landmarks_are_refused(tmp_path):
    path = tmp_path / "take.json"
    path.write_text(json.dumps([None, None]))
    with pytest.raises(LiveHandError, match="known format"):
        open_motion_file(path)
    path.write_text(json.dumps([POINTS[0].tolist(), POINTS[1, :20].tolist()]))
    with pytest.raises(LiveHandError, match=r"frame 1 must be null or hands of 21 points, .*got a frame of 20 points"):
        open_motion_file(path)
    np.savez(tmp_path / "take.npz", landmarks=np.full((2, 21, 3), np.nan))
    with pytest.raises(LiveHandError, match="must have a frame with a hand, got none in 2"):
        open_motion_file(tmp_path / "take.npz")
    np.savez(tmp_path / "take.npz", landmarks=POINTS)
    with pytest.raises(LiveHandError, match="must hold poses, got MediaPipe landmarks"):
        open_pose_file(tmp_path / "take.npz")


def hands_of(side_points, frames=3):
    """Rows of a table of OpenXR's joints: frame, side, name, x, y, z."""
    for frame in range(frames):
        for side, points in side_points.items():
            for name, point in zip(OPENXR, points[frame], strict=True):
                yield frame, side, name, *point


PARTS = ("Proximal", "Intermediate", "Distal", "Tip")
OPENXR = (
    "Wrist",
    *(f"Thumb{part}" for part in ("Metacarpal", "Proximal", "Distal", "Tip")),
    *(f"{finger}{part}" for finger in ("Index", "Middle", "Ring", "Little") for part in PARTS),
)


def write_table(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]))
    return path


def both_hands():
    right = np.add(closing_landmarks(), [0.2, 1.0, -0.4])
    return {"Right": right, "Left": right * [-1, 1, 1]}


@pytest.mark.slow
def test_left_handed_axes_do_not_exchange_the_hands(tmp_path):
    own = both_hands()
    unity = {side: points * [1, 1, -1] for side, points in own.items()}
    path = write_table(tmp_path / "quest.csv", "frame,hand,joint,x,y,z", hands_of(unity))
    file = opened(path)
    assert "z is negated" in " ".join(file.info.notes)
    for side, points in own.items():
        np.testing.assert_allclose(file.with_changes(side=side.lower()).points, points)
    one = opened(write_table(tmp_path / "one.csv", "frame,hand,joint,x,y,z", hands_of({"Left": unity["Left"]})))
    assert one.info.side == "left"
    np.testing.assert_allclose(one.points, own["Left"])
    plain = opened(write_table(tmp_path / "xr.csv", "frame,hand,joint,x,y,z", hands_of(own)))
    np.testing.assert_allclose(plain.with_changes(side="left").points, own["Left"])
    assert plain.info.notes == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "header", ["Time,Hand,Joint,Position_X,Position_Y,Position_Z", "time,hand,bone,PosX,PosY,PosZ"]
)
def test_loggers_columns_and_clock_times(tmp_path, header):
    own = both_hands()
    rows = ((f"2026-11-27 12:59:{59 + frame / 30:.3f}", *row) for frame, *row in hands_of(own))
    file = opened(write_table(tmp_path / "log.csv", header, rows))
    assert (file.info.frames, file.sides) == (3, ("right", "left"))
    np.testing.assert_allclose(file.points, own["Right"])


@pytest.mark.slow
def test_joints_that_name_their_side_themselves(tmp_path):
    rows = ((frame, side + name, *point) for frame, side, name, *point in hands_of(both_hands()))
    file = opened(write_table(tmp_path / "log.csv", "frame,joint,x,y,z", rows))
    np.testing.assert_allclose(file.with_changes(side="left").points, both_hands()["Left"])


@pytest.mark.slow
def test_a_hand_that_comes_late_begins_late(tmp_path):
    pose = HandSkeleton.of(load_default_hand()).rest[list(NODES_OF_LANDMARKS)]
    first, second = ({"handedness": side, "world_landmarks": pose.tolist()} for side in ("Left", "Right"))
    (tmp_path / "take.json").write_text(json.dumps({"frames": [None, [first], [first], [first, second], [second]]}))
    file = opened(tmp_path / "take.json")
    firsts = sorted(file.with_changes(side=side).info.first for side in ("right", "left"))
    assert firsts == [1, 3]


@pytest.mark.slow
def test_the_unit_is_told_by_the_hands_size(tmp_path):
    points = np.add(closing_landmarks(), [0.1, 0.2, 0.5])
    for unit, factor in (("m", 1), ("cm", 100), ("mm", 1000)):
        np.savez(tmp_path / "take.npz", landmarks=points * factor)
        file = opened(tmp_path / "take.npz")
        assert file.info.unit == unit
    np.savez(tmp_path / "take.npz", landmarks=points / 100)
    with pytest.raises(LiveHandError, match=r"times as large, as if its unit were 100 times larger"):
        opened(tmp_path / "take.npz").fit(load_default_hand())


@pytest.mark.slow
def test_a_pictures_landmarks_are_told_by_a_wrist_without_depth(tmp_path):
    points = closing_landmarks()
    moved = (
        3 * (points - points[:, :1]) * [1, 1, 0.4]
        + np.array([[0.1, -0.4, 0.025], [0.2, -0.3, 0.025], [0.4, 0, 0.025]])[:, None]
    )
    np.savez(tmp_path / "take.npz", landmarks=moved)
    file = opened(tmp_path / "take.npz")
    assert "moved or scaled" in " ".join(file.info.notes)
    with pytest.raises(LiveHandError, match="those of a picture, moved or scaled since"):
        file.motion(load_default_hand())
    still = points - points[:, :1]
    np.savez(tmp_path / "take.npz", landmarks=still)
    assert opened(tmp_path / "take.npz").info.format == "MediaPipe landmarks"


@pytest.mark.slow
def test_unreals_axes_are_left_handed_and_its_z_is_up(tmp_path):
    """X forward, Y right, Z up, in centimetres: ours with y negated."""
    own = {side: 100 * np.einsum("ab,tkb->tka", TO_BLENDER["y_up"], points) for side, points in both_hands().items()}
    unreal = {side: points * [1, -1, 1] for side, points in own.items()}
    file = opened(write_table(tmp_path / "ue.csv", "frame,hand,joint,x,y,z", hands_of(unreal)))
    assert (file.info.unit, file.info.space) == ("cm", "z_up")
    assert "y is negated and z is up" in " ".join(file.info.notes)
    for side, points in own.items():
        chosen = file.with_changes(side=side.lower())
        np.testing.assert_allclose(chosen.points, points)
        assert motion_and_warning(chosen, ImportOptions(), load_default_hand(), None)[1] is None


@pytest.mark.slow
def test_landmarks_of_no_hand_are_doubted_where_they_are_fitted(tmp_path):
    rng = np.random.default_rng(0)
    wild = closing_landmarks() + rng.normal(size=(3, 21, 3)) * np.where(np.arange(21) % 4 == 0, 0.04, 0)[:, None]
    np.savez(tmp_path / "take.npz", landmarks=wild)
    assert "mm from a hand's" in file_summary(opened(tmp_path / "take.npz"), fits_landmarks=True)["check"]
    assert "check" not in file_summary(opened(tmp_path / "take.npz"))
    np.savez(tmp_path / "take.npz", landmarks=closing_landmarks())
    assert "check" not in file_summary(opened(tmp_path / "take.npz"), fits_landmarks=True)


@pytest.mark.slow
def test_both_hands_of_a_file_are_checked(tmp_path):
    good = np.add(closing_landmarks(), [0.2, 0, -0.4])
    jumping = np.concatenate([good * [-1, 1, 1]] * 8)
    jumping[6] = jumping[6] @ np.diag([1.0, -1, -1])
    good = np.concatenate([good] * 8)
    path = write_table(
        tmp_path / "xr.csv", "frame,hand,joint,x,y,z", hands_of({"Right": good, "Left": jumping}, frames=24)
    )
    check = file_summary(opened(path), fits_landmarks=True)["check"]
    assert check.startswith("the left hand: wrist turns by 180 degrees from its frame ")
    assert "right" not in check
