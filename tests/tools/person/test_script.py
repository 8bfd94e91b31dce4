"""A stranger's film and scenes: where the hand is, and which side of it is seen."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import posed_vertices
from livehand.tools.person.script import (
    BACK_FRAMES,
    FILM_SIZE_PX,
    FPS,
    FRAMES,
    film_cameras,
    film_light,
    film_motion,
    kept_scenes,
    yaw_deg,
)
from livehand.tools.person.strangers import STRANGERS

STRANGER = STRANGERS["stranger1"]
BETA = np.array(STRANGER.person.beta)


@pytest.fixture(scope="module")
def motion(hand):
    return film_motion(hand, BETA, STRANGER.seed)


def facing(theta, camera):
    """Cosine between the back of the hand, +Y of the template, and the direction to the camera."""
    return float(-(axis_angle_to_matrix(theta[0]) @ [0, 1.0, 0]) @ camera.cam2world[:3, 2])


def test_the_film_shows_the_back_first_and_then_all_sides(motion):
    cosines = [facing(theta, camera) for theta, camera in zip(motion.theta, film_cameras(), strict=True)]
    assert len(cosines) == FRAMES == 72
    assert min(cosines[:BACK_FRAMES]) > 0.3
    assert max(cosines) > 0.95
    assert min(cosines) < -0.9
    turned = motion.theta[:, 0]
    across = [(axis_angle_to_matrix(root) @ [0, 0, 1.0])[1] for root in turned]
    assert min(across) < -0.8
    assert max(across) > 0.75


def test_the_hand_stays_in_the_picture_about_45_cm_away(motion, hand):
    is_hand = hand.arm_weights < 0.5
    for index, camera in enumerate(film_cameras()):
        at_px, depth_m = camera.project(posed_vertices(hand, motion.pose(index))[is_hand])
        assert at_px.min() > 0
        assert (at_px.max(0) < FILM_SIZE_PX).all()
        assert depth_m.mean() == pytest.approx(0.45, abs=0.05)


def test_the_hand_turns_slowly_enough_to_be_followed(motion):
    roots = axis_angle_to_matrix(motion.theta[:, 0])
    cosines = (np.einsum("tab,tab->t", roots[1:], roots[:-1]) - 1) / 2
    assert np.rad2deg(np.arccos(cosines)).max() < 20
    assert np.rad2deg(np.abs(np.diff(motion.theta[:, 1:], axis=0))).max() < 25


def test_the_yaw_keeps_its_keys():
    assert yaw_deg(np.array([0.0, 5, 9, 12])) == pytest.approx([180, 205, 0, -60])
    assert FPS * 5 == BACK_FRAMES


def test_kept_scenes_show_the_hand_in_other_lights(hand):
    scenes = kept_scenes(hand, BETA)
    is_hand = hand.arm_weights < 0.5
    assert len({scene.name for scene in scenes}) == len(scenes) == 6
    for scene in scenes:
        at_px, _ = scene.camera.project(posed_vertices(hand, scene.pose)[is_hand])
        is_inside = ((at_px > 0) & (at_px < scene.camera.size_px)).all(1)
        assert is_inside.mean() > 0.97  # the tip of a thumb may be outside
        assert not np.array_equal(scene.light.sky.radiance, film_light().sky.radiance)
    assert len({id(scene.light) for scene in scenes}) == 3
