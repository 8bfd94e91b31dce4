"""Planted errors are assigned to their cause; regions, depth steps and the two frequencies by value."""

import math

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.breakdown import (
    CAUSES,
    depth_steps,
    error_breakdown,
    low_frequency_share,
    regions_of,
    with_other_alpha,
)
from livehand.backend.evaluation.metrics import psnr_db
from livehand.backend.evaluation.visible_surface import VisibleSurface

SIZE = (512, 334)
ROWS, COLUMNS = torch.meshgrid(torch.arange(512.0), torch.arange(334.0), indexing="ij")


def disc(row=256.0, column=167.0, radius=100.0):
    """Anti-aliased coverage."""
    return (radius + 0.5 - ((ROWS - row) ** 2 + (COLUMNS - column) ** 2).sqrt()).clamp(0, 1)


def picture(alpha):
    """A smooth skin on black."""
    straight = torch.stack([0.6 + 0.1 * (ROWS / 90).sin(), 0.4 + 0.1 * (COLUMNS / 70).cos(), 0.3 + ROWS * 0], -1)
    return torch.cat([straight * alpha[..., None], alpha[..., None]], -1)


def surface(depth=None, ambient_occlusion=None, footprint_m=0.0005, scale=1.0):
    depth = torch.where(disc() > 0.5, 0.6, torch.inf) if depth is None else depth
    footprint = torch.full(SIZE, footprint_m)
    return VisibleSurface(
        depth, torch.ones(SIZE) if ambient_occlusion is None else ambient_occlusion, footprint, torch.tensor(scale)
    )


def with_error(truth, error):
    image = truth.clone()
    image[..., :3] += error * truth[..., 3:]
    return image


def noise(size=0.05, seed=0):
    return size * torch.randn(*SIZE, 3, generator=torch.Generator().manual_seed(seed))


def test_a_shifted_outline_is_a_silhouette_error():
    truth, image = picture(disc()), picture(disc(column=168.5))
    found = error_breakdown(image, truth, surface())
    assert found.share["silhouette"] > 0.99
    assert sum(found.share.values()) == pytest.approx(1)
    # The truth's outline on the same skin is the truth.
    assert found.psnr_true_alpha > psnr_db(image[..., :3], truth[..., :3]) + 20


def test_missing_and_stray_parts_are_silhouette_errors_at_any_distance():
    truth = picture(disc())
    missing = truth * (1 - disc(256, 200, 30))[..., None]
    stray = torch.maximum(truth, picture(disc(40, 40, 20)))
    for image in (missing, stray):
        assert error_breakdown(image, truth, surface()).share["silhouette"] > 0.99


def test_a_tint_is_shading_outside_the_silhouettes_band():
    truth = picture(disc())
    found = error_breakdown(with_error(truth, torch.tensor([0.03, -0.02, 0.01])), truth, surface())
    assert found.share["silhouette"] == pytest.approx(found.area["silhouette"], abs=0.01)
    assert found.area["silhouette"] == pytest.approx(1 - (97 / 100) ** 2, abs=0.01)
    assert found.share["shading"] == pytest.approx(1 - found.share["silhouette"], abs=1e-4)
    assert found.psnr_true_alpha == pytest.approx(
        psnr_db(with_error(truth, torch.tensor([0.03, -0.02, 0.01]))[..., :3], truth[..., :3]), abs=0.01
    )


def test_noise_is_texture():
    truth = picture(disc())
    found = error_breakdown(with_error(truth, noise()), truth, surface())
    # White noise keeps 1 / (4 pi sigma^2) of its energy after a Gaussian: 0.12 % of it at 8 px.
    assert found.share["shading"] < 0.005
    assert found.share["texture"] == pytest.approx(1 - found.share["silhouette"] - found.share["shading"])
    assert found.share["texture"] > 0.9


def test_an_error_at_a_fingers_edge_is_occlusion():
    truth = picture(disc())
    depth = torch.where(disc() > 0.5, torch.where(COLUMNS < 170, 0.6, 0.61), torch.inf)
    at_step = noise() * ((COLUMNS - 169.5).abs() < 3)[..., None]
    found = error_breakdown(with_error(truth, at_step), truth, surface(depth))
    assert found.share["occlusion"] > 0.9
    assert found.share["occlusion"] + found.share["silhouette"] == pytest.approx(1)
    assert error_breakdown(with_error(truth, at_step), truth, surface()).share["occlusion"] == 0


