"""Where a pressed hand lacks blood: in its pads, and in the beds of the nails across from them."""

import numpy as np
import pytest
from livehand.backend.surface.blood import Blanching
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.backend.surface.detail_surface import load_detail_surface

PRESSED_M = 0.0008


@pytest.fixture(scope="module")
def template(hand):
    return DetailTemplate.of(load_detail_surface(hand.sha256), hand)


def test_half_of_what_can_leave_has_left_at_four_tenths_of_a_millimetre(hand, template):
    found = Blanching.of(np.full(len(hand.v_template), 0.0004), template).bloodless
    np.testing.assert_allclose(found, 0.3, atol=1e-5)


def test_a_pressed_fingertip_squeezes_its_own_nails_bed(hand, template):
    """Near the free edge most; other fingers, and the skin of the finger's back, keep their blood."""
    rest, weights = template.rest_vertices().numpy(), hand.lbs_weights[:, 3]
    middle = hand.v_template[weights > 0.5].mean(0)
    is_pad = (weights > 0.9) & (hand.v_template[:, 1] < middle[1] - 0.004)
    assert is_pad.sum() > 3
    found = Blanching.of(np.where(is_pad, PRESSED_M, 0.0), template)
    squeezed, place = found.under_nails.numpy(), rest - middle
    is_above = (np.abs(place[:, 2]) < 0.003) & (place[:, 1] > 0.003) & (np.linalg.norm(place, axis=1) < 0.012)
    along = hand.joints[3] - hand.joints[2]
    ahead_m = place @ along / np.linalg.norm(along)
    far, near = squeezed[is_above & (ahead_m > 0)].mean(), squeezed[is_above & (ahead_m < -0.005)].mean()
    assert far > 0.15
    assert far > near + 0.03
    assert squeezed[np.linalg.norm(place, axis=1) > 0.035].max() < 1e-3
    assert found.bloodless.numpy()[is_above].max() < 0.05


def test_what_is_not_pressed_keeps_its_blood(hand, template):
    found = Blanching.of(np.zeros(len(hand.v_template)), template)
    assert found.bloodless.max() == found.under_nails.max() == 0
