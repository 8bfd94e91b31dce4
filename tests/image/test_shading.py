"""From rays to a picture in any light: a flat patch keeps its values, and the product is what the rays' light makes."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.rays import CameraTensors, camera_tensors, ray_directions
from livehand.backend.field.volume import Composite
from livehand.backend.image.depth_steps import RaysAround, coefficients_at_steps, neighbours, normals_at_steps
from livehand.backend.image.shading import (
    EnlargedRays,
    SurfaceDepth,
    covered_pixels,
    detailed,
    diffuse_and_specular,
    enlarged_rays,
    shade_rays,
    shading_inputs,
    shares_of_rays,
    smoothed_rays,
)
from livehand.backend.image.superres import SuperResConfig, build_superres, enlarge
from livehand.backend.light.indirect_diffuse import MeshPoints
from livehand.backend.light.lighting import (
    COEFFICIENTS,
    DIFFUSE,
    GLOSS,
    RELIGHTABLE_FEATURES,
    SMOOTH,
    BumpMapping,
    LightFeatures,
    SurfacePoints,
)
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.records.camera import Camera
from livehand.backend.records.light import Sky
from torch.nn.functional import normalize

SIZE = (9, 7)
TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
CAM2WORLD = np.eye(4)
CAM2WORLD[:3, :3] = TURN * np.sign(np.linalg.det(TURN))


def some_rays(pixel, seed=0):
    """Rays of the same coefficients, that face the camera."""
    generator = torch.Generator().manual_seed(seed)
    camera = camera_tensors(Camera(np.array([[20.0, 0, 4], [0, 20, 3], [0, 0, 1]]), CAM2WORLD, SIZE), "cpu")
    view = normalize(ray_directions(camera, pixel), dim=-1)
    coefficients = torch.rand(COEFFICIENTS, generator=generator).expand(len(pixel), -1)
    channels = torch.cat([coefficients, torch.zeros(len(pixel), RELIGHTABLE_FEATURES)], 1)
    low = Composite(channels, torch.ones(len(pixel)), torch.full((len(pixel),), 0.5), torch.ones(len(pixel), 1))
    normal = -torch.as_tensor(CAM2WORLD[:3, 2], dtype=torch.float32).expand(len(pixel), 3)
    return (
        camera,
        low,
        SurfacePoints(
            0.5 * view, normal, normal, view, MeshPoints(torch.zeros(len(view), 3).long(), torch.zeros(len(view), 3))
        ),
    )


def some_features(count, seed=1):
    generator = torch.Generator().manual_seed(seed)

    def rand(*shape):
        return torch.rand(*shape, generator=generator)

    vectors = -0.3 * torch.as_tensor(CAM2WORLD[:3, 2], dtype=torch.float32) + 0.1 * rand(1, 2, 3)
    values = (vectors, rand(1, 3, 3), rand(1, 2), rand(1, 2, 3), rand(1, 2, 3))
    vectors, sky, seen, specular, scattered = (value.expand(count, *value.shape[1:]) for value in values)
    arriving, reflected = (rand(1, 3).expand(count, 3) for _ in range(2))
    lamps, mirrored = (rand(2, 3), rand(2) * 0.2), some_sky(seed)
    return LightFeatures(vectors, *lamps, sky, seen, mirrored, specular, scattered, arriving, reflected)


def some_sky(seed):
    return PrefilteredEnvironment.of(Sky(np.random.default_rng(seed).uniform(0, 1, (4, 8, 3))), "cpu")


def untrained(seed=0):
    """Super-resolution that enlarges bilinearly."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return build_superres(SuperResConfig(kind="lit", width=8, depth=2))


ALL = torch.arange(SIZE[0] * SIZE[1])
EDGE = torch.tensor(0.003)
BESIDE = SurfaceDepth(torch.full((4 * len(ALL),), torch.inf), EDGE)  # nowhere


