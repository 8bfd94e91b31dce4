"""Means over rays on the same surface: they smooth it, and nothing crosses to another. Both backends."""

import pytest
import torch
from livehand.backend.image.edge_avoiding_filter import (
    OFF_PLANE_M,
    RaySurfacePoints,
    edge_avoiding_mean,
    smoothed_light,
)
from livehand.backend.image.shading import ray_rows, with_ray_rows
from livehand.backend.light.lamp_samples import HARD_RAD
from livehand.backend.light.lighting import LightFeatures
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment


def slanted_plane(width, height, step_m=0.0005, behind_from=None):
    """Rays on a slanted plane, row by row; from a column on they lie 20 mm behind it."""
    x, y = torch.meshgrid(torch.arange(width) * step_m, torch.arange(height) * step_m, indexing="xy")
    z = 0.75 * x
    if behind_from is not None:
        z = z - 0.02 * (x >= behind_from * step_m)
    position = torch.stack([x, y, z], -1).reshape(-1, 3)
    normal = torch.tensor([-0.6, 0.0, 0.8]).expand(len(position), 3)
    return RaySurfacePoints(position, normal, torch.arange(width * height), (width, height), OFF_PLANE_M)


def some_of(hit_points, chosen):
    position, normal, pixel = (values[chosen] for values in hit_points[:3])
    return hit_points._replace(position=position, normal=normal, pixel=pixel)


@pytest.mark.parametrize("stride", [1, 2])
def test_a_spike_spreads_by_the_binomial_shares(backend, stride):
    values = torch.zeros(121, 1)
    values[60] = 16  # in the middle
    found = backend.edge_avoiding_mean(values, slanted_plane(11, 11), stride).reshape(11, 11)
    spread = found[5 - stride : 6 + stride : stride, 5 - stride : 6 + stride : stride]
    torch.testing.assert_close(spread, torch.tensor([[1.0, 2, 1], [2, 4, 2], [1, 2, 1]]), atol=1e-4, rtol=0)
    assert found.sum().item() == pytest.approx(16, abs=1e-3)


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_light_does_not_cross_to_another_surface(backend, stride):
    hit_points = slanted_plane(24, 20, behind_from=12)
    is_behind = (hit_points.pixel % 24 >= 12).float()[:, None].expand(-1, 3)
    torch.testing.assert_close(backend.edge_avoiding_mean(is_behind, hit_points, stride), is_behind, atol=1e-6, rtol=0)


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_pixels_without_a_ray_and_borders_do_not_count(backend, stride):
    hit_points = slanted_plane(24, 20)
    kept = some_of(hit_points, hit_points.pixel % 7 != 0)
    ones = torch.ones(len(kept.pixel), 3)
    torch.testing.assert_close(backend.edge_avoiding_mean(ones, kept, stride), ones)


def test_a_ray_whose_normal_vanishes_keeps_its_light(backend):
    hit_points = slanted_plane(3, 3)._replace(normal=torch.zeros(9, 3))
    values = torch.arange(27.0).reshape(9, 3)
    torch.testing.assert_close(backend.edge_avoiding_mean(values, hit_points, 1), values)


def test_both_backends_agree_with_holes_and_turning_normals(backend_pair):
    random = torch.Generator().manual_seed(2)
    hit_points = slanted_plane(30, 20)
    bent = hit_points.normal + 0.5 * torch.randn(600, 3, generator=random)
    hit_points = hit_points._replace(normal=torch.nn.functional.normalize(bent, dim=-1))
    kept = some_of(hit_points, torch.rand(600, generator=random) < 0.7)
    values = torch.rand(len(kept.pixel), 11, generator=random)
    for stride in (1, 4):
        ours, theirs = (b.edge_avoiding_mean(values, kept, stride) for b in backend_pair)
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
        assert (ours - values).abs().max() > 0.1


def some_features(count, random):
    """Of rays and two lamps."""
    before, after = ((count, 2, 3), (2, 3), (2,), (count, 3, 3), (count, 2)), ((count, 2, 3),) * 2 + ((count, 3),) * 2
    drawn = [[torch.rand(shape, generator=random) for shape in shapes] for shapes in (before, after)]
    return LightFeatures(*drawn[0], PrefilteredEnvironment.of(None, "cpu"), *drawn[1])


def test_light_of_rays_is_smoothed_but_not_that_of_hard_lamps():
    random = torch.Generator().manual_seed(3)
    features = some_features(20, random)._replace(lamp_radius_rad=torch.tensor([HARD_RAD, 0.9 * HARD_RAD]) / 2)
    hit_points = slanted_plane(5, 4)
    found = smoothed_light(features, hit_points)
    assert found.lamp_rgb is features.lamp_rgb
    torch.testing.assert_close(
        found.scattered.flatten(1), edge_avoiding_mean(features.scattered.flatten(1), hit_points, 1)
    )
    torch.testing.assert_close(found.lamp_vectors[:, 0], edge_avoiding_mean(features.lamp_vectors[:, 0], hit_points, 1))
    assert torch.equal(found.lamp_vectors[:, 1], features.lamp_vectors[:, 1])


def test_rows_and_features_are_each_other_s_inverse():
    features = some_features(4, torch.Generator().manual_seed(4))
    again = with_ray_rows(features, ray_rows(features))
    assert again.mirrored is features.mirrored
    parts = [one._replace(mirrored=None) for one in (features, again)]
    assert all(a is b or torch.equal(a, b) for a, b in zip(*parts, strict=True))
