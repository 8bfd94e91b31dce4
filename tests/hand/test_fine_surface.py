"""The fine surface that ships: that of the generator, to the steps of its file; and what a pose raises on it."""

import numpy as np
import pytest
from livehand.backend.hand.builtin.detailed_surface import detailed_surface
from livehand.backend.hand.builtin.fine_offsets import fine_surface
from livehand.backend.hand.builtin.loop import subdivide
from livehand.backend.hand.fine_surface import HEIGHT_STEP_MM, LEVELS, VEIN_STEP, load_fine_surface, surface_arrays
from livehand.backend.hand.model_file import WITHOUT_ARM, load_hand_model


@pytest.fixture(scope="module")
def shipped(hand):
    return load_fine_surface(hand.sha256)


def test_a_hand_of_others_has_none(hand):
    assert load_fine_surface("0" * 64) is None
    assert load_fine_surface(load_hand_model(WITHOUT_ARM).sha256) is None


def test_the_file_that_ships_is_the_generator_s(hand, shipped):
    """Made of two levels where the file is made of three: vertices relax along the surface, but lie on it."""
    made = fine_surface(hand, detailed_surface(hand, levels=LEVELS))
    assert made.offset_m.shape == shipped.offset_m.shape
    matrix = subdivide(hand.f, hand.vt[hand.ft], len(hand.v_template), LEVELS).matrix
    there, here = (matrix @ hand.v_template + each.offset_m for each in (shipped, made))
    apart_mm = 1e3 * np.linalg.norm(there - here, axis=1)
    assert np.median(apart_mm) < 0.3
    assert len(made.raised.forms) == len(shipped.raised.forms)
    for ours, theirs in zip(made.raised.forms, shipped.raised.forms, strict=True):
        assert (ours.joint, ours.start_deg, ours.full_deg) == (theirs.joint, theirs.start_deg, theirs.full_deg)
        assert np.corrcoef(ours.height_mm, theirs.height_mm)[0, 1] > 0.9


def test_the_file_s_steps_are_small(hand, shipped):
    again = surface_arrays(shipped)
    np.testing.assert_allclose(again["height"][0] * HEIGHT_STEP_MM, shipped.raised.forms[0].height_mm, atol=1e-6)
    np.testing.assert_allclose(again["vein"] * VEIN_STEP, shipped.raised.vein, atol=1e-6)
    assert np.abs(again["offset"]).max() < np.iinfo(np.int16).max


def test_heights_beyond_the_steps_are_an_error(shipped):
    form = shipped.raised.forms[0]
    with pytest.raises(ValueError, match="more steps"):
        surface_arrays(
            type(shipped)(
                shipped.offset_m,
                type(shipped.raised)(
                    (type(form)(form.joint, 0.0, 1.0, form.height_mm + 4.0),),
                    shipped.raised.vein,
                    shipped.raised.flexion,
                ),
            )
        )


def test_a_fist_raises_knuckles_and_rest_nothing(shipped):
    rest = np.zeros((16, 3))
    np.testing.assert_array_equal(shipped.raised.height_mm(rest, 0.0), 0)
    bent = rest.copy()
    bent[4] = np.deg2rad(90) * shipped.raised.flexion[4]  # the middle finger's knuckle
    assert 2 < shipped.raised.height_mm(bent, 0.0).max() < 3.5


def test_veins_are_as_high_as_asked_and_higher_in_a_clenched_hand(shipped):
    rest, clenched = np.zeros((16, 3)), np.zeros((16, 3))
    clenched[[1, 4, 7, 10]] = np.deg2rad(80) * shipped.raised.flexion[[1, 4, 7, 10]]
    on_vein = shipped.raised.vein > 0.9
    assert on_vein.any()
    flat = shipped.raised.height_mm(rest, 0.4)[on_vein]
    np.testing.assert_allclose(flat, 0.4 * 0.75 * shipped.raised.vein[on_vein])
    raised = shipped.raised.height_mm(clenched, 0.4) - shipped.raised.height_mm(clenched, 0.0)
    np.testing.assert_allclose(raised[on_vein], 0.4 * 1.25 * shipped.raised.vein[on_vein], atol=1e-6)
