"""FLIP by its package: cropping changes nothing, and a missing package is an error."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation import figures as flip
from livehand.backend.evaluation.figures import flip_map
from livehand.backend.records.errors import LiveHandError

flip_evaluator = pytest.importorskip("flip_evaluator", reason="the extra `metrics` is not installed")


def test_the_map_equals_that_of_the_whole_image():
    rng = np.random.default_rng(0)
    truth = np.zeros((150, 140, 3), np.float32)
    truth[70:95, 40:60] = rng.random((25, 20, 3))
    image = truth.copy()
    image[72:90, 45:60] += 0.2 * rng.random((18, 15, 3), np.float32)
    whole, mean, _ = flip_evaluator.evaluate(truth, image.clip(0, 1), "LDR", applyMagma=False)
    found = flip_map(torch.as_tensor(image), torch.as_tensor(truth))
    np.testing.assert_allclose(found.numpy(), whole[..., 0], atol=1e-6)
    assert 0.005 < mean == pytest.approx(float(found.mean()), abs=1e-6)


def test_flip_of_equal_images_is_0_and_of_black_and_white_is_largest():
    black = torch.zeros(20, 20, 3)
    assert flip_map(black + 0.3, black + 0.3).equal(torch.zeros(20, 20))
    assert float(flip_map(black + 1, black).mean()) == pytest.approx(0.97, abs=0.04)


def test_a_missing_package_is_an_error_with_its_remedy(monkeypatch):
    monkeypatch.setattr(flip, "has_flip", lambda: False)
    with pytest.raises(LiveHandError, match=r'pip install "livehand\[metrics\]"'):
        flip_map(torch.zeros(4, 4, 3), torch.zeros(4, 4, 3))
