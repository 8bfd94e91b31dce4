"""Parts of a re-enactment by value: plate, gains, fades, and that the avatar stands where the hand was."""

import numpy as np
import pytest
from livehand.backend.commands.reenact.filmed_shots import FilmedShots
from livehand.backend.commands.reenact.open_shutter import exposed, path_px, sample_count
from livehand.backend.commands.reenact.overlay import colour_gain, faded, over, smooth_gains, wrist_fade
from livehand.backend.commands.reenact.plate import clean_plate, filled
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.take_fit import FilmCamera, TakeFit
from livehand.backend.motion.motion import HandMotion, mirrored
from livehand.backend.records.camera import Camera
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.backend.tracking.video_writer import write_video

HAND = load_default_hand()
FACING = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
FILM = FilmCamera((96, 72), 90.0)


@pytest.fixture(params=["right", "left"])
def shots(request):
    """Three frames of a hand that points up, half a metre before the camera."""
    theta = np.zeros((3, 16, 3))
    theta[:, 0] = np.array([1, 1, 1]) * 2 * np.pi / 3 / np.sqrt(3)  # FACING
    motion = HandMotion(theta, np.zeros(10), np.array([[0, 0.0, 0.5]] * 3), 30.0)
    motion = motion if request.param == "right" else mirrored(motion)
    fit = TakeFit(motion, 0.1, np.array([True, False, True]), np.zeros(3), 0)
    return FilmedShots.of(fit, FILM, HAND)


def square(value, alpha=1.0):
    """A frame of 8 x 8 px whose middle is a hand of one colour."""
    mask = np.zeros((8, 8), np.float32)
    mask[2:6, 2:6] = alpha
    depth = np.where(mask > 0, 0.5, DEPTH_BACKGROUND).astype(np.float32)
    return Frame(mask[..., None] * np.array(value, np.float32), mask, depth)


def test_shots_stand_where_the_film_saw_the_hand(shots):
    """Through either camera, in either world, the vertices have the same image coordinates."""
    shot, motion = shots.shot(0), shots.fit.motion
    here, _ = shot.camera.project(shot.vertices)
    there, _ = Camera(shot.camera.K, np.eye(4), FILM.size_px).project(posed_vertices(HAND, motion.pose(0)))
    np.testing.assert_allclose(here, there, atol=1e-6)
    assert np.abs(shot.vertices.mean(0)).max() < 0.15


def test_frames_without_keys_are_not_shown(shots):
    assert [shots.index_at(time) for time in (0.0, 0.1, 0.1334, 0.1667, 0.3)] == [None, 0, None, 2, None]


def test_the_arm_lies_below_a_hand_that_points_up(shots):
    shot = shots.shot(0)
    along, reach_m = shots.arm_reach(shot)
    assert along @ [0, 0, -1] > 0.95
    wrist = HAND.for_side(shots.motion.side).J_regressor[0] @ shot.vertices
    assert reach_m == pytest.approx(wrist @ along + 0.015)  # the hand has an arm, which is not shown
    front = shots.before_the_cut(shot)
    points, _ = shot.camera.project(shot.vertices)
    low, high = int(points[:, 1].min()), int(points[:, 1].max())
    column = int(points[:, 0].mean())
    assert front[low, column] == 1
    if high + 3 < 72:
        assert front[high + 3, column] == 0


def test_the_plate_is_the_ground_behind_a_hand_that_moves():
    rng = np.random.default_rng(0)
    ground = rng.integers(60, 200, (70, 40, 3)).astype(np.uint8)
    pictures, covered = [], []
    for step in range(5):
        mask = np.zeros((70, 40), bool)
        mask[10:30, 6 * step : 6 * step + 8] = True
        pictures.append(np.where(mask[..., None], 255, ground).astype(np.uint8))
        covered.append(mask)
    np.testing.assert_array_equal(clean_plate(pictures, covered), ground)


def test_no_plate_while_the_camera_moves():
    rng = np.random.default_rng(0)
    ground = rng.integers(0, 255, (40, 40, 3)).astype(np.uint8)
    none = np.zeros((40, 40), bool)
    assert clean_plate([ground, np.roll(ground, 5, 1)], [none, none]) is None
    assert clean_plate([ground], [none]) is None


def test_what_is_always_hidden_is_filled_from_around():
    values = np.full((33, 21, 3), 100.0, np.float32)
    known = np.ones((33, 21), bool)
    known[10:20, 5:15] = False
    values[~known] = 7
    np.testing.assert_allclose(filled(values, known), 100)
    ramp = np.broadcast_to(np.linspace(0, 200, 21, dtype=np.float32)[None, :, None], values.shape)
    np.testing.assert_allclose(filled(np.where(known[..., None], ramp, 0), known), ramp, atol=1)


def test_a_large_hole_is_filled_without_blocks():
    """In the harmonic function x^2 - y^2 of the ground every pixel is the mean of its neighbours."""
    y, x = np.mgrid[-0.9:0.9:180j, -1.2:1.2:240j]
    ground = np.repeat((120 + 60 * (x**2 - y**2))[..., None], 3, -1).astype(np.float32)
    known = np.ones(ground.shape[:2], bool)
    known[30:150, 60:200] = False
    known[60:80, 100:120] = True
    found = filled(np.where(known[..., None], ground, 0), known)
    np.testing.assert_allclose(found, ground, atol=2)
    for axis in (0, 1):
        assert np.abs(np.diff(found - ground, axis=axis)).max() < 1


