"""Distances by networks: against slow references, at extremes, and unfit files as errors."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.perceptual import lpips as lpips_module
from livehand.backend.evaluation.perceptual import weights as weights_module
from livehand.backend.evaluation.perceptual.backbones import Backbone, _alexnet, _squeezenet, _vgg16, layout_of
from livehand.backend.evaluation.perceptual.lpips import LpipsDistance, load_lpips
from livehand.backend.evaluation.perceptual.vgg import _LAYERS, VGG19_URL, PerceptualLoss, load_vgg_distance
from livehand.backend.records.errors import LiveHandError
from safetensors.torch import save_file
from torch.nn.functional import conv2d, max_pool2d

pytestmark = pytest.mark.slow

LAYOUTS = {"vgg16": _vgg16, "alexnet": _alexnet, "squeezenet1_1": _squeezenet}


def vgg19_weights(seed=0):
    generator = torch.Generator().manual_seed(seed)
    weights = {}
    for k, inputs, outputs, _ in _LAYERS:
        weights[f"{k}.weight"] = torch.randn(outputs, inputs, 3, 3, generator=generator) * (2 / (9 * inputs)) ** 0.5
        weights[f"{k}.bias"] = torch.zeros(outputs)
    return weights


@pytest.fixture(scope="module")
def perceptual():
    return PerceptualLoss(vgg19_weights())


def pictures(seed=0, side=16):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(1, 3, side, side - 4, generator=generator), torch.rand(1, 3, side, side - 4, generator=generator)


def backbone_weights(name, seed=0):
    """Random weights under torchvision's names that keep the features of order one."""
    generator, weights = torch.Generator().manual_seed(seed), {}
    for key, value in torch.nn.ModuleList(LAYOUTS[name]().layers).state_dict().items():
        deviation = (2 / value[0].numel()) ** 0.5 if value.ndim == 4 else 0.1
        weights[key] = torch.randn(value.shape, generator=generator) * deviation
    return weights


def head_weights(name, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return [torch.rand(count, generator=generator) for count in LAYOUTS[name]().channels]


def distance(name, range_mode="standard"):
    return LpipsDistance(Backbone(LAYOUTS[name](), backbone_weights(name)), head_weights(name), False, range_mode)


def test_the_vgg_distance_is_zero_for_equal_images_and_grows_with_the_difference(perceptual):
    image, target = pictures()
    assert float(perceptual(target, target)) == 0
    near, far = perceptual(target + 0.1 * (image - target), target), perceptual(image, target)
    assert 0 < float(near) < 0.5 * float(far)


def test_the_scale_of_a_publications_features_does_not_matter():
    """A gain in the first layer, undone nowhere: every compared feature grows alike, and so does its mean."""
    image, target = pictures()
    weights = vgg19_weights()
    louder = {**weights, "0.weight": weights["0.weight"] * 50}
    one, other = PerceptualLoss(weights)(image, target), PerceptualLoss(louder)(image, target)
    assert float(other) == pytest.approx(float(one), rel=0.02)


def test_zero_features_cause_no_division_by_zero():
    silent = PerceptualLoss({key: torch.zeros_like(value) for key, value in vgg19_weights().items()})
    image, target = pictures()
    assert float(silent(image, target)) == 0


def vgg16_features(weights, image):
    """The network written out: relu1_2, relu2_2, relu3_3, relu4_3, relu5_3."""
    found, x = [], image
    for block in ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28)):
        x = max_pool2d(x, 2) if found else x
        for k in block:
            x = conv2d(x, weights[f"{k}.weight"], weights[f"{k}.bias"], padding=1).clamp(min=0)
        found.append(x)
    return found


def alexnet_features(weights, image):
    found, x = [], image
    for k, stride, padding, is_pooled in ((0, 4, 2, 0), (3, 1, 2, 1), (6, 1, 1, 1), (8, 1, 1, 0), (10, 1, 1, 0)):
        x = max_pool2d(x, 3, 2) if is_pooled else x
        x = conv2d(x, weights[f"{k}.weight"], weights[f"{k}.bias"], stride, padding).clamp(min=0)
        found.append(x)
    return found


