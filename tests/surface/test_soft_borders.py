"""Colours beside charts' borders: a step becomes a slope in a close view, and stays in one from afar."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import camera_tensors
from livehand.backend.field.volume import Composite
from livehand.backend.light.indirect_diffuse import MeshPoints
from livehand.backend.records.camera import Camera
from livehand.backend.surface.ray_hits import RayHits
from livehand.backend.surface.soft_borders import REACH_M, SoftBorders

SIZE = 60, 20
COUNT, MIDDLE, DEPTH_M = SIZE[0] * SIZE[1], 30, 0.1
EDGE_M = torch.tensor(0.003)
REACH_PX = 10


def softened(low, focal_px=REACH_PX * DEPTH_M / REACH_M, depth=None, pixel=None):
    """Two faces that share the border x = `MIDDLE`, each as wide as half of the picture."""
    pixel = torch.arange(COUNT) if pixel is None else pixel
    x = (pixel % SIZE[0]).float() + 0.5
    nearness = 1 - (x - MIDDLE).abs() / MIDDLE
    points = MeshPoints(
        torch.tensor([[0, 1, 2]]).expand(len(pixel), 3), torch.stack([nearness, 1 - nearness, 0 * x], 1)
    )
    camera = camera_tensors(Camera(np.diag([focal_px, focal_px, 1.0]), np.eye(4), SIZE), "cpu")
    depth = torch.full((len(pixel),), DEPTH_M) if depth is None else depth
    borders = SoftBorders(torch.tensor([1.0, 0, 0]))
    return borders.softened(low, pixel, camera, points, RayHits(depth, torch.zeros(len(pixel), 3)), EDGE_M)


@pytest.fixture
def step():
    x = torch.arange(COUNT) % SIZE[0]
    channels = torch.stack([(x >= MIDDLE).float(), torch.ones(COUNT)], 1)
    return Composite(channels, torch.ones(COUNT), torch.zeros(COUNT), torch.zeros(COUNT, 3))


def test_vertices_with_several_places_in_the_atlas_are_on_borders():
    corner_uv = np.array([[[0, 0], [0.2, 0], [0, 0.2]], [[0.5, 0.5], [0.7, 0.5], [0.5, 0.7]]])
    borders = SoftBorders.of(np.array([[0, 1, 2], [2, 1, 3]]), corner_uv)
    assert borders.nearness.tolist() == [0, 1, 1, 0]


def test_a_step_becomes_a_slope_as_wide_as_the_reach(step):
    row = softened(step).channels.reshape(SIZE[1], SIZE[0], 2)[SIZE[1] // 2]
    assert row[:, 1].allclose(torch.ones(SIZE[0]))
    assert (row[1:, 0] - row[:-1, 0]).abs().max() < 0.2
    assert row[MIDDLE - 1 : MIDDLE + 1, 0].mean() == pytest.approx(0.5, abs=0.01)
    beyond = REACH_PX + 2
    assert row[: MIDDLE - beyond, 0].abs().max() == 0
    assert row[MIDDLE + beyond :, 0].min() == 1


def test_from_afar_nothing_changes(step):
    assert softened(step, focal_px=DEPTH_M / REACH_M) is step


def test_what_is_even_stays_so_at_holes_and_ends(step):
    even = step._replace(channels=torch.full((COUNT, 2), 0.3))
    assert softened(even).channels.allclose(even.channels)
    pixel = torch.arange(COUNT)[torch.arange(COUNT) % 7 > 0]
    some = Composite(*(values[pixel] for values in even))
    some.channels[0] = 9.0  # far from the border
    found = softened(some, pixel=pixel)
    assert found.channels.allclose(some.channels)
    assert found.alpha.allclose(some.alpha)


def test_other_parts_of_the_hand_and_misses_lend_no_colour(step):
    x = torch.arange(COUNT) % SIZE[0]
    far = torch.where(x >= MIDDLE, DEPTH_M + 0.03, DEPTH_M)
    assert softened(step, depth=far).channels.allclose(step.channels, atol=1e-6)
    missed = torch.where(x >= MIDDLE, torch.inf, DEPTH_M)
    assert softened(step, depth=missed).channels.equal(step.channels)
