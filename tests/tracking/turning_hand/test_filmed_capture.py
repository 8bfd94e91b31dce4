"""A filmed hand as a capture: poses, cameras, images and masks are the film's; or one error and nothing written."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.check import check_capture
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.motion.landmarks.take_file import FilmedTake
from livehand.backend.motion.motion import mirrored
from livehand.backend.records.errors import LiveHandError
from livehand.backend.tracking.turning_hand.filmed_capture import hand_to_capture, write_filmed_capture
from livehand.backend.tracking.video import VideoFrame
from livehand.livehand_blender.cli import main
from scipy.ndimage import binary_dilation

pytestmark = pytest.mark.slow

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")


def written(film, folder, side="right", pictures=None, **changes):
    pictures = film.pictures if pictures is None else pictures
    play = lambda: (VideoFrame(index / 30, picture) for index, picture in enumerate(pictures))  # noqa: E731
    return write_filmed_capture(play, film.take, side, replace(film.fit, **changes), film.model, folder, "film.mp4")


def part_of(picture, camera, part, beyond):
    """The part of a film's picture that a camera of the same scale sees."""
    width, height = part.size_px
    x, y = (camera.K[:2, 2] - part.K[:2, 2]).round().astype(int)
    far = max(*picture.shape[:2], width, height)
    padded = np.pad(picture, [(far, far)] * 2 + [(0, 0)] * (picture.ndim - 2), beyond)
    return padded[far + y : far + y + height, far + x : far + x + width]


@pytest.fixture(scope="module")
def made(film, tmp_path_factory):
    return written(film, tmp_path_factory.mktemp("made") / "capture")


def test_the_poses_are_the_films(film, made, hand):
    """Back from the capture's world into the camera's axes: to 1e-5, in vertices, rotation and place."""
    capture = load_capture(made.capture.folder)
    check_capture(capture, hand)
    assert {pose.side for pose in capture.poses} == {"right"}
    for view, frame in zip(capture.views, made.frames, strict=True):
        pose, true = capture.poses[view.pose_index], film.motion.pose(int(frame))
        to_camera = np.linalg.inv(view.camera.cam2world)
        ours = posed_vertices(hand, pose) @ to_camera[:3, :3].T + to_camera[:3, 3]
        np.testing.assert_allclose(ours, posed_vertices(hand, true), atol=1e-5)
        np.testing.assert_allclose(pose.theta[1:], true.theta[1:], atol=1e-9)
        roots = [axis_angle_to_matrix(each.theta[:1])[0] for each in (pose, true)]
        np.testing.assert_allclose(to_camera[:3, :3] @ roots[0], roots[1], atol=1e-9)


def test_images_and_masks_are_the_films(film, made):
    capture = load_capture(made.capture.folder)
    for view, frame in zip(capture.views, made.frames, strict=True):
        pixels = capture.read_pixels(view)
        np.testing.assert_array_equal(pixels[..., :3], part_of(film.pictures[frame], film.camera, view.camera, "edge"))
        mask, true = pixels[..., 3] > 127, part_of(film.masks[frame], film.camera, view.camera, "constant")
        assert (mask & true).sum() / (mask | true).sum() > 0.9
        assert film.masks[frame].sum() == true.sum()
    assert made.overlap > 0.9


def test_masks_end_at_the_wrist_and_images_hold_the_place_of_the_arm(film, made, hand):
    """The film shows the arm in the hand's own colours, bent to and fro."""
    capture = load_capture(made.capture.folder)
    of_arm, masked = [], []
    for view, frame in zip(capture.views, made.frames, strict=True):
        px, _ = view.camera.project(posed_vertices(hand, capture.poses[view.pose_index]))
        assert (px >= 0).all()
        assert (px <= view.camera.size_px).all()
        mask = capture.read_pixels(view)[..., 3] > 127
        shown = part_of(film.masks[frame], film.camera, view.camera, "constant")
        is_skin = capture.read_pixels(view)[..., 0] > 150
        arm = is_skin & ~binary_dilation(shown, iterations=3)
        of_arm.append(arm.sum())
        masked.append((mask & arm).sum())
    assert min(of_arm) > 600  # what there is to leave out
    assert max(masked) < 20  # where it bends, beside the cut


