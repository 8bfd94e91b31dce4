"""The skin's numbers from an observed albedo: melanin, blood, strength and tint of the light."""

import numpy as np
import pytest
from livehand.backend.person.numbers import BLOOD_LOG_ALBEDO, ToneFamily, fitted_numbers

RNG = np.random.default_rng(4)
LIGHT = np.log([0.6, 0.35, 0.25]) + RNG.normal(0, 0.15, (300, 1)) + RNG.normal(0, 0.03, (300, 3))
DEEP = np.log([0.15, 0.06, 0.03]) + RNG.normal(0, 0.35, (300, 1)) + RNG.normal(0, 0.03, (300, 3))
FAMILY = ToneFamily(LIGHT, DEEP)


@pytest.mark.parametrize("melanin", [0.0, 0.42, 1.0])
@pytest.mark.parametrize("log_gain", [-0.5, 0.0, 0.7])
def test_melanin_is_told_from_the_strength_of_the_light(melanin, log_gain):
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(melanin, 1.0) + log_gain, np.ones(300))
    assert found.melanin == pytest.approx(melanin, abs=0.02)
    assert found.log_gain == pytest.approx(log_gain, abs=0.05)
    assert found.error < 0.02


def test_blood_is_found():
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(0.3, 1.4), np.ones(300))
    assert found.blood == pytest.approx(1.4, abs=0.08)


@pytest.mark.parametrize("tint", [(0.1, 0.0, -0.1), (-0.08, 0.0, 0.08)])
@pytest.mark.parametrize("melanin", [0.0, 0.42, 1.0])
def test_a_wrong_white_balance_moves_melanin_little(tint, melanin):
    found = fitted_numbers(FAMILY, FAMILY.log_albedo(melanin, 1.0) + np.array(tint), np.ones(300))
    assert abs(found.melanin - melanin) <= 0.08
    assert found.log_tint.sum() == pytest.approx(0, abs=1e-9)


def test_what_was_not_seen_does_not_count():
    observed = FAMILY.log_albedo(0.2, 1.0)
    observed[150:] = 3.0
    found = fitted_numbers(FAMILY, observed, np.r_[np.ones(150), np.zeros(150)])
    assert found.melanin == pytest.approx(0.2, abs=0.02)


def test_blood_absorbs_blue_most():
    more = FAMILY.log_albedo(0.0, 2.0) - FAMILY.log_albedo(0.0, 1.0)
    np.testing.assert_allclose(more, np.tile(BLOOD_LOG_ALBEDO, (300, 1)))
