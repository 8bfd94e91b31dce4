"""A bound that lets values come back."""

import pytest
import torch
from livehand.backend.field.relightable import clamp_min


def test_values_are_clamped():
    values = torch.tensor([-3.0, -1.0, 0.5])
    torch.testing.assert_close(clamp_min(values, -1.0), torch.tensor([-1.0, -1.0, 0.5]))


@pytest.mark.parametrize(("wanted", "expected"), [(2.0, [-5.0, -3.0]), (-9.0, [0.0, 19.0])])
def test_below_the_bound_only_what_raises_has_a_gradient(wanted, expected):
    """Of (value - wanted)^2, at -4 and 0.5, of which the first is taken for -0.5."""
    values = torch.tensor([-4.0, 0.5], requires_grad=True)
    (clamp_min(values, -0.5) - wanted).square().sum().backward()
    torch.testing.assert_close(values.grad, torch.tensor(expected))


def test_a_value_far_below_comes_back_and_one_that_should_stay_does():
    values = torch.tensor([-6.0, -6.0], requires_grad=True)
    optimiser = torch.optim.Adam([values], lr=0.1)
    for _ in range(200):
        optimiser.zero_grad()
        (clamp_min(values, 0.0) - torch.tensor([1.0, -1.0])).square().sum().backward()
        optimiser.step()
    first, second = values.tolist()
    assert first == pytest.approx(1.0, abs=0.05)
    assert second == -6.0
