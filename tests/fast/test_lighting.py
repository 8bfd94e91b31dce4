"""The light's kernels against `nerf.relighting`, where no other test does."""

import numpy as np
import torch
from livehand.backend.fast.lighting import light_features, normals_at_steps, openness, shares_of_rays, smoothed_rays
from livehand.backend.geometry.shadow_maps import Bounds, PointShadows
from livehand.backend.nerf.bounce import PROBES, Probes
from livehand.backend.nerf.light_samples import LightSamples, SkySamples
from livehand.backend.nerf.lighting import COEFFICIENTS, LightShadows, ProbeLight, SurfacePoints
from livehand.backend.nerf.lighting import light_features as light_features_reference
from livehand.backend.nerf.lighting import openness as openness_reference
from livehand.backend.nerf.rays import CameraTensors, ray_directions
from livehand.backend.nerf.relighting import EnlargedRays, RaysAround, SkinDepth, covered_pixels
from livehand.backend.nerf.relighting import normals_at_steps as normals_reference
from livehand.backend.nerf.relighting import shares_of_rays as reference
from livehand.backend.nerf.relighting import smoothed_rays as smoothed_reference
from livehand.backend.records.light import Lamp, Light, rotation_facing
from torch.nn.functional import normalize

SIZE_PX = (13, 9)
CAMERA = CameraTensors(torch.tensor([[20.0, 0, 6.5], [0, 20, 4.5], [0, 0, 1]]), torch.eye(4), SIZE_PX)


def test_shares_are_those_of_torch_at_steps_of_depth_borders_and_where_nothing_is():
    random = torch.Generator().manual_seed(4)
    pixel = torch.rand(9 * 13, generator=random).lt(0.7).nonzero()[:, 0]
    pixel = torch.cat([pixel, torch.tensor([0, 12, 104, 116])]).unique()  # the corners too
    depth = torch.where(torch.rand(len(pixel), generator=random) < 0.5, 0.5, 0.52)
    position = depth[:, None] * ray_directions(CAMERA, pixel)
    at = covered_pixels(pixel, SIZE_PX)
    skin = torch.where(torch.rand(4 * 9 * 13, generator=random) < 0.5, 0.5, 0.52)
    skin += 0.004 * torch.rand(len(skin), generator=random)
    skin[torch.rand(len(skin), generator=random) < 0.3] = torch.inf
    where = position, pixel, CAMERA, at, SkinDepth(skin, torch.tensor(0.003))
    ours, theirs = shares_of_rays(*where), reference(*where)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
    torch.testing.assert_close(ours.sum(1), torch.ones(len(at)))
    assert ((theirs > 0.1) & (theirs < 0.3)).any()


def test_openness_is_that_of_torch_where_no_sky_is_seen_too():
    random = torch.Generator().manual_seed(7)
    sky, normal = SkySamples.of(None, "cpu"), normalize(torch.randn(200, 3, generator=random), dim=-1)
    lit = torch.rand(len(sky.towards), 200, generator=random) * (torch.rand(200, generator=random) < 0.9)
    shadows = PointShadows(lit, torch.zeros_like(lit))
    ours, theirs = openness(sky, shadows, normal), openness_reference(sky, shadows, normal)
    torch.testing.assert_close(ours.share, theirs.share)
    torch.testing.assert_close(ours.towards, theirs.towards, atol=1e-5, rtol=0)
    assert (ours.share == 0).any()
    assert ours.share.max() > 0.4


