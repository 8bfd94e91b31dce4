"""Distances of the whole image and of the hand's crop, and their names."""

import math
from types import SimpleNamespace

import pytest
import torch
from livehand.backend.evaluation import distances
from livehand.backend.evaluation.distances import Distance, distance_of, lpips_distances, vgg19_distance

CPU = torch.device("cpu")


class Network(torch.nn.Module):
    def __init__(self, column="", min_side_px=1):
        super().__init__()
        self.column, self.backbone = column, SimpleNamespace(min_side_px=min_side_px)

    def forward(self, image, truth):
        return (image - truth).abs().sum()


def test_lpips_is_measured_of_images_in_either_range(monkeypatch, tmp_path):
    named = []
    monkeypatch.setattr(distances, "load_lpips", lambda *files: named.append(files) or Network("lpips_vgg16"))
    files = tmp_path / "net.pth", tmp_path / "heads.pth"
    assert [distance.name for distance in lpips_distances(*files, CPU)] == ["lpips_vgg16", "lpips_vgg16_reference"]
    assert named == [(*files, "standard"), (*files, "reference")]


def test_the_distance_of_training_is_not_called_lpips(monkeypatch, tmp_path):
    monkeypatch.setattr(distances, "load_vgg_distance", lambda file: Network())
    assert vgg19_distance(tmp_path / "vgg19.pth", CPU).name == "vgg19"


@pytest.mark.parametrize(
    ("rows", "columns", "crop"),
    [((50, 60), (40, 45), (slice(34, 76), slice(24, 61))), ((0, 3), (78, 80), (slice(0, 19), slice(62, 80)))],
)
def test_the_hands_crop_is_its_box_with_a_margin_of_16_px_within_the_image(rows, columns, crop):
    hand = torch.zeros(100, 80, dtype=torch.bool)
    hand[rows[0], columns[0]] = hand[rows[1] - 1, columns[1] - 1] = True
    truth, image = torch.rand(2, 100, 80, 3)
    found = distance_of(Distance("sum", Network()), image, truth, hand)
    assert found.full == pytest.approx(float((image - truth).abs().sum()), rel=1e-5)
    assert found.hand == pytest.approx(float((image - truth)[crop].abs().sum()), rel=1e-5)


def test_an_image_or_a_crop_that_is_too_small_for_the_network_has_none(monkeypatch, tmp_path):
    monkeypatch.setattr(distances, "load_lpips", lambda *files: Network("lpips", min_side_px=40))
    lpips, _ = lpips_distances(tmp_path / "net.pth", tmp_path / "heads.pth", CPU)
    hand = torch.zeros(60, 60, dtype=torch.bool)
    hand[20:28, 20:40] = True
    truth, image = torch.rand(2, 60, 60, 3)
    assert distance_of(lpips, image, truth, hand).full > 0
    assert distance_of(lpips, image, truth, hand).hand > 0  # 8 + 2 x 16 = 40 rows
    hand[20] = False
    assert math.isnan(distance_of(lpips, image, truth, hand).hand)
    assert math.isnan(distance_of(lpips, image[:39], truth[:39], hand[:39]).full)
