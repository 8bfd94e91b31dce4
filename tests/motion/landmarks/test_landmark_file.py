"""Landmark files by hand, and whose hand they show: the picture that MediaPipe takes for a mirrored selfie."""

import json

import numpy as np
import pytest
from livehand.backend.motion.files.open_files import open_motion_file, open_pose_file
from livehand.backend.motion.landmarks.landmark_file import LandmarkFile
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton
from livehand.backend.records.errors import LiveHandError

POINTS = np.random.default_rng(0).normal(size=(3, 21, 3)).round(6)


def named(points):
    return [dict(zip("xyz", point, strict=True)) for point in points.tolist()]


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
