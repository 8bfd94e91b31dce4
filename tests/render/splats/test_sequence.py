"""Splats of a hand against frames of it that they were not fitted to."""

import numpy as np
import pytest
import torch
from livehand import api
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.origin import read_origin
from livehand.backend.image.grade import Grade
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import Shot
from livehand.backend.render.progress import RenderStopped
from livehand.backend.render.splats.flat_splats import SplatGround
from livehand.backend.render.splats.lit_hand import LitHand, SplatOptions
from livehand.backend.render.splats.sequence import SplatFitter
from scipy.spatial import KDTree

pytestmark = pytest.mark.slow

SMALL = SplatOptions(count=3000, views=12, size_px=128)


def lit_hand(skin, pose, grade=None):
    person = api.load_person(skin)
    posed = api.named_pose(pose)
    shot = Shot(posed, person.vertices(posed), person.camera(posed), api.studio_light())
    return LitHand(person._renderer, shot, read_origin(shipped_avatar_path(skin)), grade or Grade(), "hand")


@pytest.fixture(scope="module")
def relaxed():
    return lit_hand("light", "Relaxed")


def test_splats_lie_flat_below_the_surface(relaxed):
    splats = SplatGround(relaxed.renderer, relaxed.shot, 3000).flat_splats(relaxed.shot, np.eye(3))
    surface = relaxed.renderer.posed_surface(relaxed.shot)
    distance, nearest = KDTree(surface.vertices).query(splats.positions)
    assert distance.max() < 0.004
    inward = ((surface.vertices[nearest] - splats.positions) * splats.normals).sum(1)
    assert (inward > 0).mean() > 0.97
    assert (splats.scales[:, 2] < 0.2 * splats.scales[:, 0]).all()
    assert splats.albedo.min() > 0.02
    red, green, blue = splats.albedo.mean(0)
    assert red > green > blue


@pytest.mark.nightly
def test_few_splats_show_frames_from_between(relaxed):
    told = []
    fitted = SplatFitter(SMALL, np.eye(3)).fitted(relaxed, told.append)
    assert fitted.held_out_db.mean() > 25
    shares = [one.share for one in told]
    assert shares == sorted(shares)


@pytest.mark.nightly
def test_a_grade_is_in_the_colors(relaxed):
    dark = relaxed._replace(grade=Grade(exposure_stops=-3.0))
    bright, dim = (SplatFitter(SMALL, np.eye(3)).fitted(one).splats for one in (relaxed, dark))
    assert dim.harmonics[:, 0].mean() < bright.harmonics[:, 0].mean() - 0.5


def test_a_fit_can_be_stopped(relaxed):
    with pytest.raises(RenderStopped):
        SplatFitter(SMALL, np.eye(3), lambda: True).fitted(relaxed)


@pytest.mark.parametrize("wrong", [{"count": 10}, {"views": 4}, {"size_px": 9000}])
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(LiveHandError, match="must lie in"):
        SplatOptions(**wrong)


@pytest.mark.nightly
@pytest.mark.parametrize(("skin", "pose"), [("light", "Relaxed"), ("deep", "Open")])
def test_splats_at_their_fitted_pose_are_as_frames_are(skin, pose):
    with torch.inference_mode():
        found_db = SplatFitter(SplatOptions(), np.eye(3)).fitted(lit_hand(skin, pose)).held_out_db
    assert found_db.mean() >= 30, found_db