def squeezenet_features(weights, image):
    def layer(name, x, padding=0, stride=1):
        return conv2d(x, weights[f"{name}.weight"], weights[f"{name}.bias"], stride, padding).clamp(min=0)

    x = layer("0", image, stride=2)
    found = [x]
    for k in (3, 4, 6, 7, 9, 10, 11, 12):
        x = max_pool2d(x, 3, 2, ceil_mode=True) if k in (3, 6, 9) else x
        x = layer(f"{k}.squeeze", x)
        x = torch.cat([layer(f"{k}.expand1x1", x), layer(f"{k}.expand3x3", x, 1)], 1)
        found += [x] if k not in (3, 6) else []
    return found


FEATURES = {"vgg16": vgg16_features, "alexnet": alexnet_features, "squeezenet1_1": squeezenet_features}


@pytest.mark.parametrize("range_mode", ["standard", "reference"])
@pytest.mark.parametrize("name", FEATURES)
def test_lpips_follows_its_definition(name, range_mode):
    image, target = pictures(side=36)
    weights, heads, expected = backbone_weights(name), head_weights(name), 0.0
    mean, deviation = np.array([-0.030, -0.088, -0.188]), np.array([0.458, 0.448, 0.450])
    normalised = []
    for picture in (image, target):
        ranged = picture.double() * 2 - 1 if range_mode == "standard" else picture.double()
        columns = [(ranged[:, c] - mean[c]) / deviation[c] for c in range(3)]
        normalised.append(torch.stack(columns, 1))
    doubles = {key: value.double() for key, value in weights.items()}
    for a, b, head in zip(*(FEATURES[name](doubles, x) for x in normalised), heads, strict=True):
        a, b = (x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12) for x in (a.numpy(), b.numpy()))
        expected += ((a - b) ** 2 * head.numpy()[:, None, None]).sum(1).mean()
    assert float(distance(name, range_mode)(image, target)) == pytest.approx(expected, rel=1e-4)


def test_the_two_ranges_differ():
    image, target = pictures(side=36)
    standard, reference = (float(distance("vgg16", mode)(image, target)) for mode in ("standard", "reference"))
    assert reference < 0.9 * standard


def test_the_distance_of_a_batch_is_the_mean_over_its_images():
    pairs = [pictures(seed, side=36) for seed in range(2)]
    ours = distance("alexnet")
    each = [float(ours(*pair)) for pair in pairs]
    together = ours(*(torch.cat(images) for images in zip(*pairs, strict=True)))
    assert float(together) == pytest.approx(sum(each) / 2, rel=1e-5)


@pytest.mark.parametrize("name", FEATURES)
@pytest.mark.parametrize("level", [0.0, 1.0])
def test_gradients_are_finite_on_flat_images(name, level):
    """A flat picture has pixels without any feature, whose length has no derivative of its own."""
    image = torch.full((1, 3, 36, 32), level, requires_grad=True)
    silent = {key: value if "weight" in key else value - 3 for key, value in backbone_weights(name).items()}
    ours = LpipsDistance(Backbone(LAYOUTS[name](), silent), head_weights(name), False)
    for target in (image.detach(), torch.zeros_like(image.detach()), pictures(side=36)[0].clamp(0, 1)):
        value = ours(image, target)
        value.backward()
        assert value.isfinite()
        assert image.grad.isfinite().all()


@pytest.mark.parametrize("name", FEATURES)
def test_images_that_are_too_small_are_errors(name):
    ours, side = distance(name), LAYOUTS[name]().min_side_px
    enough = torch.rand(1, 3, side, side + 9)
    assert float(ours(enough, enough)) == 0
    with pytest.raises(LiveHandError, match=f"of at least {side} px per side, got \\({side + 9}, {side - 1}\\)"):
        ours(enough[:, :, 1:], enough[:, :, 1:])


