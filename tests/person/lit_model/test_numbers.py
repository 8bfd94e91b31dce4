"""The skin's numbers from an observed albedo: blood, strength and tint of the light."""

import numpy as np
import pytest
from livehand.backend.person.lit_model.numbers import ToneFamily, fitted_numbers
from livehand.backend.surface.blood import BLOOD_LOG_ALBEDO

RNG = np.random.default_rng(4)
LIGHT = np.log([0.6, 0.35, 0.25]) + RNG.normal(0, 0.15, (300, 1)) + RNG.normal(0, 0.03, (300, 3))
DEEP = np.log([0.15, 0.06, 0.03]) + RNG.normal(0, 0.35, (300, 1)) + RNG.normal(0, 0.03, (300, 3))
FAMILY = ToneFamily(LIGHT, DEEP)


@pytest.mark.parametrize("melanin", [0.0, 0.42, 1.0])
@pytest.mark.parametrize("log_gain", [-0.5, 0.0, 0.7])
def test_the_strength_of_the_light_is_found(melanin, log_gain):
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(melanin, 1.0) + log_gain, np.ones(300), melanin)
    assert found.melanin == melanin
    assert found.log_gain == pytest.approx(log_gain, abs=1e-3)
    assert found.error < 1e-3


def test_blood_is_found_but_for_what_may_be_white_balance():
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(0.3, 1.4), np.ones(300), 0.3)
    assert 1.2 < found.blood < 1.4
    np.testing.assert_allclose(
        found.log_gain + found.log_tint + (found.blood - 1) * np.array(BLOOD_LOG_ALBEDO),
        0.4 * np.array(BLOOD_LOG_ALBEDO),
        atol=0.02,
    )


@pytest.mark.parametrize("tint", [(0.1, 0.0, -0.1), (-0.08, 0.0, 0.08)])
def test_a_tint_has_no_strength(tint):
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(0.42, 1.0) + np.array(tint), np.ones(300), 0.42)
    assert found.log_tint.sum() == pytest.approx(0, abs=1e-9)
    assert (np.sign(found.log_tint[[0, 2]]) == np.sign([tint[0], tint[2]])).all()


def test_what_was_not_seen_does_not_count():
    observed = FAMILY.log_albedo(0.2, 1.0) + 0.3
    observed[150:] = 3.0
    found = fitted_numbers(FAMILY, observed, np.r_[np.ones(150), np.zeros(150)], 0.2)
    assert found.log_gain == pytest.approx(0.3, abs=0.01)


def test_blood_absorbs_blue_most():
    more = FAMILY.log_albedo(0.0, 2.0) - FAMILY.log_albedo(0.0, 1.0)
    np.testing.assert_allclose(more, np.tile(BLOOD_LOG_ALBEDO, (300, 1)))
