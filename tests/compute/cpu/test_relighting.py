"""The kernels of relighting against `image.relighting`, where no other test does."""

import torch
from livehand.backend.compute.cpu.relighting import (
    normals_at_steps,
    shares_of_rays,
    smooth_enlarged_rays,
    view_directions,
)
from livehand.backend.field.rays import CameraTensors, ray_directions
from livehand.backend.field.rays import view_directions as views_reference
from livehand.backend.image.relighting import RaysAround, SkinDepth, covered_pixels, enlarged_rays
from livehand.backend.image.relighting import normals_at_steps as normals_reference
from livehand.backend.image.relighting import shares_of_rays as reference
from livehand.backend.image.relighting import smooth_enlarged_rays as smoothed_reference
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


def test_enlarged_rays_are_those_of_torch_with_holes_and_at_borders():
    random = torch.Generator().manual_seed(5)
    covered = torch.rand(4 * 9 * 13, generator=random).lt(0.6).nonzero()[:, 0]
    covered = covered[(covered // 26 < 3) | (covered // 26 > 4)]  # rows without any
    covered = torch.cat([covered, torch.tensor([0, 25, 4 * 9 * 13 - 26, 4 * 9 * 13 - 1])]).unique()
    maps = torch.rand(34, 9, 13, generator=random)
    maps[-1] = 1.2 * torch.rand(9, 13, generator=random) - 0.1
    detail = torch.rand(12, 18, 26, generator=random) - 0.5
    world2cam = torch.linalg.qr(torch.randn(4, 4, generator=random))[0]
    where = maps, detail, covered, world2cam
    ours, theirs, rough = smooth_enlarged_rays(*where), smoothed_reference(*where), enlarged_rays(*where)
    torch.testing.assert_close(ours.coefficients, theirs.coefficients, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(ours.normal, theirs.normal, atol=1e-4, rtol=0)
    torch.testing.assert_close(ours.alpha, theirs.alpha)
    assert (theirs.coefficients - rough.coefficients).abs().max() > 0.1
    assert (theirs.alpha < 0).any()


def test_enlarged_rays_do_not_depend_on_where_rows_are_split(monkeypatch):
    random = torch.Generator().manual_seed(9)
    where = torch.rand(34, 40, 13, generator=random), torch.rand(12, 80, 26, generator=random)
    covered = torch.rand(80 * 26, generator=random).lt(0.7).nonzero()[:, 0]
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
    whole = smooth_enlarged_rays(*where, covered, torch.eye(4))
    monkeypatch.setattr(torch, "get_num_threads", lambda: 3)
    parts = smooth_enlarged_rays(*where, covered, torch.eye(4))
    assert all(torch.equal(a, b) for a, b in zip(whole, parts, strict=True))


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


def test_views_are_those_of_torch_in_a_turned_camera():
    turned = torch.eye(4)
    turned[:3, :3] = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(3)))[0]
    camera, pixel = CAMERA._replace(world2cam=turned), torch.tensor([0, 5, 12, 13, 60, 116])
    torch.testing.assert_close(view_directions(camera, pixel), views_reference(camera, pixel), atol=1e-6, rtol=0)
