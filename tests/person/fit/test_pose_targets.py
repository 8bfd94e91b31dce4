"""A hand's outline in the model's picture is matched to the mask's, where the mask is sure."""

import numpy as np
import pytest
from livehand.backend.person.fit.pose_targets import outline_targets
from livehand.backend.person.lit_model.model import GeometryMaps
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN

MIDDLE_PX, RADIUS_PX = 50.0, 30.0
INSIDE_PX = 1.5


@pytest.fixture
def shown():
    """A disc in the model's picture, 4 px left of the mask's, and points along its rim as if they were vertices."""
    disc = _disc(MIDDLE_PX - 4)
    maps = GeometryMaps(None, disc, np.zeros((100, 100, 2)), disc.astype(float), np.where(disc, 0.5, np.inf))
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    rim_px = RADIUS_PX * np.stack([np.cos(angle), np.sin(angle)], 1) + (MIDDLE_PX - 4, MIDDLE_PX)
    return maps, rim_px


def _disc(column_px):
    rows, columns = np.mgrid[:100, :100] + 0.5
    return (rows - MIDDLE_PX) ** 2 + (columns - column_px) ** 2 < RADIUS_PX**2


def test_vertices_of_the_outline_go_to_the_masks(shown):
    maps, rim_px = shown
    targets = outline_targets(maps, np.where(_disc(MIDDLE_PX), HAND, BACKGROUND).astype(np.uint8), rim_px)
    assert len(targets.vertex) > 300
    assert np.median(np.linalg.norm(targets.px - MIDDLE_PX, axis=1)) == pytest.approx(RADIUS_PX, abs=0.15)
    inward = (MIDDLE_PX - targets.px) / RADIUS_PX
    assert (targets.normal * inward).sum(1).min() > 0.9


def test_vertices_inside_the_outline_stay_as_far_inside(shown):
    maps, rim_px = shown
    middle_px = np.array([MIDDLE_PX - 4, MIDDLE_PX])
    inner_px = middle_px + (rim_px - middle_px) * (1 - INSIDE_PX / RADIUS_PX)
    targets = outline_targets(maps, np.where(_disc(MIDDLE_PX), HAND, BACKGROUND).astype(np.uint8), inner_px)
    away_px = np.linalg.norm(targets.px - MIDDLE_PX, axis=1)
    assert np.median(away_px) == pytest.approx(
        RADIUS_PX - INSIDE_PX, abs=0.4
    )  # the nearest rim of whole pixels lies inside


def test_the_outline_beside_what_is_unknown_is_no_target(shown):
    maps, rim_px = shown
    labels = np.where(_disc(MIDDLE_PX), HAND, BACKGROUND).astype(np.uint8)
    labels[:, 60:] = UNKNOWN
    targets = outline_targets(maps, labels, rim_px)
    assert len(targets.vertex) > 150
    assert targets.px[:, 0].max() < 56.5
    assert not len(outline_targets(maps, np.full_like(labels, UNKNOWN), rim_px).vertex)
