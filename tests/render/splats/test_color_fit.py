"""The fit of colours finds those that pictures were made of."""

import numpy as np
import pytest
from livehand.backend.geometry.framing import fitting_camera
from livehand.backend.geometry.rotation import axis_angle_to_quaternion
from livehand.backend.render.splats.color_fit import ColorFit
from livehand.backend.render.splats.gaussians import Splats
from livehand.backend.render.splats.lit_views import LitView, directions
from livehand.backend.render.splats.sequence import psnr_db
from livehand.backend.render.splats.splat_raster import rasterised

pytestmark = pytest.mark.slow

COUNT = 200


@pytest.fixture(scope="module")
def truth():
    rng = np.random.default_rng(1)
    positions = 0.1 * directions(COUNT)
    harmonics = np.zeros((COUNT, 16, 3))
    harmonics[:, 0] = rng.normal(size=(COUNT, 3))
    harmonics[:, 1:9] = 0.1 * rng.normal(size=(COUNT, 8, 3))
    turns = axis_angle_to_quaternion(rng.normal(size=(COUNT, 3)))
    return Splats(
        positions, turns, np.full((COUNT, 3), 0.008), np.full(COUNT, 0.9), harmonics, positions, np.zeros((COUNT, 3))
    )


def views_of(truth, towards):
    for direction in towards:
        camera = fitting_camera(truth.positions, tuple(direction), (56, 56), 0.9)
        yield LitView(camera, rasterised(truth, camera))


def grey(truth):
    return Splats(**{**vars(truth), "harmonics": np.zeros((COUNT, 1, 3))})


def with_colors(truth, harmonics):
    return Splats(**{**vars(truth), "harmonics": harmonics})


def test_views_that_were_not_fitted_are_shown_as_they_are(truth):
    fit = ColorFit(grey(truth))
    for view in views_of(truth, directions(64)):
        fit.add(view)
    found = with_colors(truth, fit.solved(iterations=12))
    means = with_colors(truth, fit.solved(iterations=0))
    held_out = list(views_of(truth, directions(5, 1.0)))
    fitted_db = [psnr_db(found, view) for view in held_out]
    assert min(fitted_db) > 32
    assert np.mean(fitted_db) > np.mean([psnr_db(means, view) for view in held_out]) + 6


def test_a_fit_goes_on_from_the_last_frame(truth):
    fit = ColorFit(grey(truth))
    for view in views_of(truth, directions(24)):
        fit.add(view)
    far = fit.solved(iterations=14)
    once_more = fit.solved(start=far, iterations=1)
    from_means = fit.solved(iterations=1)
    assert np.abs(once_more - far).max() < 0.2 * np.abs(from_means - far).max()