def test_the_gain_is_the_quotient_of_the_colours():
    picture = np.full((8, 8, 3), 188, np.uint8)  # 0.503 of linear light
    np.testing.assert_allclose(colour_gain(square([0.25, 0.5, 1.0]), picture), [2.01, 1.006, 0.503], rtol=0.01)
    assert colour_gain(square([0.5] * 3, alpha=0.5), picture) is None


def test_gains_are_smooth_in_time():
    gains = smooth_gains(np.array([0.0, 1, 2]), np.array([[1.0] * 3, [4] * 3, [1] * 3]), np.linspace(0, 2, 41))
    assert np.abs(np.diff(np.log(gains), axis=0)).max() < 0.08
    constant = smooth_gains(np.array([0.0, 5]), np.full((2, 3), 0.4), np.array([100.0]))
    np.testing.assert_allclose(constant, 0.4)


def test_a_hand_over_a_picture():
    ground = np.full((8, 8, 3), 50, np.uint8)
    shown = over(square([0.25] * 3), ground, np.array([2.0, 2, 2]))
    assert (shown[0, 0] == 50).all()
    assert (np.abs(shown[4, 4].astype(int) - 188) <= 1).all()
    invisible = over(faded(square([0.25] * 3), np.zeros((8, 8), np.float32)), ground, np.ones(3))
    np.testing.assert_array_equal(invisible, ground)


def test_the_cut_fades_over_its_last_millimetres():
    """One px is 10 mm wide at the hand's depth; the arm lies to the right."""
    camera = Camera(np.array([[50.0, 0, 4], [0, 50, 4], [0, 0, 1]]), np.eye(4), (8, 8))
    fade = wrist_fade(square([0.5] * 3), camera, np.array([1.0, 0, 0]), 0.02)
    np.testing.assert_allclose(fade[4, 2:6], np.clip((20 - np.array([-15, -5, 5, 15])) / 15, 0, 1), atol=1e-5)
    assert fade[0, 0] == 1


class Silhouette:
    """A renderer of discs at the vertices' mean; it counts its renders."""

    def __init__(self):
        self.centres = []

    def render(self, shot):
        (centre,), _ = shot.camera.project(shot.vertices.mean(0, keepdims=True))
        self.centres.append(centre)
        width, height = shot.camera.size_px
        x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
        alpha = (np.hypot(x - centre[0], y - centre[1]) < 4).astype(np.float32)
        return Frame(alpha[..., None].repeat(3, -1), alpha, np.where(alpha > 0, 0.5, DEPTH_BACKGROUND))


@pytest.fixture
def passing():
    """Three frames of a hand that crosses half a metre before the camera at 36 px a frame."""
    theta = np.zeros((3, 16, 3))
    theta[:, 0] = np.array([1, 1, 1]) * 2 * np.pi / 3 / np.sqrt(3)  # FACING
    transl = np.array([[-0.2, 0.1, 0.5], [0.0, 0.1, 0.5], [0.2, 0.1, 0.5]])
    fit = TakeFit(HandMotion(theta, np.zeros(10), transl, 30.0), 0.0, np.ones(3, bool), np.zeros(3), 0)
    return FilmedShots.of(fit, FILM, HAND)


def test_a_moving_hand_is_the_mean_over_the_open_shutter(passing):
    """Half of 36 px a frame, in steps of 3 px; the middle of the path is where the sharp hand is."""
    assert path_px(passing, 1, 0.5) == pytest.approx(18, abs=2)
    renderer = Silhouette()
    frame, alpha = exposed(passing, 1, renderer.render, 0.5)
    assert len(renderer.centres) in (7, 8)
    x = np.sort(np.array(renderer.centres)[:, 0])
    assert np.ptp(x) == pytest.approx(18 * (1 - 1 / len(x)), abs=2)
    sharp = Silhouette()
    exposed(passing, 1, sharp.render, 0.0)
    assert len(sharp.centres) == 1
    np.testing.assert_allclose(np.mean(renderer.centres, 0), sharp.centres[0], atol=0.2)
    assert 0 < alpha.max() < 1
    assert (frame.alpha <= alpha + 1e-6).all()


def test_a_still_hand_is_rendered_once(shots):
    renderer = Silhouette()
    exposed(shots, 0, renderer.render, 0.5)
    assert len(renderer.centres) == 1
    assert [sample_count(moved) for moved in (0.0, 1.4, 1.6, 9.0, 300.0)] == [1, 1, 2, 4, 8]


def test_a_written_video_is_read_again(tmp_path):
    pytest.importorskip("av", reason="PyAV (the extra video) is not installed")
    from livehand.backend.tracking.video import open_video

    times = np.array([0, 0.04, 0.1])
    pictures = [np.full((33, 47, 3), 60 * index, np.uint8) for index in range(3)]
    assert write_video(iter(pictures), tmp_path / "a.mp4", times, 25.0) == 3
    frames = list(open_video(tmp_path / "a.mp4").frames())
    np.testing.assert_allclose([frame.time_s for frame in frames], times, atol=1e-3)
    assert frames[1].picture.shape == (32, 46, 3)
    assert abs(int(frames[2].picture.mean()) - 120) <= 3