def test_an_even_patch_has_the_colour_of_its_rays(backend):
    camera, low, points = some_rays(ALL)
    features = some_features(len(ALL))
    image = shading_inputs(untrained(), low, points, ALL, camera, BESIDE)
    large = backend.shade_image(image, features, ALL, SIZE)
    small = shade_rays(low, points, features)
    assert large.shape == (3, 2 * SIZE[1], 2 * SIZE[0])
    # Only the view differs from pixel to pixel: the specular part alone varies, and little.
    torch.testing.assert_close(large.mean((1, 2)), small.mean(0), rtol=0.01, atol=1e-4)
    torch.testing.assert_close(image.alpha, torch.ones_like(image.alpha))


def test_normals_and_views_of_the_image_are_the_worlds():
    camera, low, points = some_rays(ALL)
    image = shading_inputs(untrained(), low, points, ALL, camera, BESIDE)
    torch.testing.assert_close(image.normal, points.normal[:1].expand_as(image.normal), atol=1e-5, rtol=0)
    assert len(image.pixel) == 4 * len(ALL)
    # A pixel's view lies between those of the rays around it; four of them share a ray's.
    view = torch.zeros(4 * len(ALL), 3).index_put((image.pixel,), image.view).reshape(2 * SIZE[1], 2 * SIZE[0], 3)
    mean = view.reshape(SIZE[1], 2, SIZE[0], 2, 3).mean((1, 3)).reshape(-1, 3)
    torch.testing.assert_close(normalize(mean, dim=-1), points.view, atol=1e-3, rtol=0)


def test_light_does_not_bleed_from_where_there_is_no_ray(backend):
    """At the border of the rays their own light is continued, not darkened."""
    pixel = torch.tensor([12, 13, 21, 22])
    camera, low, points = some_rays(pixel)
    features = some_features(4)
    image = shading_inputs(untrained(), low, points, pixel, camera, BESIDE)
    coefficients = torch.zeros_like(image.coefficients)
    coefficients[:, DIFFUSE] = 1
    even = image._replace(coefficients=coefficients)
    lit = backend.shade_image(even, features, pixel, SIZE).flatten(1)[:, image.pixel]
    torch.testing.assert_close(lit, lit[:, :1].expand_as(lit), rtol=1e-4, atol=1e-6)
    outside = torch.ones(4 * SIZE[0] * SIZE[1], dtype=torch.bool)
    outside[image.pixel] = False
    assert backend.shade_image(even, features, pixel, SIZE).flatten(1)[:, outside].abs().max() == 0


@pytest.mark.parametrize("lamps", [0, 1, 4])
def test_both_backends_agree_on_any_rays(backend_pair, lamps):
    generator = torch.Generator().manual_seed(lamps)
    pixel = torch.randperm(len(ALL), generator=generator)[:30].sort().values
    camera, low, points = some_rays(pixel)
    low = low._replace(channels=torch.rand(low.channels.shape, generator=generator))
    relief = normalize(points.normal + 0.4 * torch.randn(30, 3, generator=generator), dim=-1)
    image = shading_inputs(untrained(), low, points._replace(relief_normal=relief), pixel, camera, BESIDE)
    features = LightFeatures(
        torch.randn(30, lamps, 3, generator=generator) / pi,
        torch.rand(lamps, 3, generator=generator),
        torch.rand(lamps, generator=generator),
        torch.randn(30, 3, 3, generator=generator),
        torch.rand(30, 2, generator=generator),
        some_sky(lamps),
        *(torch.randn(30, 2, 3, generator=generator) for _ in range(2)),
        *(torch.rand(30, 3, generator=generator) for _ in range(2)),
    )
    bent = normalize(image.normal + 0.5 * torch.randn(len(image.pixel), 3, generator=generator), dim=-1)
    skin = BumpMapping(
        surface_normal=image.normal,
        blurred_normal=normalize(image.normal + 0.3 * torch.randn(len(bent), 3, generator=generator), dim=-1),
        sharpness=torch.tensor([0.0, 0.6, 0.9]),
        alpha_squared=0.02 + 0.2 * torch.rand(len(bent), generator=generator),
        nail=(3 * torch.rand(len(bent), generator=generator) - 1).clamp(0, 1),
    )
    coefficients, known = image.coefficients.clone(), torch.arange(len(bent)) % 2 == 0
    coefficients[known, GLOSS] *= torch.stack([skin.nail, 1 - skin.nail], 1)[known]
    coefficients[::5, GLOSS] = 0
    assert (coefficients[:, GLOSS] == 0).any(0).all()
    image = image._replace(normal=bent, skin=skin, coefficients=coefficients)
    ours, theirs = (backend.shade_image(image, features, pixel, SIZE) for backend in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-3)
    assert ours.abs().max() > 0.1
    diffuse, specular = (
        backend_pair[0].shade_image(part, features, pixel, SIZE) for part in diffuse_and_specular(image)
    )
    torch.testing.assert_close(diffuse + specular, ours, atol=1e-4, rtol=1e-3)
    assert min(diffuse.abs().max(), specular.abs().max()) > 0.01


