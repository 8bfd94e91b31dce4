"""Rays and projection against the camera record, and rays taken apart and put together."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import SurfaceRays, camera_tensors, project, ray_directions, ray_origin, split_rays
from livehand.backend.geometry.uvh import SurfaceSamples
from livehand.backend.records.camera import Camera, look_at

SIZE = (41, 37)
CAMERA = Camera(np.array([[50.0, 0, 20], [0, 60, 18], [0, 0, 1]]), look_at(*np.eye(3)), SIZE)


def test_view_of_is_the_camera():
    view = camera_tensors(CAMERA, "cpu")
    assert view.size_px == SIZE
    np.testing.assert_allclose(view.K, CAMERA.K)
    np.testing.assert_allclose(view.world2cam.numpy() @ CAMERA.cam2world, np.eye(4), atol=1e-6)


def test_rays_and_projection_agree_with_the_camera_record():
    view = camera_tensors(CAMERA, "cpu")
    pixel = torch.tensor([0, 7, 41, 500])
    centres = np.array([[0.5, 0.5], [7.5, 0.5], [0.5, 1.5], [500 % 41 + 0.5, 500 // 41 + 0.5]])
    np.testing.assert_allclose(ray_directions(view, pixel), CAMERA.ray_directions(centres), atol=1e-5)
    np.testing.assert_allclose(ray_origin(view), CAMERA.origin, atol=1e-6)
    points = np.random.default_rng(0).normal(size=(5, 3))
    for ours, theirs in zip(project(view, torch.as_tensor(points, dtype=torch.float32)), CAMERA.project(points)):  # noqa: B905
        np.testing.assert_allclose(ours, theirs, rtol=2e-4, atol=1e-4)


def test_a_ray_at_a_depth_projects_to_its_pixels_centre():
    view = camera_tensors(CAMERA, "cpu")
    pixel = torch.arange(SIZE[0] * SIZE[1])
    px, depth = project(view, ray_origin(view) + 0.7 * ray_directions(view, pixel))
    torch.testing.assert_close(depth, torch.full_like(depth, 0.7))
    centre = torch.stack([pixel % SIZE[0], pixel // SIZE[0]], -1) + 0.5
    torch.testing.assert_close(px, centre, atol=2e-3, rtol=0)


def some_rays(count, samples):
    numbers = torch.arange(count, dtype=torch.float32)
    flat = torch.arange(count * samples)
    laid = SurfaceSamples(flat, flat[:, None].expand(-1, 3).float(), flat.float())
    t = numbers[:, None].expand(-1, samples) + 0.5
    return SurfaceRays(numbers.long(), numbers[:, None].expand(-1, 3), t, numbers, numbers > 2, laid)


@pytest.mark.parametrize(("count", "at_once", "sizes"), [(10, 4, [4, 4, 2]), (4, 4, [4]), (3, 9, [3]), (0, 4, [0])])
def test_split_rays_come_together_again(count, at_once, sizes):
    rays = some_rays(count, 3)
    parts = split_rays(rays, at_once)
    assert [len(part.pixel) for part in parts] == sizes
    assert [len(part.samples.face) for part in parts] == [3 * size for size in sizes]
    for name in SurfaceRays._fields[:5]:
        assert torch.equal(torch.cat([getattr(part, name) for part in parts]), getattr(rays, name))
    for name in SurfaceSamples._fields:
        assert torch.equal(torch.cat([getattr(part.samples, name) for part in parts]), getattr(rays.samples, name))
