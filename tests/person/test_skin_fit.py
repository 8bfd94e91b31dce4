"""A hand that lies off goes back to where the pictures show its skin."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.person.lit_model.illumination import Illumination, lobe_directions
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations
from livehand.backend.person.person_avatar import shipped_bases
from livehand.backend.person.rig.rig_cameras import turned
from livehand.backend.person.skin_fit import fitted_to_skin
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN
from livehand.tests.person.conftest import MADE_FOCAL_PX, pictured
from scipy.ndimage import binary_erosion, gaussian_filter

pytestmark = pytest.mark.slow
OFF_M = np.array([0.002, -0.0015, 0.002])
TURN_RAD = 0.004
EDGE_PX = 4
PIXEL_M = 0.42 / MADE_FOCAL_PX  # at the hand
FINGERS_MM = 0.1


@pytest.fixture(scope="module")
def spotted():
    """A person with spots, and a light."""
    spots = gaussian_filter(np.random.default_rng(0).normal(size=(256, 256)), 2.5)
    steps = (40 * spots / np.abs(spots).max()).round().astype(np.int8)
    light = Illumination(np.full(len(lobe_directions()), 0.1), np.ones(3))
    return shipped_bases(load_default_hand()).models[0.42].with_ratio(np.repeat(steps[..., None], 3, 2)), light


def without_edges(picture):
    """Nothing is known but what lies well inside the hand."""
    inner = binary_erosion(picture.labels == HAND, iterations=EDGE_PX)
    return replace(picture, labels=np.where(inner, HAND, UNKNOWN).astype(np.uint8))


def before_a_bright_ground(picture):
    """The ground shines over the hand's edge, by a pixel."""
    is_hand = binary_erosion(picture.labels == HAND)
    labels = np.where(is_hand, HAND, BACKGROUND).astype(np.uint8)
    return replace(picture, labels=labels, rgb=np.where(is_hand[..., None], picture.rgb, np.uint8(250)))


def moved(picture, index):
    pose = replace(picture.pose, transl=picture.pose.transl + OFF_M)
    turn = np.array([0.0, TURN_RAD if index == 2 else 0.0, 0.0, 0.0])
    return replace(picture, pose=pose, camera=turned(picture.camera, turn))


def off_px(model, pictures, truth):
    """Mean distance of the hand's points from where each picture shows them."""
    places = []
    for picture, true in zip(pictures, truth, strict=True):
        points = [
            one.camera.project(model.vertices(one.pose)[model.hand.framed_vertices])[0] for one in (picture, true)
        ]
        places.append(np.linalg.norm(points[0] - points[1], axis=1).mean())
    return np.array(places)


@pytest.mark.parametrize("sees_edges", [pytest.param(True, marks=pytest.mark.nightly), False])
def test_skin_brings_hand_and_cameras_back(spotted, sees_edges):
    model, light = spotted
    hand = pictured(model, light.light)
    given = [picture if sees_edges else without_edges(picture) for picture in hand.pictures]
    off = [moved(picture, index) for index, picture in enumerate(given)]
    found = fitted_to_skin(model, replace(hand, pictures=tuple(off)), PictureIlluminations({0: light}))
    before, after = (off_px(model, pictures, hand.pictures)[:-1] for pictures in (off, found.pictures))
    assert before.min() > 1
    assert after.max() < 0.5 * before.min()
    assert np.abs(found.offset_m).max() < 2 * PIXEL_M  # outlines are of whole pixels, on both sides
    held_out = found.pictures[-1]
    assert (held_out.camera.K == hand.pictures[-1].camera.K).all()
    assert (held_out.labels == given[-1].labels).all()


def test_a_hand_in_its_place_neither_swells_nor_shrinks(spotted):
    """Its surface lies outside the mesh, by an eighth of a millimetre and more at fingers: the outlines are its own."""
    model, light = spotted
    hand = pictured(model, light.light)
    assert abs(of_fingers_mm(model, fitted_to_skin(model, hand, PictureIlluminations({0: light})))) < FINGERS_MM


def test_bright_grounds_make_no_hand_thinner(spotted):
    model, light = spotted
    hand = pictured(model, light.light)
    pictures = [before_a_bright_ground(one) if index < 3 else one for index, one in enumerate(hand.pictures)]
    found = fitted_to_skin(model, replace(hand, pictures=tuple(pictures)), PictureIlluminations({0: light}))
    assert abs(of_fingers_mm(model, found)) < FINGERS_MM


def of_fingers_mm(model, found):
    """The mean offset of fingers' vertices."""
    fingers = model.hand.lbs_weights[:, 1:].sum(1) > 0.99
    return 1000 * found.offset_m[fingers].mean()
