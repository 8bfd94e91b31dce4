"""Picture metrics against closed forms and scikit-image."""

import math

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.metrics import MAX_PSNR_DB, alpha_iou, psnr_db, ssim
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


def test_psnr_is_scikit_images():
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


@pytest.mark.parametrize("seed", [0, 1])
def test_ssim_is_scikit_images(seed):
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


def test_ssim_of_equal_and_of_inverted_pictures():
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