def files(folder, name, heads=None, published=True):
    torch.save({f"features.{k}": v for k, v in backbone_weights(name).items()}, folder / "net.pth")
    heads = head_weights(name) if heads is None else heads
    named = {f"lin{k}.model.1.weight" if published else f"lin{k}": head for k, head in enumerate(heads)}
    save = torch.save if published else save_file
    named = {key: head[None, :, None, None] if published else head for key, head in named.items()}
    save(named, folder / ("heads.pth" if published else "heads.safetensors"))
    return folder / "net.pth", folder / ("heads.pth" if published else "heads.safetensors")


@pytest.mark.parametrize("name", FEATURES)
def test_the_network_is_recognised_from_its_file(tmp_path, name):
    image, target = pictures(side=36)
    for published in (True, False):
        loaded = load_lpips(*files(tmp_path, name, published=published))
        assert torch.equal(loaded(image, target), distance(name)(image, target))
        assert not loaded.is_lpips  # random weights are not torchvision's


def test_only_torchvisions_file_with_the_published_heads_is_lpips(tmp_path, monkeypatch):
    paths = files(tmp_path, "alexnet")
    monkeypatch.setattr(lpips_module, "_is_torchvisions", lambda path, weights, layout: True)
    assert not load_lpips(*paths).is_lpips
    heads = lpips_module._digest(head_weights("alexnet"))
    monkeypatch.setattr(lpips_module, "_HEADS", {"alexnet": heads})
    assert load_lpips(*paths).is_lpips
    monkeypatch.undo()
    monkeypatch.setattr(lpips_module, "_HEADS", {"alexnet": heads})
    assert not load_lpips(*paths).is_lpips


@pytest.mark.parametrize(
    ("name", "column"),
    [("alexnet", "lpips"), ("vgg16", "lpips_vgg16"), ("squeezenet1_1", "lpips_squeezenet1_1")],
)
def test_only_the_published_weights_make_a_column_of_lpips(name, column):
    backbone, heads = Backbone(LAYOUTS[name](), backbone_weights(name)), head_weights(name)
    assert LpipsDistance(backbone, heads, is_lpips=True).column == column
    assert LpipsDistance(backbone, heads, is_lpips=False).column == "uncalibrated"


def test_a_file_is_torchvisions_by_its_sha256(tmp_path):
    path = tmp_path / "any_name.pth"
    path.write_bytes(b"weights")
    digest = hashlib.sha256(b"weights").hexdigest()[:8]
    weights = backbone_weights("squeezenet1_1")
    layout = _squeezenet()._replace(file=f"squeezenet1_1-{digest}.pth")
    assert lpips_module._is_torchvisions(path, weights, layout)
    assert not lpips_module._is_torchvisions(path, weights, _squeezenet())


def test_or_by_its_values(tmp_path, monkeypatch):
    path, weights = tmp_path / "any_name.pth", backbone_weights("alexnet")
    path.write_bytes(b"the same values in another file")
    values = torch.cat([weights[name].flatten() for name in torch.nn.ModuleList(_alexnet().layers).state_dict()])
    digest = hashlib.sha256(values.numpy().tobytes()).hexdigest()[:16]
    monkeypatch.setattr(lpips_module, "_NETWORKS", {"alexnet": digest})
    assert lpips_module._is_torchvisions(path, weights, _alexnet())
    weights["0.bias"][3] += 1e-3
    assert not lpips_module._is_torchvisions(path, weights, _alexnet())


def test_unfit_files_are_errors(tmp_path):
    net, heads = files(tmp_path, "alexnet")
    with pytest.raises(LiveHandError, match=r"needs two files.*vgg16-397923af\.pth.*linear heads"):
        load_lpips(None, heads)
    with pytest.raises(LiveHandError, match=r"no perceptual weights at .*gone\.pth; give .*linear heads"):
        load_lpips(net, tmp_path / "gone.pth")
    save_file(vgg19_weights(), tmp_path / "vgg19.safetensors")
    with pytest.raises(LiveHandError, match=r"got another network in .*vgg19"):
        load_lpips(tmp_path / "vgg19.safetensors", heads)
    (tmp_path / "other").mkdir()
    _, others = files(tmp_path / "other", "vgg16")
    with pytest.raises(
        LiveHandError, match=r"\(64, 192, 384, 256, 256\) weights, as alexnet has channels, got \(64, 128"
    ):
        load_lpips(net, others)
    save_file(
        {**{f"lin{k}": h for k, h in enumerate(head_weights("alexnet"))}, "lin5": torch.ones(3)},
        tmp_path / "x.safetensors",
    )
    with pytest.raises(LiveHandError, match="LPIPS heads"):
        load_lpips(net, tmp_path / "x.safetensors")