def test_both_backends_enlarge_rays_alike_and_leave_the_rest_empty(backend_pair):
    pixel = torch.tensor([12, 13, 21, 22])
    camera, low, points = some_rays(pixel)
    noise = torch.rand(1, 12, 2 * SIZE[1], 2 * SIZE[0], generator=torch.Generator().manual_seed(2))
    ours, theirs = (
        backend.shading_inputs(lambda _: noise, low, points, pixel, camera, BESIDE) for backend in backend_pair
    )
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)
    outside = torch.ones(4 * len(ALL), dtype=torch.bool)
    outside[theirs.pixel] = False
    assert theirs.alpha.flatten()[outside].abs().max() == 0
    assert theirs.alpha.flatten()[~outside].min() > 0


def test_at_a_step_of_depth_the_normal_is_that_of_the_rays_whose_light_falls_there():
    right = ALL % SIZE[0] >= 5
    of_rays = torch.where(right[:, None], torch.tensor([1.0, 0, 0]), torch.tensor([0.0, 0, 1]))
    at = torch.arange(4 * len(ALL))
    _, even = neighbours(at, SIZE)
    blurred = torch.tensor([0.6, 0.0, 0.8]).expand(len(at), 3)
    torch.testing.assert_close(normals_at_steps(blurred, of_rays, RaysAround(ALL, at, even, SIZE)), blurred)
    share = torch.zeros_like(even)
    share[:, 0] = 1  # all of the ray to the upper left
    found = normals_at_steps(blurred, of_rays, RaysAround(ALL, at, share, SIZE))
    around, _ = neighbours(at, SIZE)
    is_whole = (share - even).abs().sum(1) >= 1
    assert is_whole.sum() > 100
    torch.testing.assert_close(found[is_whole], of_rays[around[is_whole, 0]])


def two_parts():
    """Maps of 1 to the left and of 3 to the right, rays of which only left ones count, and where there are any."""
    right = ALL % SIZE[0] >= 5
    maps = torch.ones(34, SIZE[1], SIZE[0])
    maps[:COEFFICIENTS] = torch.where(right, 3.0, 1.0).reshape(SIZE[1], SIZE[0])
    at = torch.arange(4 * len(ALL))
    around, even = neighbours(at, SIZE)
    left = even * ~right[around]
    has_left = left.sum(1) > 0
    share = torch.where(has_left[:, None], left / left.sum(1, keepdim=True).clamp(min=0.1), even)
    return maps, RaysAround(ALL, at, share, SIZE), has_left


