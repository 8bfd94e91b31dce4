"""Volume rendering: closed forms, invariances, and gradients where exponentials run out."""

import math

import pytest
import torch
from livehand.backend.field.volume import Steps, composite


def composite_rays(sigma, channels, t, step_mm, is_stopped=None):
    """Rays of densities [R, N] and channels [R, N, C]."""
    if is_stopped is None:
        is_stopped = torch.zeros(len(t), dtype=torch.bool)
    return composite(sigma.flatten(), channels.flatten(0, 1), Steps(t, step_mm, is_stopped))


def a_ray(sigma, channels=None, t=None, step_mm=1.0):
    sigma = torch.as_tensor(sigma, dtype=torch.float64)[None]
    channels = torch.ones(1, sigma.shape[1], 1, dtype=torch.float64) if channels is None else channels
    t = torch.linspace(1, 2, sigma.shape[1], dtype=torch.float64)[None] if t is None else t
    return composite_rays(sigma, channels, t, torch.tensor([step_mm], dtype=torch.float64))


@pytest.mark.parametrize("sigma", [0.01, 0.5, 3.0])
@pytest.mark.parametrize("count", [1, 7, 32])
def test_constant_density_is_beers_law(sigma, count):
    """alpha = 1 - exp(-sigma L), however finely L = 4 mm is cut."""
    out = a_ray([sigma] * count, step_mm=4 / count)
    assert float(out.alpha) == pytest.approx(1 - math.exp(-sigma * 4))


def reference(sigma, channels, t, step_mm):
    """Front to back, one sample at a time."""
    through, colour, alpha, depth = 1.0, torch.zeros(channels.shape[1], dtype=torch.float64), 0.0, 0.0
    for k in range(len(sigma)):
        opacity = 1 - math.exp(-float(sigma[k]) * step_mm)
        colour = colour + through * opacity * channels[k]
        alpha += through * opacity
        depth += through * opacity * float(t[k])
        through *= 1 - opacity
    return colour, alpha, depth / alpha


def test_against_a_loop_over_samples():
    generator = torch.Generator().manual_seed(0)
    sigma = 2 * torch.rand(20, 6, generator=generator, dtype=torch.float64)
    channels = torch.randn(20, 6, 5, generator=generator, dtype=torch.float64)
    t = torch.rand(20, 6, generator=generator, dtype=torch.float64).cumsum(1)
    step_mm = torch.rand(20, generator=generator, dtype=torch.float64)
    out = composite_rays(sigma, channels, t, step_mm)
    for ray in range(20):
        colour, alpha, depth = reference(sigma[ray], channels[ray], t[ray], float(step_mm[ray]))
        torch.testing.assert_close(out.channels[ray], colour)
        assert float(out.alpha[ray]) == pytest.approx(alpha)
        assert float(out.depth[ray]) == pytest.approx(depth)


def test_an_opaque_first_sample_hides_the_rest():
    channels = torch.tensor([[[0.3], [9.0], [-9.0]]], dtype=torch.float64)
    out = a_ray([1e4, 5.0, 5.0], channels)
    assert float(out.alpha) == 1
    assert float(out.channels[0, 0]) == pytest.approx(0.3)
    assert float(out.depth) == pytest.approx(1.0)


def test_a_constant_colour_comes_out_as_that_colour_times_alpha():
    sigma = torch.rand(9, 8, generator=torch.Generator().manual_seed(1))
    colour = torch.tensor([0.2, -3.0, 0.7])
    out = composite_rays(sigma, colour.expand(9, 8, 3), torch.rand(9, 8), torch.rand(9))
    torch.testing.assert_close(out.channels, out.alpha[:, None] * colour)


def test_cutting_a_sample_in_two_changes_nothing():
    generator = torch.Generator().manual_seed(2)
    sigma, channels = torch.rand(3, 5, generator=generator), torch.randn(3, 5, 4, generator=generator)
    t, step_mm = torch.rand(3, 5, generator=generator), torch.rand(3, generator=generator)
    whole = composite_rays(sigma, channels, t, step_mm)
    halves = composite_rays(*(value.repeat_interleave(2, 1) for value in (sigma, channels, t)), step_mm / 2)
    for one, other in zip(whole[:3], halves[:3], strict=True):
        torch.testing.assert_close(one, other)
    torch.testing.assert_close(whole.weights, halves.weights.reshape(3, 5, 2).sum(2))
    torch.testing.assert_close(whole.weights.sum(1), whole.alpha)


