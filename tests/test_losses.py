"""The training loss by hand, and the perceptual distance with weights of its own."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.errors import LiveHandError
from livehand.backend.training.config import LossConfig
from livehand.backend.training.losses import window_loss
from livehand.backend.training.perceptual import _LAYERS, PerceptualLoss, load_perceptual_loss
from safetensors.torch import save_file

NOTHING = LossConfig(colour_l2=0.0, colour_l1=0.0, alpha_l2=0.0, low_l2=0.0, perceptual=0.0)


def windows(height=6, width=8, seed=0):
    generator = torch.Generator().manual_seed(seed)
    low, image, target = (
        torch.rand(4, h, w, generator=generator)
        for h, w in ((height // 2, width // 2), (height, width), (height, width))
    )
    return low, image, target, torch.ones(height, width, dtype=torch.bool)


def test_each_term_by_hand():
    low, image, target, inside = windows()
    means = target.reshape(4, 3, 2, 4, 2).mean((2, 4))
    expected = {
        "colour_l2": ((image - target)[:3] ** 2).mean(),
        "colour_l1": (image - target)[:3].abs().mean(),
        "alpha_l2": ((image - target)[3] ** 2).mean(),
        "low_l2": ((low - means) ** 2).mean(),
    }
    for name, value in expected.items():
        ours = window_loss(low, image, target, inside, replace(NOTHING, **{name: 3.0}), None)
        torch.testing.assert_close(ours, 3 * value)
    together = window_loss(low, image, target, inside, LossConfig(), None)
    weights = LossConfig()
    torch.testing.assert_close(together, sum(getattr(weights, name) * value for name, value in expected.items()))


def test_a_perfect_window_costs_nothing():
    _, _, target, inside = windows()
    low = target.reshape(4, 3, 2, 4, 2).mean((2, 4))
    assert float(window_loss(low, target, target, inside, LossConfig(), None)) < 1e-12


def test_what_lies_outside_the_image_counts_nothing():
    low, image, target, inside = windows()
    inside[:, :3] = False  # cuts through the second low-resolution column
    image, low, target = (value.requires_grad_() for value in (image, low, target))
    window_loss(low, image, target.detach(), inside, LossConfig(), None).backward()
    assert image.grad[:, :, :3].abs().max() == 0
    assert image.grad[:, :, 3:].abs().min() > 0
    assert low.grad[:, :, :2].abs().max() == 0
    assert low.grad[:, :, 2:].abs().min() > 0


def vgg_weights(seed=0):
    generator = torch.Generator().manual_seed(seed)
    weights = {}
    for k, inputs, outputs, _ in _LAYERS:
        weights[f"{k}.weight"] = torch.randn(outputs, inputs, 3, 3, generator=generator) * (2 / (9 * inputs)) ** 0.5
        weights[f"{k}.bias"] = torch.zeros(outputs)
    return weights


@pytest.fixture(scope="module")
def perceptual():
    return PerceptualLoss(vgg_weights())


def pictures(seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(1, 3, 16, 12, generator=generator), torch.rand(1, 3, 16, 12, generator=generator)


def test_the_perceptual_distance_is_zero_for_equals_and_grows_with_the_difference(perceptual):
    image, target = pictures()
    assert float(perceptual(target, target)) == 0
    near, far = perceptual(target + 0.1 * (image - target), target), perceptual(image, target)
    assert 0 < float(near) < 0.5 * float(far)


def test_the_perceptual_gradient_is_finite_and_reaches_every_pixel(perceptual):
    for seed, target_scale in ((0, 1.0), (1, 0.0)):
        image, target = pictures(seed)
        image.requires_grad_()
        perceptual(image, target * target_scale).backward()
        assert image.grad.isfinite().all()
        assert (image.grad.abs().amax(1) > 0).double().mean() > 0.99
    assert all(not parameter.requires_grad for parameter in perceptual.parameters())


def test_the_scale_of_a_publications_features_does_not_matter():
    """A gain in the first layer, undone nowhere: every compared feature grows alike, and so does its mean."""
    image, target = pictures()
    weights = vgg_weights()
    louder = {**weights, "0.weight": weights["0.weight"] * 50}
    one, other = PerceptualLoss(weights)(image, target), PerceptualLoss(louder)(image, target)
    assert float(other) == pytest.approx(float(one), rel=0.02)


def test_the_loss_adds_the_distance_at_both_resolutions(perceptual):
    low, image, target, inside = windows(16, 24)
    config = replace(NOTHING, perceptual=2.0)
    means = target.reshape(4, 8, 2, 12, 2).mean((2, 4))
    expected = perceptual(image[None, :3], target[None, :3]) + perceptual(low[None, :3], means[None, :3])
    torch.testing.assert_close(window_loss(low, image, target, inside, config, perceptual), 2 * expected)


def test_weights_from_either_kind_of_file(tmp_path, perceptual):
    weights = vgg_weights()
    save_file(weights, tmp_path / "vgg.safetensors")
    torch.save({f"features.{key}": value for key, value in weights.items()}, tmp_path / "vgg.pth")
    image, target = pictures()
    for name in ("vgg.safetensors", "vgg.pth"):
        assert torch.equal(load_perceptual_loss(tmp_path / name)(image, target), perceptual(image, target))


def test_bad_weights_are_told(tmp_path):
    with pytest.raises(LiveHandError, match="no perceptual weights at"):
        load_perceptual_loss(tmp_path / "gone.pth")
    (tmp_path / "text.pth").write_text("hello")
    (tmp_path / "text.safetensors").write_text("hello")
    torch.save({"model": np.float64}, tmp_path / "pickle.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    for name in ("text.pth", "text.safetensors", "pickle.pth", "list.pth"):
        with pytest.raises(LiveHandError, match=f"{name}"):
            load_perceptual_loss(tmp_path / name)
    weights = vgg_weights()
    save_file({key: value for key, value in weights.items() if key != "7.weight"}, tmp_path / "part.safetensors")
    with pytest.raises(LiveHandError, match=r"7\.weight"):
        load_perceptual_loss(tmp_path / "part.safetensors")
    save_file({**weights, "7.weight": torch.zeros(3, 3)}, tmp_path / "shape.safetensors")
    with pytest.raises(LiveHandError, match=r"shape\.safetensors"):
        load_perceptual_loss(tmp_path / "shape.safetensors")


def test_features_that_are_all_zero_are_no_division_by_zero():
    silent = PerceptualLoss({key: torch.zeros_like(value) for key, value in vgg_weights().items()})
    image, target = pictures()
    assert float(silent(image, target)) == 0
