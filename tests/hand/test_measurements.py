import numpy as np
import pytest
from livehand.backend.hand.measurements import fit_beta, length_and_breadth_m


def test_the_mean_hand_measures_as_documented(hand):
    """docs/dev/hand.md: about 187 mm with straight fingers, 77 mm at the knuckles."""
    length_m, breadth_m = length_and_breadth_m(hand, np.zeros(10))
    assert length_m == pytest.approx(0.187, abs=0.002)
    assert breadth_m == pytest.approx(0.077, abs=0.003)


def test_size_scales_both_alike(hand):
    model = hand
    ratio = length_and_breadth_m(model, np.eye(10)[0]) / length_and_breadth_m(model, np.zeros(10))
    assert ratio[0] == pytest.approx(ratio[1], abs=0.003)
    assert ratio[0] == pytest.approx(1.045, abs=0.003)


@pytest.mark.parametrize(("length_m", "breadth_m"), [(0.170, 0.072), (0.190, 0.086), (0.205, 0.080)])
@pytest.mark.parametrize("side", ["right", "left"])
def test_the_fitted_shape_has_the_measurements(hand, length_m, breadth_m, side):
    model = hand.for_side(side)
    beta = fit_beta(model, length_m, breadth_m)
    np.testing.assert_allclose(length_and_breadth_m(model, beta), [length_m, breadth_m], atol=2e-4)
    assert np.abs(beta).max() < 4


def test_the_mean_hands_measurements_give_the_mean_shape(hand):
    model = hand
    np.testing.assert_allclose(fit_beta(model, *length_and_breadth_m(model, np.zeros(10))), 0, atol=1e-9)
