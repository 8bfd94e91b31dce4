"""A field's decoder by the kernels against its layers in torch."""

import sys

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.cpu.networks import decoder
from livehand.backend.compute.kernels.vectors import has_int8_products, has_vectors
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.volume import Composite
from livehand.backend.light.lighting import AmbientOcclusion
from torch.nn.functional import normalize

CPU = torch.device("cpu")
needs_vectors = pytest.mark.skipif(not has_vectors(), reason="needs a processor with AVX2 or AVX-512")
needs_int8_products = pytest.mark.skipif(not has_int8_products(), reason="needs a processor with AVX-512 VNNI")


def a_field(**settings):
    with torch.random.fork_rng():
        torch.manual_seed(5)
        return build_field(FieldConfig(**settings)).requires_grad_(False)


def inputs_of(field, rays):
    return torch.randn(rays, field.trunk[0].in_features, generator=torch.Generator().manual_seed(6))


@needs_vectors
@pytest.mark.parametrize("rays", [0, 1, 6, 203])
@pytest.mark.parametrize("settings", [{}, {"light": "linear"}, {"width": 24}, {"width": 130, "light": "linear"}])
def test_fp32_is_that_of_torch(settings, rays):
    field = a_field(**settings)
    inputs = inputs_of(field, rays)
    torch.testing.assert_close(decoder(field, CPU, "fp32")(inputs), field.decoded(inputs), rtol=0, atol=1e-5)


@needs_vectors
def test_outputs_may_be_more_than_two_blocks():
    field = a_field()
    field.channels = torch.nn.Linear(field.channels.in_features, 70).requires_grad_(False)
    inputs = inputs_of(field, 7)
    torch.testing.assert_close(decoder(field, CPU, "fp32")(inputs), field.decoded(inputs), rtol=0, atol=1e-5)


@needs_int8_products
@pytest.mark.parametrize("light", ["baked", "linear"])
@pytest.mark.slow
def test_int8_loses_what_256_steps_of_each_rays_values_must(light):
    """Rounding is a step / sqrt(12): of inputs, whose largest of 50 is at 2.5 spreads, 2.5 / 127, rms 0.006 of them.

    Weights, uniform to a largest, lose 0.004 in each layer, and values behind a ReLU, the largest at 3 spreads, 0.005:
    sqrt(0.006^2 + 2 * 0.005^2 + 3 * 0.004^2) = 0.011.
    """
    field = a_field(light=light)
    inputs = inputs_of(field, 203)
    inputs[100:] *= 100  # every ray has its own scale
    ours, exact = decoder(field, CPU, "bf16")(inputs), field.decoded(inputs)
    for part in (slice(0, 100), slice(100, 203)):
        error = (ours[part] - exact[part]).square().mean().sqrt()
        assert 0 < error < 0.015 * exact[part].std()


@needs_int8_products
def test_inputs_are_rounded_as_finely_as_they_count():
    field = a_field(light="linear")
    inputs = inputs_of(field, 60)
    exact = field.decoded(inputs)
    inputs[:, ::2] *= 1000
    field.trunk[0].weight[:, ::2] /= 1000
    assert (decoder(field, CPU, "bf16")(inputs) - exact).square().mean().sqrt() < 0.015 * exact.std()


@needs_int8_products
def test_a_ray_without_hidden_values_has_the_biases():
    field = a_field()
    for layer in field.trunk:
        layer.bias.fill_(-1)
    nothing = torch.zeros(7, field.trunk[0].in_features)
    torch.testing.assert_close(decoder(field, CPU, "bf16")(nothing), field.channels.bias.expand(7, -1))


def test_a_processor_without_vectors_leaves_it_to_torch(monkeypatch):
    monkeypatch.setattr(sys.modules[decoder.__module__], "has_vectors", lambda: False)
    field = a_field()
    inputs = inputs_of(field, 5)
    torch.testing.assert_close(decoder(field, CPU, "fp32")(inputs), field.decoded(inputs), rtol=0, atol=0)


def test_inputs_are_the_references_where_nothing_was_gathered_too(backend_pair):
    field, random = a_field(light="linear"), torch.Generator().manual_seed(7)
    alpha = torch.rand(50, generator=random) * (torch.rand(50, generator=random) < 0.8)
    gathered = Composite(
        (torch.rand(50, field.gathered_channels, generator=random) - 0.5) * alpha[:, None], alpha, alpha, alpha[:, None]
    )
    view, towards = (normalize(torch.randn(50, 3, generator=random), dim=-1) for _ in range(2))
    occlusion = AmbientOcclusion(torch.rand(50, generator=random), towards)
    ours, theirs = (each.decoder_inputs(field, gathered, view, occlusion) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)
    assert (alpha == 0).any()
    assert theirs[:, -7:].abs().amax(0).min() > 0.2
