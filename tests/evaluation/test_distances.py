"""Distances of the whole image and of the hand's crop, and their names."""

import pytest
import torch
from livehand.backend.evaluation import distances
from livehand.backend.evaluation.distances import Distance, distance_of, lpips_distances, vgg19_distance

CPU = torch.device("cpu")


class Network(torch.nn.Module):
    def __init__(self, is_lpips):
        super().__init__()
        self.is_lpips = is_lpips

    def forward(self, image, truth):
        return (image - truth).abs().sum()


@pytest.mark.parametrize(("is_lpips", "name"), [(True, "lpips"), (False, "uncalibrated")])
def test_only_the_published_weights_make_lpips(is_lpips, name, monkeypatch, tmp_path):
    named = []
    monkeypatch.setattr(distances, "load_lpips", lambda *files: named.append(files) or Network(is_lpips))
    files = tmp_path / "net.pth", tmp_path / "heads.pth"
    assert [distance.name for distance in lpips_distances(*files, CPU)] == [name, f"{name}_reference"]
    assert named == [(*files, "standard"), (*files, "reference")]


def test_the_distance_of_training_is_not_called_lpips(monkeypatch, tmp_path):
    monkeypatch.setattr(distances, "load_vgg_distance", lambda file: Network(False))
    assert vgg19_distance(tmp_path / "vgg19.pth", CPU).name == "vgg19"


@pytest.mark.parametrize(
    ("rows", "columns", "crop"),
    [((50, 60), (40, 45), (slice(34, 76), slice(24, 61))), ((0, 3), (78, 80), (slice(0, 19), slice(62, 80)))],
)
def test_the_hands_crop_is_its_box_with_a_margin_of_16_px_within_the_image(rows, columns, crop):
    hand = torch.zeros(100, 80, dtype=torch.bool)
    hand[rows[0], columns[0]] = hand[rows[1] - 1, columns[1] - 1] = True
    truth, image = torch.rand(2, 100, 80, 3)
    found = distance_of(Distance("sum", Network(True)), image, truth, hand)
    assert found.full == pytest.approx(float((image - truth).abs().sum()), rel=1e-5)
    assert found.hand == pytest.approx(float((image - truth)[crop].abs().sum()), rel=1e-5)
