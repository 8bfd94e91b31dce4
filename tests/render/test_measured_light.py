"""Measured light at the rays of a crop."""

import numpy as np
import torch
from livehand.backend.image.crop import Crop
from livehand.backend.image.edge_avoiding_filter import OFF_PLANE_M, RaySurfacePoints
from livehand.backend.records.light import MeasuredLight
from livehand.backend.render.measured_light import AtRays, measured_at, without_noise

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


def test_pixels_that_the_hand_hardly_covers_are_not_asked():
    """A few samples that miss the lamp say nothing: such rays were black specks on outlines."""
    alpha = np.zeros((12, 20))
    alpha[:, :5] = 1
    alpha[:, 5] = 0.06
    light = ramp(20, 12, alpha)
    light.direct[:, :5] = 0.5
    light.direct[:, 5:] = 0
    for column in range(4):
        direct, _ = measured_at(light, CROP, torch.tensor([5 * 12 + column]), SIZE)
        torch.testing.assert_close(direct, torch.full((1, 3), 0.5), atol=0.04, rtol=0)


def test_rays_where_another_surface_was_measured_have_the_light_beside_them_on_their_surface():
    width, height = 40, 30
    x, y = torch.meshgrid(torch.arange(width), torch.arange(height), indexing="xy")
    x, y = x.flatten(), y.flatten()
    is_finger = x < 20
    position = torch.stack([x * 0.0005, y * 0.0005, torch.where(is_finger, 0.0, 0.1)], -1).float()
    normal = torch.tensor([0.0, 0.0, 1.0]).expand(len(x), 3)
    hit_points = RaySurfacePoints(position, normal, torch.arange(len(x)), (width, height), OFF_PLANE_M)
    shows = (x < 16) | (x == 19) & (y == 5) | (x >= 30)
    light = torch.where(is_finger, 1.0, 0.2)
    measured = torch.where(shows, light, 50.0)[:, None].expand(-1, 3)
    found = AtRays(shows, hit_points).filled(measured)
    near = x < 27  # farther than the passes reach, and nothing is known
    torch.testing.assert_close(found[near & is_finger], light[near & is_finger, None].expand(-1, 3))
    torch.testing.assert_close(found[shows], measured[shows])
    assert (found[(x >= 20) & (x < 23)] == 50).all()
    torch.testing.assert_close(found[(x >= 24) & (x < 30)], torch.full((180, 3), 0.2))


def test_noise_is_averaged_away_on_a_slanted_surface():
    width, height = 40, 30
    x, y = torch.meshgrid(torch.arange(width) * 0.0005, torch.arange(height) * 0.0005, indexing="xy")
    position, normal = torch.stack([x, y, 0.75 * x], -1).reshape(-1, 3), torch.tensor([-0.6, 0.0, 0.8])
    pixel = torch.arange(width * height)
    hit_points = RaySurfacePoints(position, normal.expand(len(pixel), 3), pixel, (width, height), OFF_PLANE_M)
    noise = torch.randn(width * height, 3, generator=torch.Generator().manual_seed(1))
    found = without_noise(1 + 0.1 * noise, hit_points)
    assert found.std() < 0.02
    assert abs(found.mean() - 1) < 0.01
