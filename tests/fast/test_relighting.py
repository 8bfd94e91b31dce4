"""The kernels of relighting against `nerf.relighting`, where no other test does."""

import torch
from livehand.backend.fast.relighting import normals_at_steps, shares_of_rays, smoothed_rays
from livehand.backend.nerf.lighting import COEFFICIENTS
from livehand.backend.nerf.rays import CameraTensors, ray_directions
from livehand.backend.nerf.relighting import EnlargedRays, RaysAround, SkinDepth, covered_pixels
from livehand.backend.nerf.relighting import normals_at_steps as normals_reference
from livehand.backend.nerf.relighting import shares_of_rays as reference
from livehand.backend.nerf.relighting import smoothed_rays as smoothed_reference
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
