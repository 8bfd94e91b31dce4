"""sRGB encoding against the standard's numbers."""

import pytest
import torch
from livehand.backend.image.srgb import linear_to_srgb, srgb_to_linear

# IEC 61966-2-1: 8-bit level -> linear light.
KNOWN = {0: 0.0, 1: 0.000303527, 10: 0.003035270, 11: 0.003346536, 128: 0.215860500, 188: 0.502886458, 255: 1.0}


@pytest.mark.parametrize(("level", "linear"), KNOWN.items())
def test_known_levels(level, linear):
    encoded = torch.tensor([level / 255], dtype=torch.float64)
    assert float(srgb_to_linear(encoded)) == pytest.approx(linear, abs=5e-9)
    assert float(linear_to_srgb(torch.tensor([linear], dtype=torch.float64))) == pytest.approx(level / 255, abs=1e-7)


def test_round_trip_and_order():
    encoded = torch.linspace(0, 1, 4001, dtype=torch.float64)
    linear = srgb_to_linear(encoded)
    torch.testing.assert_close(linear_to_srgb(linear), encoded, atol=1e-7, rtol=0)
    assert (linear.diff() > 0).all()
    assert (linear <= encoded).all()


@pytest.mark.parametrize("transform", [srgb_to_linear, linear_to_srgb])
def test_gradients_are_finite_and_positive_even_below_zero(transform):
    values = torch.tensor([-1.0, -1e-3, 0.0, 1e-8, 0.0031308, 0.04045, 0.5, 1.0, 2.0], requires_grad=True)
    transform(values).sum().backward()
    assert values.grad.isfinite().all()
    assert (values.grad > 0).all()


def test_every_8_bit_level_survives_single_precision():
    levels = torch.arange(256)
    assert torch.equal((linear_to_srgb(srgb_to_linear(levels / 255)) * 255).round().long(), levels)
