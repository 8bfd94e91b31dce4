"""The relightable field: coefficients that are not negative and know no direction of the world."""

import torch
from livehand.backend.avatars.avatar import PRESETS, build_field
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.volume import Composite
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix
from livehand.backend.light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES, AmbientOcclusion
from torch.nn.functional import normalize

CONFIG = FieldConfig(width=16, planes=((32, 3, 4),), relief=8, light="linear")
RAYS = 7


def rand(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def gathered_by(field, alpha=None):
    alpha = rand(RAYS) if alpha is None else alpha
    channels = (rand(RAYS, field.gathered_channels, seed=1) - 0.5) * alpha[:, None]
    return Composite(channels, alpha, rand(RAYS), rand(RAYS, 4))


def view_and_openness():
    view = normalize(rand(RAYS, 3, seed=2) - 0.5, dim=-1)
    return view, AmbientOcclusion(rand(RAYS, seed=3), normalize(rand(RAYS, 3, seed=4) - 0.5, dim=-1))


def test_coefficients_are_premultiplied_and_not_negative():
    field = build_field(CONFIG)
    gathered = gathered_by(field)
    decoded = field.decode(gathered, *view_and_openness())
    assert decoded.channels.shape == (RAYS, COEFFICIENTS + RELIGHTABLE_FEATURES)
    assert (decoded.channels[:, :COEFFICIENTS] >= 0).all()
    mean = gathered._replace(channels=gathered.channels / gathered.alpha[:, None], alpha=torch.ones(RAYS))
    straight = field.decode(mean, *view_and_openness()).channels
    torch.testing.assert_close(decoded.channels, straight * gathered.alpha[:, None], rtol=1e-4, atol=1e-6)


def test_a_ray_that_meets_nothing_has_no_coefficients():
    field = build_field(CONFIG)
    decoded = field.decode(gathered_by(field, torch.zeros(RAYS)), *view_and_openness())
    assert (decoded.channels == 0).all()


def test_turning_hand_view_and_openness_together_changes_nothing():
    field = build_field(CONFIG)
    gathered, (view, occlusion) = gathered_by(field), view_and_openness()
    turn = axis_angle_to_matrix(torch.tensor([0.4, -1.1, 0.7]))
    at = field.near_channels
    normals = gathered.channels[:, at : at + 6].reshape(RAYS, 2, 3) @ turn.T
    turned = gathered._replace(channels=torch.cat([gathered.channels[:, :at], normals.flatten(1)], 1))
    expected = field.decode(gathered, view, occlusion).channels
    found = field.decode(turned, view @ turn.T, AmbientOcclusion(occlusion.share, occlusion.towards @ turn.T)).channels
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)
    without = field.decode(turned, view, occlusion).channels
    assert (without - expected).abs().max() > 1e-3


def test_the_ablation_of_the_pose_leaves_it_out():
    field = build_field(FieldConfig(planes=((32, 3, 4),), relief=8, light="linear", pose=False))
    pose = slice(field.near_channels - 9, field.near_channels)
    assert (field.near.weight[:, pose] == 0).all()
    assert (field.trunk[0].weight[:, pose] == 0).all()


def test_the_preset_fits_in_eight_megabytes():
    config = PRESETS["relightable"]
    assert config.field.light == "linear"
    assert config.superres.kind == "lit"
    from livehand.backend.image.superres import build_superres

    networks = (build_field(config.field), build_superres(config.superres))
    assert 2 * sum(p.numel() for network in networks for p in network.parameters()) < 7.9e6


def test_a_coefficient_that_was_driven_to_nothing_can_come_back():
    field = build_field(CONFIG)
    with torch.no_grad():
        field.channels.bias[9] = -30.0
    decoded = field.decode(gathered_by(field, torch.ones(RAYS)), *view_and_openness()).channels[:, 9]
    assert decoded.max() < 5e-4
    (-decoded.sum()).backward()
    assert field.channels.bias.grad[9] < -1e-4
