"""Image metrics against closed forms, scikit-image, and slow references."""

import math

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.metrics import MAX_PSNR_DB, alpha_iou, difference_box, psnr_db, similarities
from skimage.metrics import peak_signal_noise_ratio, structural_similarity


def pictures(seed=0, size=(31, 24)):
    rng = np.random.default_rng(seed)
    truth = rng.random((*size, 3)).astype(np.float32)
    return torch.as_tensor(np.clip(truth + rng.normal(0, 0.1, truth.shape), 0, 1).astype(np.float32)), torch.as_tensor(
        truth
    )


def test_psnr_of_a_known_error():
    truth = torch.zeros(4, 5, 3)
    assert psnr_db(truth + 0.1, truth) == pytest.approx(20.0, abs=1e-4)
    assert psnr_db(truth + 0.01, truth) == pytest.approx(40.0, abs=1e-4)
    assert psnr_db(truth, truth) == MAX_PSNR_DB


def test_psnr_equals_scikit_image():
    image, truth = pictures()
    expected = peak_signal_noise_ratio(truth.numpy(), image.numpy(), data_range=1)
    assert psnr_db(image, truth) == pytest.approx(expected, abs=1e-4)


def test_masked_psnr_counts_the_mask_only():
    truth = torch.zeros(4, 4, 3)
    image = truth.clone()
    image[0] = 1.0
    image[1] = 0.1
    mask = torch.zeros(4, 4, dtype=torch.bool)
    mask[1] = True
    assert psnr_db(image, truth, mask) == pytest.approx(20.0, abs=1e-4)
    assert math.isnan(psnr_db(image, truth, torch.zeros(4, 4, dtype=torch.bool)))


def ssim(image, truth):
    return similarities(image, truth, torch.ones(image.shape[:2], dtype=torch.bool))[0].full


@pytest.mark.parametrize("seed", [0, 1])
def test_ssim_equals_scikit_image(seed):
    image, truth = pictures(seed)
    _, full = structural_similarity(
        truth.double().numpy(),
        image.double().numpy(),
        data_range=1,
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    assert ssim(image, truth) == pytest.approx(full[5:-5, 5:-5].mean(), abs=1e-6)


def test_ssim_of_equal_and_of_inverted_images():
    _, truth = pictures()
    assert ssim(truth, truth) == pytest.approx(1.0)
    assert ssim(1 - truth, truth) < 0


def test_iou_by_hand():
    a, b = torch.zeros(4, 4), torch.zeros(4, 4)
    assert alpha_iou(a, b) == 1.0
    a[:2], b[1:3] = 0.9, 0.6
    assert alpha_iou(a, b) == pytest.approx(4 / 12)
    assert alpha_iou(a, a) == 1.0
    assert alpha_iou(a, torch.zeros(4, 4)) == 0.0
    b[:] = 0.5  # not more than half covered: empty
    assert alpha_iou(a, b) == 0.0


def numpy_windows(a, b):
    """Reference of Wang et al.: (luminance, structure) of every window of one channel, each window by itself."""
    offset = np.arange(11) - 5
    row = np.exp(-(offset**2) / (2 * 1.5**2))
    kernel = np.outer(row, row) / np.outer(row, row).sum()
    x, y = (np.lib.stride_tricks.sliding_window_view(picture, (11, 11)) for picture in (a, b))
    mx, my = ((kernel * w).sum((2, 3), keepdims=True) for w in (x, y))
    vx, vy, covariance = (
        (kernel * product).sum((2, 3)) for product in ((x - mx) ** 2, (y - my) ** 2, (x - mx) * (y - my))
    )
    mx, my = mx[..., 0, 0], my[..., 0, 0]
    return (2 * mx * my + 1e-4) / (mx**2 + my**2 + 1e-4), (2 * covariance + 9e-4) / (vx + vy + 9e-4)


def halved(x):
    """Mean over 2 x 2 px; an odd last row or column counts twice."""
    even = np.pad(x, [(0, x.shape[0] % 2), (0, x.shape[1] % 2), (0, 0)][: x.ndim], mode="edge")
    return sum(even[i::2, j::2] for i in (0, 1) for j in (0, 1)) / 4


def numpy_ms_ssim(image, truth, hand):
    """Slow reference: (full, hand)."""
    exponents, figures = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333), np.ones(2)
    mask = hand.astype(float)
    for scale, exponent in enumerate(exponents):
        windows = [numpy_windows(image[..., c], truth[..., c]) for c in range(3)]
        kept = np.mean([lum * cs if scale == 4 else cs for lum, cs in windows], 0)
        figures *= np.array([kept.mean(), kept[mask[5:-5, 5:-5] > 0.5].mean()]) ** exponent
        image, truth, mask = (halved(x) for x in (image, truth, mask))
    return figures


