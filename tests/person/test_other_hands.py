"""Other hands in a picture: unknown, with the skin beside them; the person's own hand stays."""

import numpy as np
import pytest
from livehand.backend.person.other_hands import in_window, where_hands_may_be, with_others_unknown
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")

OTHER_PX = np.array(
    [[60, 100]]
    + [[60 - 8 - 6 * k, 85 - 8 * k] for k in range(4)]
    + [[60 + 6 * finger - 9, 70 - 12 * k] for finger in range(4) for k in range(4)],
    float,
)


@pytest.fixture
def labels():
    """Skin at both hands [140, 300]; the mesh is the right one of them."""
    labels = np.full((140, 300), BACKGROUND, np.uint8)
    labels[20:120, 30:90] = HAND
    labels[20:120, 200:260] = HAND
    return labels


def test_the_other_hand_is_unknown_and_ones_own_stays(labels):
    silhouette = np.zeros(labels.shape, bool)
    silhouette[25:115, 205:255] = True
    found = with_others_unknown(labels, silhouette, [OTHER_PX])
    assert not (found[:, :100] == HAND).any()
    np.testing.assert_array_equal(found[:, 180:], labels[:, 180:])
    assert (found[tuple(OTHER_PX.astype(int).T[::-1])] == UNKNOWN).all()


def test_where_both_overlap_nothing_is_known(labels):
    silhouette = labels == HAND
    silhouette[:, 150:] = False
    found = with_others_unknown(labels, silhouette, [OTHER_PX])
    assert (found[60:100, 55:65] == UNKNOWN).all()
    assert (found[silhouette] != BACKGROUND).all()


def test_an_arm_does_not_cover_the_hand(labels):
    """The other hand points away from the mesh, and so its arm's line would cross it."""
    turned = OTHER_PX[:, ::-1] + [60, 10]
    silhouette = np.zeros(labels.shape, bool)
    silhouette[20:120, 200:260] = True
    found = with_others_unknown(labels, silhouette, [turned])
    assert (found[60:80, 160:198] == UNKNOWN).any()
    np.testing.assert_array_equal(found[silhouette], labels[silhouette])


def test_no_other_hand_changes_nothing(labels):
    outside = OTHER_PX + 5000
    for others in ([], [outside]):
        np.testing.assert_array_equal(with_others_unknown(labels, labels == HAND, others), labels)


def test_points_of_a_part():
    whole = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.eye(4), (640, 480))
    part = whole.cropped(100, 50, (200, 120))
    np.testing.assert_allclose(in_window(np.array([[150.0, 80], [100, 50]]), whole, part), [[50, 30], [0, 0]])
    np.testing.assert_allclose(in_window(np.array([150.0, 80]), whole, part.scaled(0.5)), [25, 15])


def test_what_hands_may_cover_holds_them_and_an_arm_that_bends():
    """The wrist is at (60, 100), the middle knuckle at (63, 70): the palm is about 30 px long."""
    covered = where_hands_may_be([OTHER_PX, OTHER_PX + np.array([180, 0])], (300, 200))
    assert covered[tuple(OTHER_PX.astype(int).T[::-1])].all()
    palm_px = np.linalg.norm(OTHER_PX[0] - OTHER_PX[9])
    for bend_rad in (-0.5, 0.0, 0.5):
        x, y = OTHER_PX[0] + 1.8 * palm_px * np.array([np.sin(bend_rad), np.cos(bend_rad)])
        assert covered[round(y), round(x)]
    assert not covered[:, 130:150].any()
    np.testing.assert_array_equal(
        covered[:, 180:300], np.pad(covered, ((0, 0), (0, 180)))[:, 0:120] | covered[:, 180:300]
    )
    assert not where_hands_may_be([], (30, 20)).any()
