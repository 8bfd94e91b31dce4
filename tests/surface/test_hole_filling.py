"""Clear rays on a known surface: they are found, and have the colours of the skin around at their depth."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import RenderedRays, camera_tensors, ray_directions
from livehand.backend.field.volume import Composite
from livehand.backend.image.shading import SurfaceDepth, neighbours, shares_of_rays
from livehand.backend.light.indirect_diffuse import MeshPoints
from livehand.backend.light.lighting import SurfacePoints
from livehand.backend.records.camera import Camera
from livehand.backend.surface.hole_filling import CLEAR, OPAQUE, add_missing_rays, drop_outliers, inpaint
from livehand.backend.surface.ray_hits import RayHits
from torch.nn.functional import normalize

SIZE = (40, 30)
COUNT = SIZE[0] * SIZE[1]
EDGE_M = torch.tensor(0.003)
SKIN, PALM = torch.tensor([0.5, 0.3]), torch.tensor([0.1, 0.9])
NEAR_M, FAR_M = 0.5, 0.52
CENTRE = 15 * SIZE[0] + 20


def composite(straight, alpha):
    return Composite(straight * alpha[:, None], alpha, torch.zeros(len(alpha)), torch.zeros(len(alpha), 3))


def hits_at(depth):
    return RayHits(depth, torch.zeros(len(depth), 3))


def skin(alpha=None):
    """An image of rays that all meet the surface, of even colour."""
    alpha = torch.ones(COUNT) if alpha is None else alpha
    return composite(SKIN.repeat(COUNT, 1), alpha), torch.arange(COUNT), torch.full((COUNT,), NEAR_M)


def test_a_clear_ray_has_the_colours_and_the_opacity_around():
    low, pixel, depth = skin()
    low.channels[CENTRE], low.alpha[CENTRE] = torch.tensor([0.001, 0.0]), 0.01
    after = inpaint(low, pixel, SIZE, hits_at(depth), EDGE_M)
    torch.testing.assert_close(after.channels, SKIN.repeat(COUNT, 1))
    torch.testing.assert_close(after.alpha, torch.ones(COUNT))


def test_between_clear_and_opaque_a_ray_has_a_share_of_its_own_colours():
    low, pixel, depth = skin()
    half = (CLEAR + OPAQUE) / 2
    low.channels[CENTRE], low.alpha[CENTRE] = half * PALM, half
    after = inpaint(low, pixel, SIZE, hits_at(depth), EDGE_M)
    opacity = (half + 1) / 2
    assert after.alpha[CENTRE] == pytest.approx(opacity)
    torch.testing.assert_close(after.channels[CENTRE], opacity * (PALM + SKIN) / 2)


def test_colours_of_another_part_do_not_count():
    """Left of the clear ray a palm 2 cm behind, right of it the finger that it meets."""
    low, pixel, depth = skin()
    left = pixel % SIZE[0] < 20
    low.channels[left], depth[left] = PALM, FAR_M
    low.alpha[CENTRE], low.channels[CENTRE] = 0.0, torch.zeros(2)
    after = inpaint(low, pixel, SIZE, hits_at(depth), EDGE_M)
    torch.testing.assert_close(after.channels[CENTRE], SKIN)


def test_opaque_rays_and_those_beside_the_surface_stay():
    low, pixel, depth = skin(torch.linspace(0, 1, COUNT))
    depth[low.alpha < OPAQUE] = torch.inf
    after = inpaint(low, pixel, SIZE, hits_at(depth), EDGE_M)
    assert torch.equal(after.channels, low.channels)
    assert torch.equal(after.alpha, low.alpha)


def test_without_opaque_skin_around_rays_stay_as_they_are():
    low, pixel, depth = skin(torch.full((COUNT,), 0.1))
    after = inpaint(low, pixel, SIZE, hits_at(depth), EDGE_M)
    torch.testing.assert_close(after.channels, low.channels)


def test_pixels_of_the_surface_without_a_ray_get_a_clear_one():
    pixel = torch.tensor([3, 1])
    rays = RenderedRays(pixel, composite(SKIN.repeat(2, 1), torch.ones(2)), torch.full((2, 3), 0.4), torch.ones(2))
    depth = torch.tensor([torch.inf, 0.41, 0.42, 0.43])
    both, hits = add_missing_rays(rays, hits_at(depth))
    assert both.pixel.tolist() == [3, 1, 2]
    assert hits.depth.tolist() == pytest.approx([0.43, 0.41, 0.42])
    assert both.composite.alpha.tolist() == [1, 1, 0]
    assert both.t[2].tolist() == pytest.approx([0.42] * 3)
    assert depth.isfinite().tolist() == [False, True, True, True]  # nothing was changed
    same, _ = add_missing_rays(both, hits_at(depth))
    assert torch.equal(same.pixel, both.pixel)


def test_pixels_of_the_surface_take_no_light_from_clear_rays_beside_it(seen_camera):
    """Two rays on the surface, two beside it: the clear one has no share, the other as before."""
    directions = ray_directions(seen_camera, torch.arange(4))
    position, view = NEAR_M * directions, normalize(directions, dim=-1)
    points = SurfacePoints(position, view, view, view, MeshPoints(torch.zeros(4, 3).long(), torch.zeros(4, 3)))
    hits = hits_at(torch.tensor([NEAR_M, NEAR_M, torch.inf, torch.inf]))
    reported = drop_outliers(points, torch.tensor([1.0, 0.1, 0.1, 0.6]), hits, EDGE_M)
    assert torch.equal(reported.position[[0, 1, 3]], position[[0, 1, 3]])
    full = torch.arange(16)
    depth = torch.full((16,), NEAR_M)

    def shares(of):
        return shares_of_rays(of.position, torch.arange(4), seen_camera, full, SurfaceDepth(depth, EDGE_M))

    before, after = shares(points), shares(reported)
    rays, _ = neighbours(full, (2, 2))
    is_alone = (rays == 2).all(1)
    assert is_alone.sum() == 1  # at the corner, where no other ray is
    assert torch.equal(after[is_alone], before[is_alone])
    rays, before, after = (values[~is_alone] for values in (rays, before, after))
    assert before[rays == 2].max() > 0.5
    assert after[rays == 2].max() == 0
    torch.testing.assert_close(after.sum(1), torch.ones(15))
    others = before * (rays != 2)
    torch.testing.assert_close(after, others / others.sum(1, keepdim=True), atol=1e-5, rtol=0)


@pytest.fixture
def seen_camera():
    """2 x 2 rays from the origin."""
    K = np.array([[100.0, 0, 1], [0, 100, 1], [0, 0, 1]])
    return camera_tensors(Camera(K, np.diag([1.0, -1, -1, 1]), (2, 2)), "cpu")
