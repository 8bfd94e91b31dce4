"""The light's kernels against `light.lighting`, where no other test does."""

import numpy as np
import torch
from livehand.backend.compute.cpu.lighting import light_features, openness
from livehand.backend.light.bounce import Probes, SkinPlaces
from livehand.backend.light.light_samples import LightSamples
from livehand.backend.light.lighting import LightShadows, ProbeLight, SurfacePoints
from livehand.backend.light.lighting import light_features as light_features_reference
from livehand.backend.light.lighting import openness as openness_reference
from livehand.backend.light.shadow_maps import Bounds, PointShadows
from livehand.backend.light.sky_samples import SkySamples
from livehand.backend.records.light import Lamp, Light, rotation_facing
from torch.nn.functional import normalize


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
    beside = SkinPlaces(torch.zeros(count, 3, dtype=torch.long), torch.zeros(count, 3))
    points = SurfacePoints(0.1 * torch.rand(count, 3, generator=random) - 0.05, *vectors, beside)
    sky, of_lamps = (
        PointShadows(torch.rand(k, count, generator=random), 0.02 * torch.rand(k, count, generator=random))
        for k in (len(light.sky.towards), samples)
    )
    skin = Probes(
        torch.zeros(1, 3), torch.tensor([[0.0, 0, 1]]), torch.zeros(1, dtype=torch.long), torch.tensor([1e-4])
    )
    dark = ProbeLight(skin, torch.ones(3), torch.zeros(len(light.sky.towards), 1), torch.zeros(5, 1))
    ours, theirs = (
        of(light, LightShadows(sky, of_lamps, dark), points) for of in (light_features, light_features_reference)
    )
    torch.testing.assert_close(ours.lamp_vectors, theirs.lamp_vectors)
    torch.testing.assert_close(ours.scattered, theirs.scattered, atol=3e-6 * float(theirs.scattered.max()), rtol=1e-5)
    assert ((theirs.lamp_vectors.norm(dim=-1) > 0).float().mean(0) > 0.1).all()
