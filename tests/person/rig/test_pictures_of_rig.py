"""Views of a rig become pictures of each hand; a left one's are mirrored with all that belongs to them."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.picture import linear_to_srgb, srgb_to_linear
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.person.camera_gains import with_camera_gains
from livehand.backend.person.rig import pictures_of_rig as room
from livehand.backend.person.rig.pictures_of_rig import mirrored_camera, pictured_hands, pictures_of_rig
from livehand.backend.person.rig.rig_fit import FittedRig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HAND, UNKNOWN

pytestmark = pytest.mark.slow
GAIN = (0.6, 0.7, 0.8)


@pytest.fixture(scope="module")
def fitted(made_rig):
    """The truth as if it had been fitted."""
    labels = tuple(made_rig.labels())
    return FittedRig(
        poses=made_rig.poses,
        offset_m={side: np.full(len(made_rig.model.v_template), 1e-3) for side in made_rig.poses},
        cameras=made_rig.cameras,
        labels=labels,
        meshes=labels,
        px_per_mm=(0.85,) * 8,
        turns=np.zeros((8, 4)),
        off_px={},
        overlaps={},
    )


def test_a_mirrored_camera_sees_the_mirrored_world_mirrored(made_rig):
    camera, points = made_rig.cameras[2], made_rig.points[0]
    px, depth = camera.project(points)
    mirrored_px, mirrored_depth = mirrored_camera(camera).project(points * (-1, 1, 1))
    assert mirrored_px == pytest.approx(np.stack([camera.size_px[0] - px[:, 0], px[:, 1]], 1))
    assert mirrored_depth == pytest.approx(depth)


def test_each_hand_has_its_pictures_where_its_pose_is_projected(made_rig, fitted):
    views = made_rig.views()
    hands = pictured_hands(views, fitted, [3], "made")
    assert set(hands) == {"right", "left"}
    for side, hand in hands.items():
        assert hand.side == side
        assert hand.source == "made"
        assert hand.offset_m[0] == 1e-3
        assert [picture.camera_index for picture in hand.pictures if picture.is_held_out] == [6]
        for picture in hand.pictures:
            vertices = posed_vertices(made_rig.model, picture.pose)[made_rig.model.arm_weights < 0.5]
            px = picture.camera.project(vertices)[0]
            column, row = np.floor(px).astype(int).T
            is_inside = ((px >= 0) & (px < picture.camera.size_px)).all(1)
            labels = picture.labels[row[is_inside], column[is_inside]]
            assert np.isin(labels, (HAND, UNKNOWN)).mean() > 0.9
            skin = picture.rgb[picture.labels == HAND].astype(float)
            assert skin.mean(0) == pytest.approx((193, 138, 108), abs=12)


def test_a_camera_s_gain_is_found_but_for_one_held_out(made_rig, fitted):
    def gains(views):
        hands = with_camera_gains(pictured_hands(views, fitted, [3], "made"), made_rig.model)
        return {picture.camera_index: np.array(picture.log_gain) for picture in hands["left"].pictures}

    views = made_rig.views()
    even = gains(views)
    for row in (2, 3):
        linear = srgb_to_linear(views[row].rgb / 255.0) * GAIN
        views[row] = replace(views[row], rgb=(255 * linear_to_srgb(linear)).round().astype(np.uint8))
    changed = gains(views)
    others = [number for number in even if number not in (4, 6)]
    change = changed[4] - even[4] - np.mean([changed[number] - even[number] for number in others], 0)
    assert change == pytest.approx(np.log(GAIN), abs=0.05)
    assert not changed[6].any()


def test_a_view_that_shows_too_little_is_left_out(made_rig, fitted):
    labels = [part.copy() for part in fitted.labels]
    labels[5][labels[5] == 1] = 0
    labels[5][100:110, 100:110] = 1
    changed = FittedRig(**{**fitted.__dict__, "labels": tuple(labels)})
    hands = pictured_hands(made_rig.views(), changed, [], "made")
    assert 10 not in [picture.camera_index for picture in hands["right"].pictures]
    assert 10 in [picture.camera_index for picture in hands["left"].pictures]


def test_no_hand_in_three_views_is_refused(made_rig, fitted):
    none = FittedRig(**{**fitted.__dict__, "labels": tuple(np.zeros_like(part) for part in fitted.labels)})
    with pytest.raises(LiveHandError, match="shown free by at least 3 cameras"):
        pictured_hands(made_rig.views(), none, [], "made")


def test_cameras_to_hold_out_must_be_the_rig_s(made_rig, monkeypatch):
    monkeypatch.setattr(room, "read_rig", lambda folder, instant: tuple(made_rig.views()))
    with pytest.raises(LiveHandError, match=r"must be among \[0, 2, 4, .*, 14\], got \[3\]"):
        pictures_of_rig("made", [3])


def test_a_folder_s_hands_are_those_of_its_fit(made_rig, fitted, monkeypatch):
    monkeypatch.setattr(room, "read_rig", lambda folder, instant: tuple(made_rig.views()))
    monkeypatch.setattr(room, "load_networks", lambda: None)
    monkeypatch.setattr(room, "fitted_rig", lambda views, networks, model, rows, say: fitted)
    hands = pictures_of_rig("folder/made", [6])
    assert {hand.source for hand in hands.values()} == {"made"}
    assert {one.camera_index for hand in hands.values() for one in hand.pictures if one.is_held_out} == {6}
