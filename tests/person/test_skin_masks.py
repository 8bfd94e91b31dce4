"""Labels against painted truth: webs, the wrist, what is worn, and gloves."""

import numpy as np
import pytest
from livehand.backend.person.clean_plate import CleanPlate
from livehand.backend.person.skin_masks import labelled, skin_colours
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN
from livehand.tests.person.conftest import GLOVE, SKIN

pytestmark = pytest.mark.slow

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")


def labels_of(hand, *shown):
    return labelled([one.rgb for one in shown], [one.pose for one in shown], [one.camera for one in shown], hand)


@pytest.fixture(scope="module")
def off(painted, hand):
    """A picture whose pose is 4 mm off, across the fingers, and its labels."""
    shown = painted(off_m=0.004)
    return shown, labels_of(hand, shown, painted(roll_rad=0.5))[0]


def test_the_hand_is_found_though_its_pose_is_off(off):
    shown, labels = off
    known = labels != UNKNOWN
    is_hand = labels == HAND
    assert (is_hand & shown.is_hand).sum() / ((is_hand | shown.is_hand) & known).sum() > 0.96
    assert known[shown.is_hand].mean() > 0.97


def test_the_ground_between_the_fingers_is_ground(off):
    """The mesh, which is off, lies on it."""
    shown, labels = off
    is_ground = ~shown.is_hand & ~shown.is_arm & (labels != UNKNOWN)
    assert (labels[is_ground] == HAND).mean() < 0.01


def test_a_clean_plate_finds_the_edge_that_motion_smears(painted, hand):
    """The hand moves by 9 px across its fingers while the picture is exposed; the middle of the smear is its edge."""
    shown, empty = painted(), painted(is_shown=False).rgb
    steps = [np.roll(shown.rgb, shift, 0).astype(float) ** 2.2 for shift in range(-4, 5)]
    shown.rgb[:] = (np.mean(steps, 0) ** (1 / 2.2)).round()
    plate = CleanPlate(empty, np.ones(empty.shape[:2], bool))
    overlaps = []
    for plates in (None, [plate]):
        (labels,) = labelled([shown.rgb], [shown.pose], [shown.camera], hand, plates=plates)
        known, is_hand = labels != UNKNOWN, labels == HAND
        overlaps.append((is_hand & shown.is_hand).sum() / ((is_hand | shown.is_hand) & known).sum())
    assert overlaps[1] > 0.95
    assert overlaps[1] > overlaps[0] + 0.02


def test_fingers_in_deep_shade_are_hand_or_unknown(painted, hand):
    """As those of a fist: nothing tells them from the ground in that shade."""
    shown, empty = painted(), painted(is_shown=False).rgb
    _, columns = np.nonzero(shown.is_hand)
    across = np.arange(shown.rgb.shape[1])
    is_shaded = np.broadcast_to(across < columns.min() + 30, shown.is_hand.shape)
    tips = shown.is_hand & is_shaded
    shown.rgb[is_shaded] = 0.25 * empty[is_shaded]
    shown.rgb[tips] = (24, 20, 18)
    plate = CleanPlate(empty, np.ones(empty.shape[:2], bool))
    (labels,) = labelled([shown.rgb], [shown.pose], [shown.camera], hand, plates=[plate])
    assert (labels[tips] == BACKGROUND).mean() < 0.1
    assert (labels[:, : columns.min() - 6] == BACKGROUND).mean() > 0.9


def test_red_fingertips_are_skin(painted, hand):
    shown = painted()
    _, columns = np.nonzero(shown.is_hand)
    tips = shown.is_hand & (np.arange(shown.rgb.shape[1]) < columns.min() + 14)
    shown.rgb[tips] = (220, 105, 95)
    (labels,) = labels_of(hand, shown)
    assert (labels[tips] == HAND).mean() > 0.9


def test_an_arm_that_bends_is_unknown_without_a_spike(off):
    shown, labels = off
    assert shown.is_arm.sum() > 500
    assert (labels[shown.is_arm] == UNKNOWN).mean() > 0.9
    assert (labels[shown.is_arm] == HAND).mean() < 0.06


def test_what_is_worn_is_unknown(painted, hand):
    shown = painted()
    _, columns = np.nonzero(shown.is_hand)
    middle = int(np.median(columns))
    ring = shown.is_hand & (np.abs(np.arange(shown.rgb.shape[1]) - middle) < 8)
    shown.rgb[ring] = (90, 120, 200)
    (labels,) = labels_of(hand, shown)
    assert (labels[ring] == UNKNOWN).mean() > 0.7
    assert (labels[shown.is_hand & ~ring] == HAND).mean() > 0.85


def test_a_sleeve_that_looks_like_the_ground_is_unknown(painted, hand):
    """It covers the mesh's end, which would be an outline that is not the hand's."""
    shown = painted(bend_rad=0.0)
    _, columns = np.nonzero(shown.is_hand)
    at = np.arange(shown.rgb.shape[1])
    is_sleeve = shown.is_hand & (at > columns.max() - 0.1 * np.ptp(columns))
    wider = (shown.is_arm | is_sleeve) & (at > columns.max() - 0.1 * np.ptp(columns))
    empty = painted(is_shown=False).rgb
    shown.rgb[wider] = empty[wider]
    (labels,) = labels_of(hand, shown)
    assert (labels[is_sleeve] == BACKGROUND).mean() < 0.05
    assert (labels[is_sleeve] == UNKNOWN).mean() > 0.5


def test_a_glove_is_told(painted, hand):
    with pytest.raises(LiveHandError, match=r"must have the colour of skin, got .* take off the glove"):
        labels_of(hand, painted(GLOVE))


def test_the_skins_colours_are_those_of_most_pixels():
    rng = np.random.default_rng(0)
    skin = np.clip(rng.normal(SKIN, 6, (4000, 3)), 0, 255).astype(np.uint8)
    worn = np.full((900, 3), (60, 90, 200), np.uint8)
    found = skin_colours([skin, np.concatenate([skin, worn])])
    red, green, blue = (np.array(SKIN) / 255) ** 2.2
    np.testing.assert_allclose(found.mean, np.log([red / green, blue / green]), atol=0.03)
    np.testing.assert_array_less(5, found.deviations(np.log([[0.3, 3.0]])))
    np.testing.assert_array_equal(found.deviations(found.mean[None]), 0)


def test_pictures_of_white_are_told():
    with pytest.raises(LiveHandError, match="skin that is not clipped"):
        skin_colours([np.full((10, 3), 255, np.uint8)])


def test_labels_are_those_three(off):
    assert set(np.unique(off[1])) == {BACKGROUND, HAND, UNKNOWN}
