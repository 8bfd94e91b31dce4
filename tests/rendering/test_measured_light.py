"""Measured light at the rays of a crop."""

import numpy as np
import torch
from livehand.backend.nerf.crop import Crop
from livehand.backend.nerf.lighting import SurfacePoints
from livehand.backend.records.light import MeasuredLight
from livehand.backend.rendering.measured_light import measured_at, without_noise

SIZE = (40, 24)
CROP = Crop(4, 2, 12, 8)


def ramp(width, height, alpha=None):
    """Light that rises by 1 from the left border to the right, and by 2 from the top to the bottom."""
    x, y = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    direct = np.stack([np.tile(x, (height, 1)), np.tile(2 * y[:, None], (1, width)), np.ones((height, width))], -1)
    return MeasuredLight(direct, 3 * direct, np.ones((height, width)) if alpha is None else alpha)


def test_any_resolution_gives_the_light_at_the_rays_place():
    pixel = torch.arange(CROP.width * CROP.height)
    x = (pixel % 12 + 4 + 0.5) / 20
    y = (pixel // 12 + 2 + 0.5) / 12
    expected = torch.stack([x, 2 * y, torch.ones(96)], -1)
    for size in (SIZE, (20, 12), (80, 48)):
        direct, indirect = measured_at(ramp(*size), CROP, pixel, SIZE)
        torch.testing.assert_close(direct, expected, atol=1e-5, rtol=0)
        torch.testing.assert_close(indirect, 3 * expected, atol=1e-5, rtol=0)


def test_pixels_beside_the_hand_do_not_count():
    alpha = np.zeros((12, 20))
    alpha[:, :10] = 1
    light = ramp(20, 12, alpha)
    light.direct[:, 10:] = 1e6
    direct, _ = measured_at(light, CROP, torch.tensor([5]), SIZE)  # its 3 x 3 pixels reach over the edge
    assert direct.max() < 2


def test_rays_beside_the_mesh_have_the_light_of_the_hand_near_them():
    """They pass through the shell, where the bare mesh was not seen: they are not dark."""
    alpha = np.zeros((12, 20))
    alpha[:, :5] = 1
    light = ramp(20, 12, alpha)
    light.direct[:, :5] = 0.5
    light.direct[:, 5:] = 0
    for column in range(12):  # 4 to 15 of the image: next to the hand, and far from it
        direct, _ = measured_at(light, CROP, torch.tensor([5 * 12 + column]), SIZE)
        torch.testing.assert_close(direct, torch.full((1, 3), 0.5))


def plane_points(width, height, step_m=0.0005, behind_from=None):
    """Points of a slanted plane, row by row; from a column on they lie 20 mm behind it."""
    x, y = torch.meshgrid(torch.arange(width) * step_m, torch.arange(height) * step_m, indexing="xy")
    normal = torch.tensor([-0.6, 0.0, 0.8])
    z = 0.75 * x
    if behind_from is not None:
        z = z - 0.02 * (x >= behind_from * step_m)
    position = torch.stack([x, y, z], -1).reshape(-1, 3)
    normals = normal.expand(len(position), 3)
    return SurfacePoints(position, normals, normals, normals)


def test_noise_is_averaged_away_on_a_slanted_surface():
    width, height = 40, 30
    noise = torch.randn(width * height, 3, generator=torch.Generator().manual_seed(1))
    pixel, scale = torch.arange(width * height), torch.tensor(1.0)
    found = without_noise(1 + 0.1 * noise, plane_points(width, height), pixel, (width, height), scale)
    assert found.std() < 0.02
    assert abs(found.mean() - 1) < 0.01


def test_light_does_not_cross_to_another_surface_nor_come_from_beside_the_hand():
    width, height = 24, 20
    pixel, scale = torch.arange(width * height), torch.tensor(1.0)
    is_behind = (pixel % width >= 12).float()[:, None]
    points = plane_points(width, height, behind_from=12)
    found = without_noise(is_behind.expand(-1, 3), points, pixel, (width, height), scale)
    torch.testing.assert_close(found, is_behind.expand(-1, 3), atol=1e-6, rtol=0)
    some = pixel[pixel % 7 != 0]  # holes
    kept = SurfacePoints(*(values[some] for values in points))
    even = without_noise(torch.ones(len(some), 3), kept, some, (width, height), scale)
    torch.testing.assert_close(even, torch.ones(len(some), 3))


def test_a_ray_whose_normal_vanishes_keeps_its_light():
    points = plane_points(3, 3)
    none = SurfacePoints(points.position, *[torch.zeros(9, 3)] * 3)
    values = torch.arange(27.0).reshape(9, 3)
    torch.testing.assert_close(without_noise(values, none, torch.arange(9), (3, 3), torch.tensor(1.0)), values)