def test_the_index_says_where_it_comes_from(film, made):
    capture = load_capture(made.capture.folder)
    says = capture.provenance
    assert (says["made_by"], says["source"], says["focal_px"]) == ("livehand track", "film.mp4", 155.0)
    assert says["frames"] == made.frames.tolist()
    assert says["doubt"] == [0.01] * len(capture.views)
    splits = [view.split for view in capture.views]
    assert splits.count("novel_pose") == 4
    assert set(splits) == {"train", "novel_pose"}
    assert {view.camera_index for view in capture.views} == {0}


def test_a_left_hand_is_mirrored(turning, hand, tmp_path):
    film = turning(side="left")
    result = written(film, tmp_path / "capture", "left")
    capture = load_capture(tmp_path / "capture")
    check_capture(capture, hand)
    assert capture.provenance["is_mirrored"]
    view, frame = capture.views[0], int(result.frames[0])
    right = mirrored(film.motion).pose(frame)
    to_camera = np.linalg.inv(view.camera.cam2world)
    ours = posed_vertices(hand, capture.poses[0]) @ to_camera[:3, :3].T + to_camera[:3, 3]
    np.testing.assert_allclose(ours, posed_vertices(hand, right), atol=1e-5)
    shown = part_of(film.pictures[frame][:, ::-1], film.camera, view.camera, "edge")
    np.testing.assert_array_equal(capture.read_pixels(view)[..., :3], shown)


def test_ill_fitted_and_unseen_frames_are_left_out(film, tmp_path):
    fit_error, is_keyed = film.fit.fit_error.copy(), film.fit.is_keyed.copy()
    fit_error[5:10], is_keyed[20:25] = 0.2, False
    frames = set(written(film, tmp_path / "capture", fit_error=fit_error, is_keyed=is_keyed).frames.tolist())
    assert not frames & {*range(5, 10), *range(20, 25)}


def test_a_camera_that_moves_is_an_error_and_nothing_is_written(film, tmp_path):
    moving = [np.roll(picture.astype(int) + index, 3 * index, 1).clip(0, 255).astype(np.uint8)
              for index, picture in enumerate(film.pictures)]  # fmt: skip
    with pytest.raises(LiveHandError, match=r"the camera must rest .* got a ground that changes by \d+ of 255"):
        written(film, tmp_path / "capture", pictures=moving)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_empty_is_left_as_it_is(film, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(LiveHandError, match="a new capture needs an empty folder"):
        written(film, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_hand_that_is_never_seen_whole_is_an_error(film, tmp_path):
    with pytest.raises(LiveHandError, match="a hand that is seen whole, got none of 40 frames"):
        written(film, tmp_path / "capture", fit_error=np.full(40, 0.3))
    assert list(tmp_path.iterdir()) == []


def test_what_fails_half_way_leaves_nothing(film, tmp_path, monkeypatch):
    def fail(*_args):
        assert [len(list(folder.glob("images/*.png"))) for folder in tmp_path.iterdir()] == [len(made_frames)]
        raise LiveHandError("no masks today")

    made_frames = written(film, tmp_path / "whole").frames
    shutil.rmtree(tmp_path / "whole")
    monkeypatch.setattr("livehand.backend.tracking.turning_hand.filmed_capture.mask_capture", fail)
    with pytest.raises(LiveHandError, match="no masks today"):
        written(film, tmp_path / "capture")
    assert list(tmp_path.iterdir()) == []


def test_which_hand_is_taken(film):
    seen = film.take.hands["right"]
    fewer = replace(seen, frames=seen.frames[:9], px=seen.px[:9], world=seen.world[:9])
    both = FilmedTake(film.take.camera, film.take.times, 30.0, {"right": fewer, "left": seen})
    assert hand_to_capture(both, None) == "left"
    assert hand_to_capture(both, "right") == "right"
    with pytest.raises(LiveHandError, match="--side must name a hand of the film, got left; it shows the right"):
        hand_to_capture(film.take, "left")


@pytest.mark.slow
def test_it_is_trained_on(turning, tmp_path):
    """For two steps; the avatar knows the shape of its person."""
    film = turning(beta=np.linspace(-0.2, 0.2, 10))
    made = written(film, tmp_path / "capture")
    out = tmp_path / "own.safetensors"
    options = ["--refine", "--perceptual", "0", "--steps", "2", "--preview-minutes", "0", "--device", "cpu"]
    assert main(["train", str(made.capture.folder), "-o", str(out), *options]) == 0
    assert out.is_file()
    refined = load_capture(tmp_path / "own.refined")
    assert len(refined.poses) == len(made.frames)
    assert refined.read_pixels(refined.views[0]).shape[2] == 4
    assert read_metadata(out).beta == pytest.approx(film.motion.beta)