def test_nothing_is_met_by_a_ray_through_nothing():
    out = a_ray([0.0] * 4)
    assert (float(out.alpha), float(out.channels), float(out.depth)) == (0, 0, 0)


def test_depth_lies_between_the_samples():
    t = torch.tensor([[0.4, 0.5, 0.9]], dtype=torch.float64)
    assert float(a_ray([0.0, 7.0, 0.0], t=t).depth) == pytest.approx(0.5)
    mixed = float(a_ray([0.3, 0.3, 0.3], t=t).depth)
    assert 0.4 < mixed < 0.5 + 0.1


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("sigma", [0.0, 1e-30, 1e-6, 1.0, 1e3, 1e6])
def test_results_and_gradients_are_finite(sigma, dtype):
    sigma = torch.full((2, 6), sigma, dtype=dtype, requires_grad=True)
    channels = torch.randn(2, 6, 3, dtype=dtype, generator=torch.Generator().manual_seed(3)).requires_grad_()
    step_mm = torch.tensor([1e-6, 10.0], dtype=dtype, requires_grad=True)
    out = composite_rays(sigma, channels, torch.linspace(0.3, 0.4, 12, dtype=dtype).view(2, 6), step_mm)
    (out.channels.sum() + out.alpha.sum() + out.depth.sum()).backward()
    for value in (*out, sigma.grad, channels.grad, step_mm.grad):
        assert value.isfinite().all()
    assert (out.alpha >= 0).all()
    assert (out.alpha <= 1 + 1e-6).all()


def test_gradients_are_right():
    generator = torch.Generator().manual_seed(4)
    sigma = torch.rand(2, 4, generator=generator, dtype=torch.float64).requires_grad_()
    channels = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64).requires_grad_()
    t = torch.rand(2, 4, generator=generator, dtype=torch.float64).requires_grad_()
    step_mm = torch.rand(2, generator=generator, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(composite_rays, (sigma, channels, t, step_mm))


def test_no_rays():
    out = composite_rays(torch.zeros(0, 8), torch.zeros(0, 8, 32), torch.zeros(0, 8), torch.zeros(0))
    assert out.channels.shape == (0, 32)


def test_half_precision_channels_are_summed_in_single():
    sigma = torch.full((1, 8), 0.3)
    channels = torch.full((1, 8, 2), 0.7).bfloat16()
    out = composite_rays(sigma, channels, torch.ones(1, 8), torch.ones(1))
    assert out.channels.dtype == torch.float32


def test_a_stopped_ray_is_opaque_and_ends_in_its_last_sample():
    sigma, channels = torch.full((3, 4), 0.2), torch.randn(3, 4, 2, generator=torch.Generator().manual_seed(5))
    t, step_mm = torch.linspace(0.4, 0.5, 4).expand(3, 4), torch.ones(3)
    free = composite_rays(sigma, channels, t, step_mm)
    stopped = composite_rays(sigma, channels, t, step_mm, torch.tensor([True, False, True]))
    torch.testing.assert_close(stopped.alpha, torch.stack([torch.tensor(1.0), free.alpha[1], torch.tensor(1.0)]))
    torch.testing.assert_close(stopped.channels[1], free.channels[1])
    let_through = math.exp(-0.2 * 3)  # by the samples before the last
    first = free.channels[0] - let_through * (1 - math.exp(-0.2)) * channels[0, 3]
    torch.testing.assert_close(stopped.channels[0], first + let_through * channels[0, 3])
    none = composite_rays(sigma, channels, t, step_mm, torch.zeros(3, dtype=torch.bool))
    torch.testing.assert_close(none.channels, free.channels)


def test_samples_lie_ray_by_ray():
    """The flat samples of a ray follow one another."""
    sigma = torch.tensor([9e3, 0.0, 0.0, 9e3])
    channels = torch.tensor([[1.0], [2.0], [3.0], [4.0]])
    steps = Steps(torch.tensor([[0.1, 0.2], [0.3, 0.4]]), torch.ones(2), torch.zeros(2, dtype=torch.bool))
    out = composite(sigma, channels, steps)
    assert out.channels[:, 0].tolist() == [1.0, 4.0]
    torch.testing.assert_close(out.depth, torch.tensor([0.1, 0.4]))
