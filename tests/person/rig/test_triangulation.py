"""Exact points come back from exact pictures, and an outlier moves none."""

import numpy as np
import pytest
from livehand.backend.person.rig.triangulation import (
    consensus_points,
    errors_px,
    projected,
    projections,
    triangulated,
)


def test_projections_agree_with_the_cameras(made_rig):
    points = made_rig.points[0]
    px, depth = projected(projections(made_rig.cameras), points[None])
    for row, camera in enumerate(made_rig.cameras):
        wanted = camera.project(points)
        assert px[row] == pytest.approx(wanted[0], abs=1e-9)
        assert depth[row] == pytest.approx(wanted[1], abs=1e-12)


def test_exact_pictures_give_exact_points(made_rig):
    matrices, points = projections(made_rig.cameras), made_rig.points[1]
    px = projected(matrices, points[None])[0]
    assert triangulated(matrices, px, np.ones(px.shape[:2])) == pytest.approx(points, abs=1e-9)


def test_a_weight_of_zero_leaves_a_picture_out(made_rig):
    matrices, points = projections(made_rig.cameras), made_rig.points[1]
    px, weights = projected(matrices, points[None])[0], np.ones((8, 21))
    px[3, 5] += 40
    weights[3, 5] = 0
    assert triangulated(matrices, px, weights) == pytest.approx(points, abs=1e-9)


def test_consensus_is_not_moved_by_outliers(made_rig):
    matrices, points = projections(made_rig.cameras), made_rig.points[0]
    px = projected(matrices, points[None])[0]
    px[2] += 30  # a whole view
    px[5, 4] -= 25  # a landmark of another
    found, off = consensus_points(matrices, px, np.full(8, 4.0))
    assert found == pytest.approx(points, abs=1e-9)
    assert off[2] == pytest.approx(np.full(21, 30 * np.sqrt(2)))
    assert off[5, 4] == pytest.approx(25 * np.sqrt(2))
    assert errors_px(matrices, points, px) == pytest.approx(off, abs=1e-5)
