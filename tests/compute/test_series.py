"""Short series equal the functions that they stand for, where kernels ask for them."""

import numpy as np
import pytest
from livehand.backend.compute.kernels.compiled import compiled_loosely
from livehand.backend.compute.kernels.series import decayed, gaussian, grown, octaves


def fill_rows(values, rows):
    """Fill rows [4, N] with the series of values [N]; logarithms are those of the value against 1."""
    for k in range(len(values)):
        x = values[k]
        rows[0, k], rows[1, k], rows[2, k] = decayed(abs(x)), gaussian(x), grown(x)
        rows[3, k] = octaves(np.float32(1), np.float32(2) ** x)


fill = compiled_loosely(fill_rows)


def series(*values):
    rows = np.empty((4, len(values)), np.float32)
    fill(np.array(values, np.float32), rows)
    return rows


def test_exponentials_of_either_sign():
    x = np.linspace(-2, 2, 41)
    of_decay, of_gauss, of_growth, _ = series(*x)
    np.testing.assert_allclose(of_decay, np.exp(-16 * np.abs(x)), atol=3e-6)
    np.testing.assert_allclose(of_gauss, np.exp(-(x**2)), atol=3e-6)
    np.testing.assert_allclose(of_growth, np.exp(x), rtol=2e-6)


def test_nothing_is_left_of_what_is_far_off():
    decay, gauss, *_ = series(np.inf)
    assert decay == 0
    assert gauss == 0


@pytest.mark.parametrize(("most", "tolerance"), [(1.0, 1e-4), (3.0, 0.1)])
def test_octaves_count_doublings(most, tolerance):
    x = np.linspace(-most, most, 25)
    np.testing.assert_allclose(series(*x)[3], x, atol=tolerance)
