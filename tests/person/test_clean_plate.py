"""A plate without the hand, and the pixels in front of it, by mixtures of known colours."""

import numpy as np
import pytest
from livehand.backend.capture.picture import linear_to_srgb, srgb_to_linear
from livehand.backend.person.clean_plate import CleanPlate, clean_plate, plate_labels, small_enough
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN
from livehand.backend.tracking.turning_hand.window import Window

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")

TABLE, SKIN = np.array([0.5, 0.5, 0.46]), np.array([0.42, 0.2, 0.13])  # linear
SIZE_PX = 60, 40


def encoded(linear):
    return (255 * linear_to_srgb(np.asarray(linear, float).clip(0, 1))).round().astype(np.uint8)


def table(shade=1.0):
    rows, columns = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    pattern = 0.8 + 0.2 * np.sin(columns / 5) * np.cos(rows / 7)
    return TABLE * (pattern * shade)[..., None]


def film(frames=9, width=12):
    """Pictures of a hand that moves across a table, casting a shadow beside it, and where it is."""
    columns = np.arange(SIZE_PX[0])
    pictures, covered = [], []
    for first in np.linspace(0, SIZE_PX[0] - width, frames).astype(int):
        is_hand = (columns >= first) & (columns < first + width)
        is_shaded = (columns >= first + width) & (columns < first + 2 * width)
        linear = table(np.where(is_shaded, 0.5, 1.0))
        linear[:, is_hand] = SKIN
        pictures.append(encoded(linear))
        covered.append(np.broadcast_to(is_hand, SIZE_PX[::-1]))
    return pictures, covered


@pytest.fixture
def plate():
    return clean_plate(*film(), SIZE_PX)


def test_the_plate_is_the_table_without_hand_and_shadow(plate):
    assert plate.is_known.all()
    np.testing.assert_allclose(plate.rgb, encoded(table()), atol=1)


def test_what_hardly_any_picture_shows_is_not_known():
    pictures, covered = film()
    always = np.zeros(SIZE_PX[::-1], bool)
    always[:, 20:30] = True
    found = clean_plate(pictures, [each | always for each in covered], SIZE_PX)
    np.testing.assert_array_equal(found.is_known, ~always)


def test_what_changes_its_colour_is_not_known():
    """A thing that is taken away in the middle of the film."""
    pictures, covered = film()
    for picture in pictures[:5]:
        picture[5:15, 1:9] = (30, 60, 160)
    known = clean_plate(pictures, covered, SIZE_PX).is_known
    assert not known[5:15, 1:9].any()
    assert known[20:].all()


def test_large_pictures_are_made_smaller_and_the_plate_large_again():
    large = np.full((400, 2560, 3), 120, np.uint8)
    assert small_enough(large).shape == (200, 1280, 3)
    assert small_enough(large[:, :1280]).shape == (400, 1280, 3)
    found = clean_plate([small_enough(large)] * 4, [np.zeros((10, 64), bool)] * 4, (2560, 400))
    assert found.rgb.shape == (400, 2560, 3)
    assert found.is_known.all()
    assert (found.rgb == 120).all()


def test_a_window_of_the_plate_is_that_of_the_picture(plate):
    part = plate.within(Window(50, 30, (20, 20), 0.5))  # goes beyond the picture
    assert part.rgb.shape == (10, 10, 3)
    assert part.is_known.shape == (10, 10)
    np.testing.assert_allclose(part.rgb[0, 0], plate.rgb[30:32, 50:52].mean((0, 1)), atol=1)


def labels_of(linear, plate=None, skin=np.s_[:, :10], ground=np.s_[:, 50:]):
    masks = np.zeros((2, *SIZE_PX[::-1]), bool)
    masks[0][skin], masks[1][ground] = True, True
    whole = CleanPlate(encoded(table()), np.ones(SIZE_PX[::-1], bool))
    return plate_labels(encoded(linear), plate or whole, *masks)


def picture(share, shade=1.0, skin_shade=1.0):
    """Skin at the left, of which this share covers the middle, and the table at the right."""
    linear = table()
    linear[:, :10] = SKIN
    linear[:, 20:40] = share * skin_shade * SKIN + (1 - share) * shade * table()[:, 20:40]
    return linear


