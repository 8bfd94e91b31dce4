"""A take's file: what is written is read, mirrored and refused."""

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.files.import_options import ImportOptions, motion_and_warning, with_options
from livehand.backend.motion.files.open_files import open_motion_file, open_pose_file
from livehand.backend.motion.files.summary import file_summary
from livehand.backend.motion.landmarks.picture_camera import PictureCamera
from livehand.backend.motion.landmarks.take_file import FilmedTake, TakeFile, write_take
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand
from livehand.backend.motion.motion import mirrored
from livehand.backend.records.errors import LiveHandError

HAND = load_default_hand()


@pytest.fixture
def take(tmp_path, made, seen, film_camera):
    """A function (sides) -> path of a take of the same hand."""
    _, points = made(12)

    def write(*sides, name="take.npz"):
        hands = {side: seen(points) for side in sides}
        write_take(FilmedTake(film_camera, np.arange(12) / 30, 30.0, hands), tmp_path / name)
        return tmp_path / name

    return write


@pytest.mark.slow
def test_what_is_written_is_read(take, film_camera):
    file = open_motion_file(take("right"))
    assert isinstance(file, TakeFile)
    assert file.take.camera == film_camera
    assert file_summary(file)["place"] == "in the file"
    assert (file.info.frames, file.info.missing, file.info.space) == (12, 0, "opencv")
    motion, warning = motion_and_warning(file, ImportOptions(), HAND, None)
    assert (len(motion), motion.fps, motion.side, warning) == (12, 30.0, "right", None)
    assert 0.3 < motion.transl[:, 2].mean() < 0.7


@pytest.mark.slow
def test_of_two_hands_the_chosen_one_is_read(take):
    file = open_motion_file(take("left", "right"))
    assert (file.sides, file.info.side) == (("right", "left"), "right")
    assert with_options(file, ImportOptions({"side": "left"})).motion(HAND).side == "left"


def test_a_mirrored_film_is_the_other_hand_mirrored(take):
    file = open_motion_file(take("right"))
    selfie = with_options(file, ImportOptions(is_picture_mirrored=True))
    assert selfie.info.side == "left"
    np.testing.assert_allclose(mirrored(selfie.motion(HAND)).theta, file.motion(HAND).theta, atol=1e-6)


def test_the_pictures_camera_replaces_the_guess(take):
    file = open_motion_file(take("right"))
    near = with_options(file, ImportOptions(picture_camera=PictureCamera((1280, 960), 90.0)))
    assert near.take.camera.focal_px == pytest.approx(320)
    assert near.motion(HAND).transl[:, 2].mean() < 0.65 * file.motion(HAND).transl[:, 2].mean()


def test_the_hands_own_shape_is_fitted(take):
    beta = np.r_[2.0, np.zeros(9)]
    file = open_motion_file(take("right")).with_changes(beta=beta)
    np.testing.assert_array_equal(file.fit(HAND).motion.beta, beta)


def test_its_axes_and_unit_are_fixed(take):
    with pytest.raises(LiveHandError, match="leave both as detected"):
        open_motion_file(take("right")).with_changes(space="z_up")
    with pytest.raises(LiveHandError, match="must hold poses, got filmed take"):
        open_pose_file(take("right"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.zeros(12)}, "times must increase"),
        ({"times": np.r_[0:11, 1e9]}, "must last at most"),
        ({"focal_px": np.array(0.0)}, "must be positive"),
        ({"focal_px": np.array(np.nan)}, "must be finite"),
        ({"fps": np.array(0.0)}, "fps must be a film's"),
        ({"right_frames": np.arange(1, 13)}, "right_frames must increase"),
        ({"right_frames": np.zeros(12, int)}, "right_frames must increase"),
        ({"right_px": np.zeros((12, 20, 2))}, "right_px must be"),
        ({"right_px": np.full((12, 21, 2), 1e9)}, "must be image coordinates, px"),
        ({"right_world": np.full((12, 21, 3), np.inf)}, "must be finite"),
        ({"right_world": np.full((12, 21, 3), 1e200)}, "right_world must be a hand's"),
        ({"times": np.arange(12) * 1e-300}, "times must increase"),
        ({"right_frames": None}, "at least one hand"),
        ({"right_px": None}, "right_px must"),
    ],
)
def test_what_is_refused(take, changes, message):
    path = take("right")
    arrays = dict(np.load(path)) | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(LiveHandError, match=message):
        open_motion_file(path)


def test_a_take_is_written_to_npz(tmp_path):
    hand = FilmedHand(np.arange(1), np.zeros((1, 21, 2)), np.zeros((1, 21, 3)))
    with pytest.raises(LiveHandError, match=r"\.npz"):
        write_take(FilmedTake(FilmCamera.guessed((64, 48)), np.zeros(1), 30.0, {"right": hand}), tmp_path / "a.json")
