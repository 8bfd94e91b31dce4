"""Training views: crops, kept rays, and jitters."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import HandInView
from livehand.backend.training.views import TrainingViews, _packed, _unpacked


def test_a_view_is_the_image_in_its_crop(painted_capture, views):
    view = views.get(1, 0)
    image = painted_capture.read_image(views.views[1])
    height, width = view.is_inside.shape
    assert (view.camera.size_px[0] * 2, view.camera.size_px[1] * 2) == (width, height)
    assert int(view.is_inside.sum()) > 0
    inside = view.target[:, view.is_inside]
    assert view.target[:, ~view.is_inside].abs().max() == 0
    assert inside[3].sum() == pytest.approx(image[..., 3].sum(), rel=1e-3)  # the whole hand is in the crop
    torch.testing.assert_close(inside[:3].sum(1), torch.as_tensor(image[..., :3].sum((0, 1))), rtol=1e-3, atol=1e-2)


def test_kept_rays_equal_traced_ones_to_a_few_micrometres(views, small):
    view = views.get(0, 1)
    generator = torch.Generator().manual_seed(hash((0, 0, 1)) % 2**63)
    traced = views.backend.trace(HandInView(view.mesh, views.topology, view.camera), small.sampler, generator)
    for name in ("pixel", "directions", "t", "dt"):
        torch.testing.assert_close(getattr(view.rays, name), getattr(traced, name))
    assert torch.equal(view.rays.samples.face, traced.samples.face)
    assert (view.rays.samples.height_m - traced.samples.height_m).abs().max() < 3e-6
    corners = view.mesh.vertices[views.topology.faces[traced.samples.face]]
    moved = (view.rays.samples.barycentric - traced.samples.barycentric)[:, :, None] * corners
    assert moved.sum(1).norm(dim=-1).max() < 5e-6
    torch.testing.assert_close(view.rays.samples.barycentric.sum(1), torch.ones(len(corners)))


@pytest.mark.parametrize("face", [0, 2**15 - 1, 2**15, 10**6])
def test_face_indices_of_dense_hands_are_kept(views, face):
    view = views.get(0, 0)
    samples = view.rays.samples
    dense = view.rays._replace(samples=samples._replace(face=torch.full_like(samples.face, face)))
    assert (_unpacked(_packed(dense), view.camera).samples.face == face).all()


def test_jitter_sets_differ_and_are_repeatable(views):
    one, again, other = views.get(2, 0), views.get(2, 0), views.get(2, 1)
    assert torch.equal(one.rays.t, again.rays.t)
    assert not torch.equal(one.rays.t, other.rays.t)


def test_views_without_the_hand_are_left_out(painted_capture, hand, small):
    view = painted_capture.views[0]
    away = replace(view, camera=replace(view.camera, cam2world=view.camera.cam2world @ np.diag([1.0, -1, -1, 1])))
    views = TrainingViews(painted_capture, (view, away), hand, small.sampler, torch.device("cpu"), 0)
    assert len(views) == 1