@pytest.mark.parametrize("exposure", [1.0, 1.5])
@pytest.mark.parametrize(("share", "label"), [(0.0, BACKGROUND), (0.35, BACKGROUND), (0.65, HAND), (1.0, HAND)])
def test_the_larger_part_of_a_mixture_has_the_pixel(share, label, exposure):
    """In a column of pixels at the edge of the skin."""
    linear = picture(0.0)
    linear[:, 10:11] = share * SKIN + (1 - share) * table()[:, 10:11]
    labels = labels_of(exposure * linear)
    assert (labels[2:-2, 10] == label).all()
    assert (labels[:, :10] == HAND).all()
    assert (labels[:, 11:] == BACKGROUND).all()


def test_edges_are_as_wide_as_the_picture_is_large():
    """A hundredth of it: of a strip of five pixels beside the skin, three may be the skin's."""
    linear = picture(0.0)
    linear[:, 10:11] = 0.65 * SKIN + 0.35 * table()[:, 10:11]
    large, ground = (encoded(np.kron(each, np.ones((5, 5, 1)))) for each in (linear, table()))
    masks = np.zeros((2, *large.shape[:2]), bool)
    masks[0][:, :50], masks[1][:, 250:] = True, True
    labels = plate_labels(large, CleanPlate(ground, np.ones(large.shape[:2], bool)), *masks)
    assert (labels[10:-10, 50:53] == HAND).all()
    assert (labels[10:-10, 53:] == BACKGROUND).all()


def test_what_mixes_both_far_from_skin_is_ground_that_skin_shines_on():
    labels = labels_of(picture(0.65))
    assert (labels[2:-2, 22:38] == BACKGROUND).all()
    assert (labels_of(picture(1.0))[2:-2, 22:38] == HAND).all()


def test_dark_ground_takes_nothing_from_skin():
    """Over a black mat shaded skin might be skin and mat, both in full light: it is the skin's light that counts."""
    mat = CleanPlate(encoded(0.03 * table()), np.ones(SIZE_PX[::-1], bool))
    linear = 0.03 * table()
    linear[:, :40] = SKIN
    linear[:, 20:40] *= 0.65
    assert (labels_of(linear, mat)[2:-2, 22:38] == HAND).all()


def test_a_shadow_on_the_ground_is_ground_and_shaded_skin_is_skin():
    assert (labels_of(picture(0.0, shade=0.45))[2:-2, 22:38] == BACKGROUND).all()
    assert (labels_of(picture(1.0, skin_shade=0.6))[2:-2, 22:38] == HAND).all()


def test_skin_in_deep_shade_is_not_told():
    """Ground in the shade of a fist has skin's colour, too."""
    assert (labels_of(picture(1.0, skin_shade=0.25))[2:-2, 22:38] == UNKNOWN).all()


def test_what_is_neither_or_dark_or_brighter_than_the_plate_is_not_told():
    linear = picture(0.0)
    linear[:10, 20:40] = (0.05, 0.1, 0.6)  # a thing that the plate does not show
    linear[12:22, 20:40] = 0.1 * SKIN
    linear[25:, 20:40] *= 1.6
    labels = labels_of(linear)
    assert (labels[2:8, 22:38] == UNKNOWN).all()
    assert (labels[14:20, 22:38] == UNKNOWN).all()
    assert (labels[27:38, 22:38] == UNKNOWN).all()


def test_ground_of_skins_colour_is_not_told():
    skin_like = CleanPlate(encoded(np.broadcast_to(0.9 * SKIN, (*SIZE_PX[::-1], 3))), np.ones(SIZE_PX[::-1], bool))
    linear = np.broadcast_to(SKIN, (*SIZE_PX[::-1], 3))
    assert (labels_of(linear, skin_like) == UNKNOWN).all()


def test_nothing_is_sure_where_the_plate_or_the_skin_is_not_known():
    known = np.ones(SIZE_PX[::-1], bool)
    known[:, 30:] = False
    labels = labels_of(picture(1.0), CleanPlate(encoded(table()), known), ground=np.s_[:, 12:18])
    assert (labels[:, 30:] == UNKNOWN).all()
    assert (labels[2:-2, 22:29] == HAND).all()
    assert (labels_of(picture(1.0), skin=np.s_[:0]) == UNKNOWN).all()


def test_colours_are_mixed_as_light():
    """Half skin, half table, encoded as a camera does."""
    middle = srgb_to_linear(encoded(0.5 * (SKIN + TABLE)) / 255.0)
    np.testing.assert_allclose(middle, 0.5 * (SKIN + TABLE), atol=0.005)