def test_at_a_step_of_depth_colours_are_not_those_of_the_part_behind():
    maps, rays, has_left = two_parts()
    alpha = torch.full((len(rays.at),), 0.5)
    even = maps[:COEFFICIENTS].flatten(1).T[neighbours(rays.at, SIZE)[0]]
    enlarged = 0.5 * (even * neighbours(rays.at, SIZE)[1][..., None]).sum(1)
    found = coefficients_at_steps(enlarged, alpha, maps, rays)
    is_mixed = has_left & (enlarged[:, 0] > 0.5)
    assert is_mixed.sum() >= 2 * SIZE[1]
    strongly = found[is_mixed & (enlarged[:, 0] > 0.9)]
    torch.testing.assert_close(strongly, torch.full_like(strongly, 0.5))
    assert (found[is_mixed] < enlarged[is_mixed] - 0.1).all()
    torch.testing.assert_close(found[~is_mixed], enlarged[~is_mixed])


def test_beside_the_outline_colours_stay():
    """Rays that meet nothing are no other part."""
    maps, rays, _ = two_parts()
    maps = maps * (maps[:1] < 2)  # those to the right are transparent
    enlarged = torch.rand(len(rays.at), COEFFICIENTS, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(coefficients_at_steps(enlarged, torch.ones(len(rays.at)), maps, rays), enlarged)


def test_gradients_reach_coefficients_and_normals():
    camera, low, points = some_rays(ALL)
    network = untrained()
    relief = points.relief_normal.clone().requires_grad_()
    channels = low.channels.clone().requires_grad_()
    image = shading_inputs(
        network, low._replace(channels=channels), points._replace(relief_normal=relief), ALL, camera, BESIDE
    )
    ReferenceBackend().shade_image(image, some_features(len(ALL)), ALL, SIZE).square().mean().backward()
    assert relief.grad.isfinite().all()
    assert relief.grad.abs().sum() > 0
    assert channels.grad[:, :COEFFICIENTS].isfinite().all()
    assert channels.grad[:, :COEFFICIENTS].abs().sum() > 0
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def test_without_a_mesh_the_rays_share_as_in_bilinear_enlargement():
    pixel = torch.tensor([12, 13, 21, 22])
    camera, _, points = some_rays(pixel)
    at = covered_pixels(pixel, SIZE)
    share = shares_of_rays(points.position, pixel, camera, at, BESIDE)
    values = torch.zeros(len(ALL), 2)
    values[pixel] = torch.tensor([[1.0, 1], [1, 2], [1, 4], [1, 8]])
    around, _ = neighbours(at, SIZE)
    ours = (values[around] * share[..., None]).sum(1)
    large = enlarge(values.T.reshape(1, 2, SIZE[1], SIZE[0]))[0].flatten(1)[:, at]
    torch.testing.assert_close(ours[:, 0], torch.ones(len(at)))
    torch.testing.assert_close(ours[:, 1], large[1] / large[0])


def test_light_stays_on_its_surface():
    """A finger, 0.5 m away, covers the left of the image up to a column between two rays; behind it lies a palm."""
    camera, _, points = some_rays(ALL)
    is_finger = ALL % SIZE[0] < 4
    depth = torch.where(is_finger, 0.5, 0.6)
    position = points.view * (depth / (points.view @ camera.world2cam[2, :3]))[:, None]
    at = torch.arange(4 * len(ALL))
    is_finger_there = at % (2 * SIZE[0]) < 9  # a column farther than the rays say
    share = shares_of_rays(position, ALL, camera, at, SurfaceDepth(torch.where(is_finger_there, 0.5, 0.6), EDGE))
    around, _ = neighbours(at, SIZE)
    of_finger = (share * is_finger[around]).sum(1).reshape(-1, 2 * SIZE[0])
    expected = torch.tensor([1.0] * 8 + [7 / 8] + [0.0] * 9)  # a soft edge: an eighth is of the pixel beside it
    torch.testing.assert_close(of_finger, expected.expand_as(of_finger), atol=1e-3, rtol=0)
    torch.testing.assert_close(share.sum(1), torch.ones(len(at)))


def test_what_alternates_from_pixel_to_pixel_is_gone_and_partial_coverage_keeps_its_colour():
    """Stripes one pixel wide, under a coverage that falls from left to right; straight values are even afterwards."""
    width, height = 12, 8
    covered = torch.arange(width * height)
    stripes = 1 + 0.5 * (-1.0) ** (covered % width + covered // width)
    alpha = 1 - (covered % width) / (2 * width)
    tilt = 0.3 * (-1.0) ** (covered // width)
    normal = normalize(torch.stack([tilt, torch.zeros(len(covered)), torch.ones(len(covered))], 1), dim=-1)
    rays = EnlargedRays((stripes * alpha)[:, None].expand(-1, COEFFICIENTS), normal, alpha)
    found = smoothed_rays(rays, covered, width)
    inner = (covered % width > 0) & (covered % width < width - 1) & (covered // width > 0)
    inner &= covered // width < height - 1
    straight = found.coefficients[:, 0] / alpha
    torch.testing.assert_close(straight[inner], torch.ones(int(inner.sum())), atol=0.02, rtol=0)
    torch.testing.assert_close(found.normal[inner, 0], torch.zeros(int(inner.sum())), atol=1e-3, rtol=0)
    assert torch.equal(found.alpha, alpha)


def test_detail_that_takes_all_of_a_coefficient_can_be_unlearnt():
    maps = torch.ones(34, 4, 4)
    detail = torch.full((12, 8, 8), -5.0, requires_grad=True)
    found = detailed(maps, detail)[DIFFUSE]
    assert found.detach().abs().max() == 0
    (-found.sum()).backward()
    assert (detail.grad[DIFFUSE.start - SMOOTH : DIFFUSE.stop - SMOOTH] == -1).all()


UNEVEN_PX = (13, 9)
CAMERA = CameraTensors(torch.tensor([[20.0, 0, 6.5], [0, 20, 4.5], [0, 0, 1]]), torch.eye(4), UNEVEN_PX)


def test_shares_are_the_references_at_steps_of_depth_borders_and_where_nothing_is(backend_pair):
    random = torch.Generator().manual_seed(4)
    pixel = torch.rand(9 * 13, generator=random).lt(0.7).nonzero()[:, 0]
    pixel = torch.cat([pixel, torch.tensor([0, 12, 104, 116])]).unique()  # the corners too
    depth = torch.where(torch.rand(len(pixel), generator=random) < 0.5, 0.5, 0.52)
    position = depth[:, None] * ray_directions(CAMERA, pixel)
    at = covered_pixels(pixel, UNEVEN_PX)
    skin = torch.where(torch.rand(4 * 9 * 13, generator=random) < 0.5, 0.5, 0.52)
    skin += 0.004 * torch.rand(len(skin), generator=random)
    skin[torch.rand(len(skin), generator=random) < 0.3] = torch.inf
    where = position, pixel, CAMERA, at, SurfaceDepth(skin, torch.tensor(0.003))
    ours, theirs = (each.shares_of_rays(*where) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
    torch.testing.assert_close(ours.sum(1), torch.ones(len(at)))
    assert ((theirs > 0.1) & (theirs < 0.3)).any()


def test_enlarged_rays_are_the_references_with_holes_and_at_borders(backend_pair):
    random = torch.Generator().manual_seed(5)
    covered = torch.rand(4 * 9 * 13, generator=random).lt(0.6).nonzero()[:, 0]
    covered = covered[(covered // 26 < 3) | (covered // 26 > 4)]  # rows without any
    covered = torch.cat([covered, torch.tensor([0, 25, 4 * 9 * 13 - 26, 4 * 9 * 13 - 1])]).unique()
    maps = torch.rand(34, 9, 13, generator=random)
    maps[-1] = 1.2 * torch.rand(9, 13, generator=random) - 0.1
    detail = torch.rand(12, 18, 26, generator=random) - 0.5
    world2cam = torch.linalg.qr(torch.randn(4, 4, generator=random))[0]
    where = maps, detail, covered, world2cam
    (ours, theirs), rough = (each.smooth_enlarged_rays(*where) for each in backend_pair), enlarged_rays(*where)
    torch.testing.assert_close(ours.coefficients, theirs.coefficients, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(ours.normal, theirs.normal, atol=1e-4, rtol=0)
    torch.testing.assert_close(ours.alpha, theirs.alpha)
    assert (theirs.coefficients - rough.coefficients).abs().max() > 0.1
    assert (theirs.alpha < 0).any()


def test_enlarged_rays_do_not_depend_on_where_rows_are_split(monkeypatch, backend):
    random = torch.Generator().manual_seed(9)
    where = torch.rand(34, 40, 13, generator=random), torch.rand(12, 80, 26, generator=random)
    covered = torch.rand(80 * 26, generator=random).lt(0.7).nonzero()[:, 0]
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
    whole = backend.smooth_enlarged_rays(*where, covered, torch.eye(4))
    monkeypatch.setattr(torch, "get_num_threads", lambda: 3)
    parts = backend.smooth_enlarged_rays(*where, covered, torch.eye(4))
    assert all(torch.equal(a, b) for a, b in zip(whole, parts, strict=True))


def test_normals_at_steps_are_the_references_with_holes_and_at_borders(backend_pair):
    random = torch.Generator().manual_seed(6)
    pixel = torch.rand(9 * 13, generator=random).lt(0.7).nonzero()[:, 0]
    pixel = torch.cat([pixel, torch.tensor([0, 12, 104, 116])]).unique()
    at = covered_pixels(pixel, UNEVEN_PX)
    depth = torch.where(torch.rand(len(pixel), generator=random) < 0.5, 0.5, 0.52)
    position = depth[:, None] * ray_directions(CAMERA, pixel)
    skin = SurfaceDepth(torch.where(torch.rand(4 * 9 * 13, generator=random) < 0.5, 0.5, 0.52), torch.tensor(0.003))
    rays = RaysAround(pixel, at, shares_of_rays(position, pixel, CAMERA, at, skin), UNEVEN_PX)
    normal, of_rays = (normalize(torch.randn(len(x), 3, generator=random), dim=-1) for x in (at, pixel))
    ours, theirs = (each.normals_at_steps(normal, of_rays, rays) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
    assert ((ours - normal).abs().amax(1) > 0.5).sum() > 10


def test_coefficients_at_steps_are_the_references_with_holes_and_at_borders(backend_pair):
    random = torch.Generator().manual_seed(7)
    maps = torch.rand(9, 13, 34, generator=random).permute(2, 0, 1)  # as stages make them
    maps *= torch.rand(9, 13, generator=random) < 0.7
    maps[:-1] *= maps[-1]
    at = torch.rand(4 * 9 * 13, generator=random).lt(0.8).nonzero()[:, 0]
    share = torch.rand(len(at), 4, generator=random) ** 4
    rays = RaysAround(torch.arange(9 * 13), at, share / share.sum(1, keepdim=True), UNEVEN_PX)
    alpha, before = torch.rand(4 * 9 * 13, generator=random), torch.rand(len(at), COEFFICIENTS, generator=random)
    ours, theirs = (each.coefficients_at_steps(before, alpha, maps, rays) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)
    assert ((ours - before).abs().amax(1) > 0.2).sum() > 10


def test_views_are_the_references_in_a_turned_camera(backend_pair):
    turned = torch.eye(4)
    turned[:3, :3] = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(3)))[0]
    camera, pixel = CAMERA._replace(world2cam=turned), torch.tensor([0, 5, 12, 13, 60, 116])
    ours, theirs = (each.view_directions(camera, pixel) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-6, rtol=0)
