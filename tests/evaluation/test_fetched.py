"""LPIPS by the networks that `livehand fetch-perceptual` brings: its own values where they are, and made ones always.

The published values are of the authors' package: 0.722 and 0.138 by AlexNet of the two example pairs of its repository
(`imgs/ex_ref.png` with `ex_p0.png` and `ex_p1.png`; they are nobody's to pass on, and looked for in `out/perceptual`),
and by VGG16 those of ten pairs of random images.
"""

import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.perceptual import lpips as lpips_module
from livehand.backend.evaluation.perceptual.backbones import Backbone, layout_of_name
from livehand.backend.evaluation.perceptual.fetched import fetched_lpips, keep_lpips
from livehand.backend.evaluation.perceptual.lpips import LpipsDistance, load_lpips
from livehand.backend.evaluation.perceptual.lpips_package import (
    LPIPS_NETWORKS,
    has_lpips,
    lpips_files,
    perceptual_folder,
)
from livehand.backend.records.errors import LiveHandError
from PIL import Image
from torch import nn

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "out" / "perceptual"
JAX = {"alexnet": "AlexNet_0", "vgg16": "VGG16_0"}


@pytest.fixture
def published():
    """A function (network) -> LPIPS by it, or the test is skipped."""

    def load(name):
        if not has_lpips(name):
            pytest.skip(f"LPIPS by {name} has not been fetched; run: livehand fetch-perceptual")
        return fetched_lpips(name)

    with torch.inference_mode():
        yield load


def random_pairs():
    random = np.random.RandomState(123)  # as the published values were made
    return (torch.tensor(random.rand(10, 3, 100, 100), dtype=torch.float32) for _ in range(2))


def example(name):
    path = EXAMPLES / f"{name}.png"
    if not path.is_file():
        pytest.skip(f"the authors' example picture {path.name} is not in {EXAMPLES}")
    return torch.from_numpy(np.array(Image.open(path).convert("RGB"))).permute(2, 0, 1)[None] / 255


def test_vgg16_gives_the_published_values_of_random_images(published):
    distance = published("vgg16")
    pairs = [(a[None], b[None]) for a, b in zip(*random_pairs(), strict=True)]
    found = [round(float(distance(*pair)), 4) for pair in pairs]
    assert found == [0.3497, 0.3494, 0.3473, 0.3558, 0.3437, 0.3366, 0.3716, 0.3516, 0.3472, 0.3413]


def test_alexnet_gives_what_it_gave_when_it_met_the_published_values(published):
    assert float(published("alexnet")(*random_pairs())) == pytest.approx(0.14455, abs=2e-5)


@pytest.mark.parametrize(("name", "value"), [("ex_p0", 0.722), ("ex_p1", 0.138)])
def test_alexnet_gives_the_published_values_of_the_authors_pairs(published, name, value):
    assert round(float(published("alexnet")(example("ex_ref"), example(name))), 3) == value


def made_package(seed=0):
    """Random networks as the package holds them, and LPIPS by them, made without reading."""
    random, files, distances = np.random.default_rng(seed), {"LICENSE": b"none"}, {}
    for name in LPIPS_NETWORKS:
        layout = layout_of_name(name)
        tree, weights, heads = {JAX[name]: {}}, {}, []
        convolutions = {k: layer for k, layer in enumerate(layout.layers) if isinstance(layer, nn.Conv2d)}
        for number, (index, layer) in enumerate(convolutions.items()):
            shape = layer.weight.shape
            weight = random.normal(0, (2 / np.prod(shape[1:])) ** 0.5, shape).astype(np.float32)
            bias = random.normal(0, 0.1, shape[0]).astype(np.float32)
            tree[JAX[name]][f"Conv_{number}"] = {
                "kernel": np.ascontiguousarray(weight.transpose(2, 3, 1, 0)),
                "bias": bias,
            }
            weights |= {f"{index}.weight": torch.tensor(weight), f"{index}.bias": torch.tensor(bias)}
        for number, count in enumerate(layout.channels):
            heads.append(random.random(count).astype(np.float32))
            tree[f"NetLinLayer_{number}"] = {"Conv_0": {"kernel": heads[-1].reshape(1, 1, count, 1)}}
        files[f"{name}.ckpt"] = pickle.dumps(tree, protocol=3)
        distances[name] = LpipsDistance(Backbone(layout, weights), [torch.tensor(head) for head in heads], False)
    return files, distances


@pytest.fixture(scope="module")
def package():
    return made_package()


@pytest.fixture
def kept(package, tmp_path, monkeypatch):
    """The folder of the made package's networks, which count as the published ones."""
    monkeypatch.setattr(lpips_module, "_NETWORKS", dict.fromkeys(LPIPS_NETWORKS, ""))
    monkeypatch.setattr(lpips_module, "_HEADS", dict.fromkeys(LPIPS_NETWORKS, ""))
    return keep_lpips(package[0], tmp_path / "kept")


@pytest.mark.parametrize("name", LPIPS_NETWORKS)
def test_a_network_of_the_package_is_kept_as_it_is(kept, package, name):
    image, target = torch.rand(2, 1, 3, 40, 44, generator=torch.Generator().manual_seed(0))
    expected = package[1][name](image, target)
    assert torch.equal(fetched_lpips(name, folder=kept)(image, target), expected)
    assert torch.equal(load_lpips(*lpips_files(name, kept))(image, target), expected)
    assert (kept / "LICENSE").read_bytes() == b"none"


def test_other_weights_are_refused_and_not_called_lpips(package, tmp_path):
    with pytest.raises(LiveHandError, match=r"alexnet\.safetensors must hold the published LPIPS.*fetch-perceptual"):
        keep_lpips(package[0], tmp_path)


def test_missing_networks_name_the_command(tmp_path):
    assert not has_lpips("vgg16", tmp_path)
    with pytest.raises(LiveHandError, match=r"LPIPS by vgg16 needs its weights in .* livehand fetch-perceptual"):
        fetched_lpips("vgg16", folder=tmp_path)


def test_the_networks_lie_in_the_users_data_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert perceptual_folder() == tmp_path / "livehand" / "perceptual"
