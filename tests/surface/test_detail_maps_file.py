"""The maps of the built-in skin's fine detail, as they ship."""

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.surface.detail_maps_file import (
    ATLAS_MM,
    COARSEST_MM,
    FULL_FLEX_RAD,
    WIDEST_MM,
    load_surface_detail,
)
from livehand.tools.builtin_hand import TEMPLATE


@pytest.fixture(scope="module")
def detail(hand):
    return load_surface_detail(hand.sha256)


def blocks(values, size):
    """Means over blocks."""
    count = len(values) // size
    return values[: count * size, : count * size].reshape(count, size, count, size).mean((1, 3))


@pytest.mark.parametrize("name", ["relief_mm", "dorsal", "palmar", "pigment_light", "pigment_deep"])
def test_maps_hold_detail_and_nothing_coarse(detail, name):
    values = getattr(detail.fine, name)
    texel_mm = ATLAS_MM / len(values)
    coarse = blocks(values, round(8 * COARSEST_MM / texel_mm))
    assert values.std() > 0.005
    assert coarse.std() < 0.15 * values.std()


@pytest.mark.parametrize("name", ["relief_mm", "dorsal", "palmar", "pigment_light", "pigment_deep"])
def test_coarse_maps_hold_what_lies_between(detail, name):
    values = getattr(detail.coarse, name)
    texel_mm = ATLAS_MM / len(values)
    fine = np.abs(np.diff(values, axis=1)).mean()
    assert values.std() > 0.01
    assert fine < 0.5 * values.std()  # smooth from texel to texel
    assert blocks(values, round(6 * WIDEST_MM / texel_mm)).std() < 0.15 * values.std()


def test_nails_have_rims_and_ridges_lie_on_the_palm_alone(hand, detail):
    assert detail.fine.relief_mm.max() > 0.1  # the rim of a nail
    at = np.floor(hand.vt[:, ::-1] * len(detail.fine.palmar)).astype(int).clip(0, len(detail.fine.palmar) - 1)
    assert (detail.fine.palmar[tuple(at.T)] != 0).mean() > 0.1


def test_five_nails_are_at_the_fingers_ends_and_have_the_size_of_nails(hand, detail):
    texel_mm = ATLAS_MM / len(detail.nail)
    assert 5 * 80 < (detail.nail > 0.5).sum() * texel_mm**2 < 5 * 180
    row, column = np.floor(hand.vt[:, ::-1] * len(detail.nail)).astype(int).clip(0, len(detail.nail) - 1).T
    corners = detail.nail[row, column][hand.ft] > 0.5
    assert set(hand.lbs_weights.argmax(1)[hand.f[corners]]) == {3, 6, 9, 12, 15}


def test_skin_bends_with_its_joint_and_the_palm_with_a_share_of_the_knuckles(detail):
    theta = np.zeros((16, 3))
    theta[5] = 0.5 * FULL_FLEX_RAD * detail.bend.flexion[5]
    flex = detail.bend.flex(theta)
    assert flex[detail.bend.joint == 5] == pytest.approx(0.5)
    assert not flex[(detail.bend.joint > 0) & (detail.bend.joint != 5)].any()
    assert not flex[detail.bend.joint == 0].any()
    theta[4] = FULL_FLEX_RAD * detail.bend.flexion[4]
    assert detail.bend.flex(theta)[detail.bend.joint == 0] == pytest.approx(0.6 / 4)
    assert detail.bend.flex(-theta).max() == 0  # stretched


def test_every_vertex_has_a_joint_of_its_own_hand(hand, detail):
    assert detail.bend.joint.shape == (len(hand.v_template),)
    assert set(np.unique(detail.bend.joint)) <= set(range(16))
    lengths = np.linalg.norm(detail.bend.flexion, axis=1)
    assert lengths[1:] == pytest.approx(1, abs=1e-5)


def test_other_hands_have_no_known_detail():
    assert load_surface_detail(load_hand_model(TEMPLATE).sha256) is None
    assert load_surface_detail("0" * 64) is None
