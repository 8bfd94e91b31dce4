"""Frechet and kernel distance: closed forms, invariances, and features of the hand alone."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.perceptual.vgg import _LAYERS, PerceptualLoss
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.comparison.distributions import (
    Distributions,
    HandVggFeatures,
    Moments,
    WholeInceptionFeatures,
    frechet_distance,
    gaussian_frechet,
    kernel_distance,
)
from livehand.backend.research.comparison.inception import InceptionFeatures, load_inception
from safetensors.torch import save_file


def normal(count, channels, seed=0):
    return torch.randn(count, channels, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_the_frechet_distance_of_gaussians_in_closed_form():
    """Of diagonal covariances: |m1 - m2|^2 + sum (s1 - s2)^2, also after a rotation of both."""
    mean, deviations = torch.tensor([1.0, -2.0, 0.5]).double(), torch.tensor([[1.0, 2, 3], [2, 0, 0.5]]).double()
    rotation, _ = torch.linalg.qr(normal(3, 3))
    cov1, cov2 = (rotation @ torch.diag(d**2) @ rotation.T for d in deviations)
    found = gaussian_frechet(mean, cov1, torch.zeros(3).double(), cov2)
    assert found == pytest.approx(1 + 4 + 0.25 + 1 + 4 + 6.25)
    assert gaussian_frechet(mean, cov1, mean, cov1) == pytest.approx(0, abs=1e-9)


def test_the_frechet_distance_of_samples_is_that_of_their_moments():
    a, b = normal(4000, 4), 2 * normal(4000, 4, 1) + 3
    assert frechet_distance(a, b) == pytest.approx(4 * (9 + 1), rel=0.05)
    assert frechet_distance(a, a) == pytest.approx(0, abs=1e-9)
    assert np.isnan(frechet_distance(a[:1], b))


def test_moments_of_parts_add_up_to_those_of_the_whole():
    x = normal(50, 4) + 3
    mean, cov = (Moments.of(x[:20]) + Moments.of(x[20:])).gaussian
    torch.testing.assert_close(mean, x.mean(0))
    torch.testing.assert_close(cov, torch.cov(x.T))


def test_the_kernel_distance_by_hand_and_without_bias():
    a, b = torch.tensor([[1.0], [2.0]]).double(), torch.tensor([[0.0], [1.0]]).double()
    assert kernel_distance(a, b) == pytest.approx(27 + 1 - 2 * (1 + 8 + 1 + 27) / 4)
    halves = [kernel_distance(x[:40], x[40:]) for x in (normal(80, 16, seed) for seed in range(60))]
    assert abs(np.mean(halves)) < 3 * np.std(halves) / 60**0.5
    assert min(halves) < 0 < max(halves)
    assert kernel_distance(normal(40, 16), normal(40, 16, 1) + 1) > 20 * np.std(halves)


@pytest.fixture(scope="module")
def vgg():
    generator = torch.Generator().manual_seed(0)
    shapes = {f"{k}.weight": (outputs, inputs, 3, 3) for k, inputs, outputs, _ in _LAYERS}
    weights = {name: torch.randn(s, generator=generator) * (2 / (9 * s[1])) ** 0.5 for name, s in shapes.items()}
    return PerceptualLoss(weights | {f"{k}.bias": torch.zeros(outputs) for k, _, outputs, _ in _LAYERS})


def picture(seed):
    rgb = np.random.default_rng(seed).random((30, 22, 3)).astype(np.float32)
    alpha = np.zeros((30, 22, 1), np.float32)
    alpha[8:24, 4:16] = 1
    return np.concatenate([rgb * alpha, alpha], -1)


def test_features_are_those_of_the_hand(vgg):
    image = torch.as_tensor(picture(0))
    of_hand = HandVggFeatures(vgg)(image[..., :3], image[..., 3] > 0.5)
    assert of_hand.local.shape == (4 * 3, 256)
    torch.testing.assert_close(of_hand.mean, of_hand.local.mean(0))
    deepest = vgg.features(image[None, ..., :3].permute(0, 3, 1, 2))[-1][0].double()
    torch.testing.assert_close(of_hand.local[0], deepest[:, 2, 1], atol=1e-4, rtol=1e-3)


@pytest.mark.slow
def test_distributions_are_equal_only_for_equal_images(vgg):
    same, other = Distributions(HandVggFeatures(vgg)), Distributions(HandVggFeatures(vgg))
    assert same.figures() == {}
    for seed in range(4):
        same.add(picture(seed), picture(seed))
        other.add(picture(seed), 0.5 * picture(seed + 10))
    names = {f"vgg19_{kind}{ending}" for kind in ("frechet", "kid") for ending in ("", "_deviation")}
    assert set(same.figures()) == set(other.figures()) == names
    assert same.figures()["vgg19_frechet"] == pytest.approx(0, abs=1e-4)
    assert same.figures()["vgg19_frechet_deviation"] == pytest.approx(0, abs=1e-4)
    assert other.figures()["vgg19_frechet"] > 0.1
    assert other.figures()["vgg19_kid"] > same.figures()["vgg19_kid"]


@pytest.mark.slow
def test_inception_has_the_published_size_and_refuses_other_files(tmp_path):
    network = InceptionFeatures()
    assert sum(parameter.numel() for parameter in network.parameters()) == 21_785_568
    weights = {name: value.contiguous() for name, value in network.state_dict().items()}
    save_file(weights | {"fc.weight": torch.zeros(1008, 2048)}, tmp_path / "whole.safetensors")
    loaded = load_inception(tmp_path / "whole.safetensors")
    image = torch.as_tensor(picture(0))
    found = WholeInceptionFeatures(loaded)(image[..., :3], image[..., 3] > 0.5)
    assert found.local.shape == (1, 2048)
    assert found.mean.isfinite().all()
    del weights["Mixed_7c.branch_pool.conv.weight"]
    save_file(weights, tmp_path / "part.safetensors")
    with pytest.raises(LiveHandError, match="another network"):
        load_inception(tmp_path / "part.safetensors")