def test_lamps_of_every_kind_shine_as_in_torch_on_more_points_than_one_block():
    random, turn = torch.Generator().manual_seed(8), np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    near, rgb = np.array([0.1, -0.12, 0.15]), np.array([3.0, 2, 1])
    lamps = (
        Lamp("point", rgb, near),
        Lamp("area", rgb, near, rotation_facing(near / np.linalg.norm(near)), size_m=(0.05, 0.05), spread_rad=1.2),
        Lamp("area", rgb, near, turn, size_m=(0.05, 0.05)),
        Lamp("spot", rgb, near, rotation_facing(near / np.linalg.norm(near)), cone_rad=0.6),
        Lamp("sun", rgb, rotation=turn, casts_shadow=False),
    )
    light = LightSamples.of(Light(lamps), Bounds(torch.zeros(3), torch.tensor(0.1)))
    count, samples = 150, len(light.lamps.lamp)
    vectors = (normalize(torch.randn(count, 3, generator=random), dim=-1) for _ in range(3))
    points = SurfacePoints(0.1 * torch.rand(count, 3, generator=random) - 0.05, *vectors)
    sky, of_lamps = (
        PointShadows(torch.rand(k, count, generator=random), 0.02 * torch.rand(k, count, generator=random))
        for k in (len(light.sky.towards), samples)
    )
    skin = Probes(torch.zeros(PROBES, 3), torch.tensor([0.0, 0, 1]).expand(PROBES, 3), torch.tensor(1e-4))
    dark = ProbeLight(skin, torch.ones(3), torch.zeros(len(light.sky.towards), PROBES), torch.zeros(5, PROBES))
    ours, theirs = (
        of(light, LightShadows(sky, of_lamps, dark), points) for of in (light_features, light_features_reference)
    )
    torch.testing.assert_close(ours.lamp_vectors, theirs.lamp_vectors)
    torch.testing.assert_close(ours.scattered, theirs.scattered, atol=3e-6 * float(theirs.scattered.max()), rtol=1e-5)
    assert ((theirs.lamp_vectors.norm(dim=-1) > 0).float().mean(0) > 0.1).all()


def test_smoothed_rays_are_those_of_torch_with_holes_and_at_borders():
    random = torch.Generator().manual_seed(5)
    covered = torch.rand(9 * 13, generator=random).lt(0.6).nonzero()[:, 0]
    covered = torch.cat([covered, torch.tensor([0, 12, 104, 116])]).unique()
    alpha = 1.3 * torch.rand(9 * 13, generator=random) - 0.1
    coefficients = torch.rand(len(covered), COEFFICIENTS, generator=random)
    normal = normalize(torch.randn(len(covered), 3, generator=random), dim=-1)
    rays = EnlargedRays(coefficients, normal, alpha)
    ours, theirs = smoothed_rays(rays, covered, 13), smoothed_reference(rays, covered, 13)
    torch.testing.assert_close(ours.coefficients, theirs.coefficients)
    torch.testing.assert_close(ours.normal, theirs.normal, atol=1e-5, rtol=0)
    assert ours.alpha is alpha
    assert (ours.coefficients - coefficients).abs().max() > 0.1


def test_normals_at_steps_are_those_of_torch_with_holes_and_at_borders():
    random = torch.Generator().manual_seed(6)
    pixel = torch.rand(9 * 13, generator=random).lt(0.7).nonzero()[:, 0]
    pixel = torch.cat([pixel, torch.tensor([0, 12, 104, 116])]).unique()
    at = covered_pixels(pixel, SIZE_PX)
    depth = torch.where(torch.rand(len(pixel), generator=random) < 0.5, 0.5, 0.52)
    position = depth[:, None] * ray_directions(CAMERA, pixel)
    skin = SkinDepth(torch.where(torch.rand(4 * 9 * 13, generator=random) < 0.5, 0.5, 0.52), torch.tensor(0.003))
    rays = RaysAround(pixel, at, reference(position, pixel, CAMERA, at, skin), SIZE_PX)
    normal, of_rays = (normalize(torch.randn(len(x), 3, generator=random), dim=-1) for x in (at, pixel))
    ours, theirs = normals_at_steps(normal, of_rays, rays), normals_reference(normal, of_rays, rays)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
    assert ((ours - normal).abs().amax(1) > 0.5).sum() > 10