def hand_on_black(size, seed=0):
    """A blotchy disc on black, a noisy picture of it, and the disc as a mask; sizes odd on purpose."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[: size[0], : size[1]]
    disc = (rows - 0.45 * size[0]) ** 2 + (columns - 0.55 * size[1]) ** 2 < (0.3 * min(size)) ** 2
    truth = disc[..., None] * (0.5 + 0.3 * np.sin(rows / 7)[..., None] * np.cos(columns[..., None] / (5, 9, 13)))
    image = truth + disc[..., None] * rng.normal(0, 0.08, truth.shape)
    return image.clip(0, 1), truth, disc


@pytest.mark.slow
def test_ms_ssim_equals_the_slow_reference():
    image, truth, disc = hand_on_black((166, 163))
    _, found = similarities(*(torch.as_tensor(x) for x in (image, truth, disc)))
    expected = numpy_ms_ssim(image, truth, disc)
    assert expected[1] < expected[0] < 0.99  # the two differ, and neither is trivial
    assert found == pytest.approx(tuple(expected), abs=1e-9)


def test_ssim_on_the_hand_equals_the_slow_reference():
    image, truth, disc = hand_on_black((40, 37))
    found, multi_scale = similarities(*(torch.as_tensor(x) for x in (image, truth, disc)))
    windows = np.mean([np.prod(numpy_windows(image[..., c], truth[..., c]), 0) for c in range(3)], 0)
    assert found.full == pytest.approx(windows.mean(), abs=1e-9)
    assert found.hand == pytest.approx(windows[disc[5:-5, 5:-5]].mean(), abs=1e-9)
    assert found.hand < found.full
    assert math.isnan(multi_scale.full)  # five scales need 161 px
    assert math.isnan(multi_scale.hand)


def test_similarities_of_equal_and_of_inverted_images():
    _, truth = pictures(size=(161, 161))
    nowhere = torch.zeros(161, 161, dtype=torch.bool)
    for similarity in similarities(truth, truth, ~nowhere):
        assert similarity == (1.0, 1.0)
    _, inverted = similarities(1 - truth, truth, ~nowhere)
    assert inverted == (0.0, 0.0)  # opposite structure has no root
    single, multi_scale = similarities(1 - truth, truth, nowhere)
    assert math.isnan(single.hand)
    assert math.isnan(multi_scale.hand)


def test_an_image_smaller_than_a_window_has_no_similarity():
    truth = torch.rand(10, 40, 3)
    assert math.isnan(ssim(truth + 0.1, truth))
    assert similarities(truth, truth, torch.ones(10, 40, dtype=torch.bool))[0] == pytest.approx(
        (math.nan, math.nan), nan_ok=True
    )


def test_the_difference_box_holds_all_differences_and_the_margin():
    a, b = torch.zeros(2, 3, 20, 30).unbind(0)
    assert difference_box(a, b, 2) is None
    b[1, 4, 6] = b[2, 10, 28] = 0.5
    assert difference_box(a, b, 0) == (slice(4, 11), slice(6, 29))
    assert difference_box(a, b, 5) == (slice(0, 16), slice(1, 30))