def test_a_network_of_other_sizes_is_not_recognised():
    weights = backbone_weights("vgg16")
    assert layout_of(weights).file == "vgg16-397923af.pth"
    assert layout_of({**weights, "28.weight": weights["28.weight"][:7]}) is None
    assert layout_of({}) is None


def test_vgg19_from_either_kind_of_file(tmp_path, perceptual):
    weights = vgg19_weights()
    save_file(weights, tmp_path / "vgg.safetensors")
    torch.save({f"features.{key}": value for key, value in weights.items()}, tmp_path / "vgg.pth")
    image, target = pictures()
    for name in ("vgg.safetensors", "vgg.pth"):
        assert torch.equal(load_vgg_distance(tmp_path / name)(image, target), perceptual(image, target))


def test_vgg19_from_torchvisions_cache_or_server(tmp_path, monkeypatch, perceptual):
    image, target = pictures()
    state = {f"features.{key}": value for key, value in vgg19_weights().items()}
    monkeypatch.setattr(weights_module.torch.hub, "get_dir", lambda: str(tmp_path))
    asked = []

    def served(url, **options):
        asked.append((url, options["weights_only"], options["check_hash"]))
        return state

    monkeypatch.setattr(weights_module.torch.hub, "load_state_dict_from_url", served)
    assert torch.equal(load_vgg_distance(None)(image, target), perceptual(image, target))
    assert asked == [(VGG19_URL, True, True)]
    (tmp_path / "checkpoints").mkdir()
    torch.save(state, tmp_path / "checkpoints" / Path(VGG19_URL).name)
    assert torch.equal(load_vgg_distance(None)(image, target), perceptual(image, target))
    assert len(asked) == 1

    def offline(url, **options):
        raise OSError("no route")

    (tmp_path / "checkpoints" / Path(VGG19_URL).name).unlink()
    monkeypatch.setattr(weights_module.torch.hub, "load_state_dict_from_url", offline)
    with pytest.raises(LiveHandError, match=r"could not be downloaded \(no route\).*--perceptual 0"):
        load_vgg_distance(None)
    monkeypatch.undo()


def test_a_download_of_another_hash_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(weights_module.torch.hub, "get_dir", lambda: str(tmp_path))
    served = tmp_path / Path(VGG19_URL).name
    torch.save(vgg19_weights(), served)
    with pytest.raises(LiveHandError, match=r"could not be downloaded.*hash"):
        weights_module.fetch_weights(served.as_uri(), "give a file")
    assert list((tmp_path / "checkpoints").glob("*")) == []


def test_bad_vgg19_weights_are_errors(tmp_path):
    with pytest.raises(LiveHandError, match="no perceptual weights at"):
        load_vgg_distance(tmp_path / "gone.pth")
    (tmp_path / "text.pth").write_text("hello")
    (tmp_path / "text.safetensors").write_text("hello")
    torch.save({"model": np.float64}, tmp_path / "pickle.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    for name in ("text.pth", "text.safetensors", "pickle.pth", "list.pth"):
        with pytest.raises(LiveHandError, match=f"{name}"):
            load_vgg_distance(tmp_path / name)
    weights = vgg19_weights()
    save_file({key: value for key, value in weights.items() if key != "7.weight"}, tmp_path / "part.safetensors")
    with pytest.raises(LiveHandError, match=r"7\.weight"):
        load_vgg_distance(tmp_path / "part.safetensors")
    save_file({**weights, "7.weight": torch.zeros(3, 3)}, tmp_path / "shape.safetensors")
    with pytest.raises(LiveHandError, match=r"shape\.safetensors"):
        load_vgg_distance(tmp_path / "shape.safetensors")
