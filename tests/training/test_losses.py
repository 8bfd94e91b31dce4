"""The training loss: by hand, at extremes, and its perceptual term."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.evaluation.perceptual.backbones import Backbone, _vgg16
from livehand.backend.evaluation.perceptual.lpips import LpipsDistance
from livehand.backend.evaluation.perceptual.vgg import _LAYERS, PerceptualLoss
from livehand.backend.training.config import LossConfig
from livehand.backend.training.losses import crop_loss, load_perceptual_distance, patch_corner
from safetensors.torch import save_file

NOTHING = LossConfig(colour_l2=0.0, colour_l1=0.0, alpha_l2=0.0, low_l2=0.0, perceptual=0.0)
TERM_OF = {"colour_l2": "colour_l2", "colour_l1": "colour_l1", "alpha_l2": "alpha", "low_l2": "low"}


def crops(height=6, width=8, seed=0):
    generator = torch.Generator().manual_seed(seed)
    low, image, target = (
        torch.rand(4, h, w, generator=generator)
        for h, w in ((height // 2, width // 2), (height, width), (height, width))
    )
    return low, image, target, torch.ones(height, width, dtype=torch.bool)


def halved(image):
    return image.reshape(4, image.shape[1] // 2, 2, image.shape[2] // 2, 2).mean((2, 4))


def test_each_term_by_hand():
    low, image, target, inside = crops()
    expected = {
        "colour_l2": ((image - target)[:3] ** 2).mean(),
        "colour_l1": (image - target)[:3].abs().mean(),
        "alpha_l2": ((image - target)[3] ** 2).mean(),
        "low_l2": ((low - halved(target)) ** 2).mean(),
    }
    for name, value in expected.items():
        ours = crop_loss(low, image, target, inside, replace(NOTHING, **{name: 3.0}), None)
        torch.testing.assert_close(ours.total, 3 * value)
        torch.testing.assert_close(getattr(ours, TERM_OF[name]), 3 * value)
        assert sum(float(term) > 0 for term in ours[:-1]) == 1
    together = crop_loss(low, image, target, inside, LossConfig(), None)
    weights = LossConfig()
    torch.testing.assert_close(together.total, sum(getattr(weights, name) * value for name, value in expected.items()))


def test_a_perfect_crop_has_no_loss():
    _, _, target, inside = crops()
    assert float(crop_loss(halved(target), target, target, inside, LossConfig(), None).total) < 1e-12


def test_pixels_outside_the_image_are_ignored(perceptual):
    low, image, target, inside = crops(16, 24)
    inside[:, :3] = False  # cuts through the second low-resolution column
    for distance in (None, perceptual):
        image, low = (value.detach().requires_grad_() for value in (image, low))
        crop_loss(low, image, target, inside, replace(LossConfig(), perceptual=1.0), distance).total.backward()
        assert image.grad[:, :, :3].abs().max() == 0
        assert image.grad[:, :, 3:].abs().min() > 0
        assert low.grad[:, :, :2].abs().max() == 0
        assert low.grad[:, :, 2:].abs().min() > 0


def vgg_weights(layers, seed=0):
    generator = torch.Generator().manual_seed(seed)
    weights = {}
    for k, inputs, outputs in layers:
        weights[f"{k}.weight"] = torch.randn(outputs, inputs, 3, 3, generator=generator) * (2 / (9 * inputs)) ** 0.5
        weights[f"{k}.bias"] = torch.zeros(outputs)
    return weights


@pytest.fixture(scope="module")
def perceptual():
    return PerceptualLoss(vgg_weights([layer[:3] for layer in _LAYERS]))


@pytest.fixture(scope="module")
def lpips():
    layout = _vgg16()
    sizes = [(k, m.in_channels, m.out_channels) for k, m in enumerate(layout.layers) if isinstance(m, torch.nn.Conv2d)]
    heads = [torch.full((count,), 1.0) for count in layout.channels]
    return LpipsDistance(Backbone(layout, vgg_weights(sizes)), heads, False)


def test_the_loss_adds_the_distance_at_both_resolutions(perceptual):
    low, image, target, inside = crops(16, 24)
    config = replace(NOTHING, perceptual=2.0)
    expected = perceptual(image[None, :3], target[None, :3]) + perceptual(low[None, :3], halved(target)[None, :3])
    for rise in (1.0, 0.25):
        ours = crop_loss(low, image, target, inside, config, perceptual, rise)
        torch.testing.assert_close(ours.total, 2 * rise * expected)
        torch.testing.assert_close(ours.perceptual, 2 * rise * expected)
    assert float(crop_loss(low, image, target, inside, config, perceptual, 0.0).total) == 0


def test_lpips_can_be_the_perceptual_term(lpips):
    low, image, target, inside = crops(32, 36)
    ours = crop_loss(low, image, target, inside, replace(NOTHING, perceptual=2.0), lpips)
    expected = lpips(image[None, :3], target[None, :3]) + lpips(low[None, :3], halved(target)[None, :3])
    torch.testing.assert_close(ours.total, 2 * expected)


def test_a_patch_is_seen_at_both_resolutions(perceptual):
    low, image, target, inside = crops(24, 32)
    config = replace(NOTHING, perceptual=2.0, perceptual_region="patch", perceptual_patch_px=8)
    row, column = patch_corner(target[3], 8, torch.Generator().manual_seed(3))
    cut = slice(row, row + 8), slice(column, column + 8)
    half_cut = slice(row // 2, row // 2 + 4), slice(column // 2, column // 2 + 4)
    expected = perceptual(image[None, :3, *cut], target[None, :3, *cut])
    expected = expected + perceptual(low[None, :3, *half_cut], halved(target)[None, :3, *half_cut])
    generator = torch.Generator().manual_seed(3)
    ours = crop_loss(low, image, target, inside, config, perceptual, generator=generator)
    torch.testing.assert_close(ours.total, 2 * expected)


def test_a_patch_for_all_terms_starves_the_others_too(perceptual):
    low, image, target, inside = crops(24, 32)
    config = replace(NOTHING, colour_l2=1.0, low_l2=1.0, perceptual=2.0, perceptual_region="patch_all")
    config = replace(config, perceptual_patch_px=8)
    row, column = patch_corner(target[3], 8, torch.Generator().manual_seed(3))
    cut = slice(row, row + 8), slice(column, column + 8)
    half_cut = slice(row // 2, row // 2 + 4), slice(column // 2, column // 2 + 4)
    parts = low[:, *half_cut], image[:, *cut], target[:, *cut], inside[cut]
    expected = crop_loss(*parts, replace(config, perceptual_region="crop"), perceptual)
    ours = crop_loss(low, image, target, inside, config, perceptual, generator=torch.Generator().manual_seed(3))
    torch.testing.assert_close(ours.total, expected.total)
    assert float(ours.colour_l2) > 0


def test_patches_lie_on_the_hand_and_in_the_crop():
    alpha = torch.zeros(40, 60)
    alpha[30:34, 2:6] = 1
    generator = torch.Generator().manual_seed(0)
    corners = {patch_corner(alpha, 16, generator) for _ in range(40)}
    assert {row for row, _ in corners} == {22, 24}  # about rows 30..33, and never past row 40
    assert {column for _, column in corners} == {0}
    anywhere = {patch_corner(torch.zeros(40, 60), 16, generator) for _ in range(200)}
    assert {row for row, _ in anywhere} >= {0, 24}
    assert all(row % 2 == 0 and column % 2 == 0 and row <= 24 and column <= 44 for row, column in anywhere)
    assert patch_corner(torch.zeros(10, 12), 64, generator) == (0, 0)


EXTREMES = {
    "empty": (torch.zeros(4), torch.zeros(4)),
    "black on black": (torch.tensor([0.0, 0, 0, 1]), torch.tensor([0.0, 0, 0, 1])),
    "white on nothing": (torch.ones(4), torch.zeros(4)),
    "nothing on white": (torch.zeros(4), torch.ones(4)),
    "over-exposed": (torch.full((4,), 30.0), torch.ones(4)),
    "below black": (torch.full((4,), -30.0), torch.zeros(4)),
}


@pytest.mark.parametrize("case", EXTREMES)
@pytest.mark.parametrize("region", ["crop", "patch"])
@pytest.mark.parametrize("name", [*TERM_OF, "perceptual", "lpips"])
def test_every_term_has_finite_gradients_at_extremes(case, region, name, perceptual, lpips):
    ours, truth = EXTREMES[case]
    target = truth[:, None, None].expand(4, 32, 36)
    image = ours[:, None, None].expand(4, 32, 36).clone().requires_grad_()
    low = ours[:, None, None].expand(4, 16, 18).clone().requires_grad_()
    weight = "perceptual" if name == "lpips" else name
    config = replace(NOTHING, **{weight: 1.0}, perceptual_region=region, perceptual_patch_px=32)
    distance = {"perceptual": perceptual, "lpips": lpips}.get(name)
    inside = torch.ones(32, 36, dtype=torch.bool)
    terms = crop_loss(low, image, target, inside, config, distance)
    terms.total.backward()
    assert terms.total.isfinite()
    for gradient in (image.grad, low.grad):
        assert gradient is None or gradient.isfinite().all()
    if case in ("white on nothing", "over-exposed"):
        assert float(terms.total.detach()) > 0
        assert (low.grad if name == "low_l2" else image.grad).abs().max() > 0


def test_the_gradient_is_the_finite_difference(perceptual, lpips):
    """Every term at once, in double precision, along a random direction."""
    low, image, target, inside = (x.double() if x.is_floating_point() else x for x in crops(32, 36))
    config = replace(LossConfig(), perceptual=1.0)
    generator = torch.Generator().manual_seed(5)
    along = torch.randn(image.shape, generator=generator).double(), torch.randn(low.shape, generator=generator).double()

    def loss(step, distance):
        return crop_loss(low + step * along[1], image + step * along[0], target, inside, config, distance).total

    for distance in (None, perceptual.double(), lpips.double()):
        step = torch.zeros((), dtype=torch.float64, requires_grad=True)
        (slope,) = torch.autograd.grad(loss(step, distance), step)
        size = 1e-5 if distance is None else 1e-4
        difference = float((loss(size, distance) - loss(-size, distance)) / (2 * size))
        assert float(slope) == pytest.approx(difference, rel=2e-2)
    perceptual.float()
    lpips.float()


def test_the_given_files_determine_the_distance(tmp_path):
    save_file(vgg_weights([layer[:3] for layer in _LAYERS]), tmp_path / "vgg19.safetensors")
    assert isinstance(load_perceptual_distance(tmp_path / "vgg19.safetensors"), PerceptualLoss)
    layout = _vgg16()
    save_file(torch.nn.ModuleList(layout.layers).state_dict(), tmp_path / "vgg16.safetensors")
    heads = {f"lin{k}": torch.ones(count) for k, count in enumerate(layout.channels)}
    save_file(heads, tmp_path / "heads.safetensors")
    paths = tmp_path / "vgg16.safetensors", tmp_path / "heads.safetensors"
    loaded = load_perceptual_distance(*paths, "reference")
    assert isinstance(loaded, LpipsDistance)
    assert loaded.range_mode == "reference"