def test_an_error_at_low_openness_is_contact():
    truth = picture(disc())
    ambient_occlusion = torch.where((ROWS > 240) & (ROWS < 260), 0.3, 0.9)
    in_crease = with_error(truth, noise() * ((ROWS > 242) & (ROWS < 258))[..., None])
    found = error_breakdown(in_crease, truth, surface(ambient_occlusion=ambient_occlusion))
    assert found.share["contact"] > 0.95
    assert found.share["texture"] == 0


def test_every_pixel_has_one_region_and_bands_grow_with_the_image():
    depth = torch.where(COLUMNS < 150, 0.6, 0.62)
    alpha, ambient_occlusion = disc(), torch.where(ROWS > 300, 0.1, 1.0)
    whole = regions_of(alpha, alpha, surface(depth, ambient_occlusion))
    assert (torch.stack(whole).sum(0) == 1).all()
    assert (whole.silhouette | (alpha > 0.5)).all()
    # Three pixels each side of the outline, straight below the centre, where row 355 is the last.
    column = (whole.silhouette & (alpha > 0.5))[:, 167]
    assert column[256:].nonzero().flatten().add(256).tolist() == [353, 354, 355]
    assert whole.occlusion[256, 120:180].nonzero().flatten().add(120).tolist() == [147, 148, 149, 150, 151, 152]
    half = slice(None, None, 2)
    parts = (x[half, half] for x in (depth, ambient_occlusion, torch.full(SIZE, 0.001)))
    small = regions_of(alpha[half, half], alpha[half, half], VisibleSurface(*parts, torch.tensor(1.0)))
    assert small.occlusion[128, 60:90].nonzero().flatten().add(60).tolist() == [73, 74, 75, 76]


@pytest.mark.parametrize(("step_m", "scale", "is_step"), [(0.0029, 1, False), (0.0031, 1, True), (0.0031, 2, False)])
def test_a_depth_step_is_three_millimetres_of_the_template(step_m, scale, is_step):
    depth = 0.6 + step_m * (COLUMNS >= 100)
    steps = depth_steps(surface(depth, scale=scale))
    assert steps[:, 99:101].all() == is_step
    assert int(steps.sum()) == 2 * 512 * is_step


def test_grazing_surfaces_and_the_meshs_border_are_not_depth_steps():
    grazed = 0.6 + 0.0019 * COLUMNS
    assert depth_steps(surface(grazed, footprint_m=0.0001)).sum() == 0
    steep = 0.6 + 0.004 * COLUMNS
    assert depth_steps(surface(steep, footprint_m=0.001)).sum() == 0  # under five footprints
    assert depth_steps(surface(steep, footprint_m=0.0007)).all()
    assert depth_steps(surface(torch.where(COLUMNS < 100, 0.6, torch.inf))).sum() == 0


def test_the_two_frequencies_by_closed_form():
    everywhere = torch.ones(SIZE, dtype=torch.bool)
    assert low_frequency_share(torch.full((*SIZE, 3), 0.1), everywhere, 8.0) == pytest.approx(1)
    assert low_frequency_share(torch.zeros(*SIZE, 3), everywhere, 8.0) == 1
    # A wave of length L passes by g = exp(-2 (pi sigma / L)^2): what is left has g^2, what is taken (1 - g)^2.
    length, sigma = 40.0, 8.0
    wave = (2 * math.pi * torch.arange(3000.0) / length).sin()[None, :, None].expand(20, 3000, 3)
    kept = math.exp(-2 * (math.pi * sigma / length) ** 2)
    expected = kept**2 / (kept**2 + (1 - kept) ** 2)
    assert low_frequency_share(wave, torch.ones(20, 3000, dtype=torch.bool), sigma) == pytest.approx(expected, abs=0.01)


def test_another_alpha_keeps_colours_and_fills_holes_from_their_neighbours():
    truth = picture(disc())
    thin = truth * 0.5
    torch.testing.assert_close(with_other_alpha(thin, truth[..., 3]), truth[..., :3])
    holed = truth * (disc(256, 167, 4) < 0.5)[..., None]
    filled = with_other_alpha(holed, truth[..., 3])
    assert (filled - truth[..., :3]).abs().max() < 0.02
    nothing = with_other_alpha(torch.zeros(*SIZE, 4), truth[..., 3])
    assert (nothing == 0).all()


def test_equal_images_have_no_shares():
    found = error_breakdown(picture(disc()), picture(disc()), surface())
    assert found.share == dict.fromkeys(CAUSES, 0.0)
    assert sum(found.area.values()) == pytest.approx(1)
    assert np.isfinite(found.psnr_true_alpha)
