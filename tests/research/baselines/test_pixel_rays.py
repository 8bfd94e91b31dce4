"""Rays in space: which, their steps, compositing, and samples by importance."""

import pytest
import torch
from livehand.backend.field.rays import project
from livehand.backend.research.baselines.pixel_rays import (
    INFLATED_M,
    PixelRays,
    composite_steps,
    importance_samples,
    pixel_rays,
)


def straight(rays=3, near=0.4, far=0.5):
    t = torch.full((rays,), 1.0)
    return PixelRays(torch.arange(rays), torch.zeros(3), torch.eye(3)[2].expand(rays, 3), near * t, far * t, t[0])


def test_rays_enclose_the_inflated_mesh(posed, view_from):
    hand = posed("open")
    view = view_from(hand.mesh, [0, 1, 0.2])
    rays = pixel_rays(hand.mesh, hand.topology, view)
    positions_px, depth = project(view, hand.mesh.vertices)
    is_inside = ((positions_px >= 0) & (positions_px < torch.tensor(view.size_px))).all(1)  # the arm leaves the picture
    positions_px, depth = positions_px[is_inside], depth[is_inside]
    pixel = positions_px[:, 1].long() * view.size_px[0] + positions_px[:, 0].long()
    row = torch.full((view.size_px[0] * view.size_px[1],), -1).index_put((rays.pixel,), torch.arange(len(rays.pixel)))
    assert (row[pixel] >= 0).all()
    slack = 0.1 * INFLATED_M
    assert (rays.near[row[pixel]] < depth - slack).float().mean() > 0.97
    assert (rays.far[row[pixel]] > depth + slack).float().mean() > 0.97
    t = rays.stratified(5, None)
    length = rays.steps_mm(t).sum(1) / rays.directions.norm(dim=1) * rays.scale
    torch.testing.assert_close(length, 900 * (rays.far - rays.near), atol=1e-4, rtol=1e-4)


def test_steps_reach_to_the_far_end():
    rays = straight()
    t = torch.tensor([[0.4, 0.45, 0.46]]).expand(3, 3)
    torch.testing.assert_close(rays.steps_mm(t), torch.tensor([[50.0, 10.0, 40.0]]).expand(3, 3))


def test_compositing_by_hand():
    density, channels = torch.tensor([[0.0, 1.0, 2.0]]), torch.tensor([[[9.0], [1.0], [2.0]]])
    seen, alpha, weights = composite_steps(density, channels, torch.tensor([[1.0, 1.0, 0.5]]))
    first, second = 1 - torch.tensor(-1.0).exp(), torch.tensor(-1.0).exp() * (1 - torch.tensor(-1.0).exp())
    torch.testing.assert_close(weights[0], torch.stack([torch.tensor(0.0), first, second]))
    torch.testing.assert_close(seen[0, 0], first + 2 * second)
    torch.testing.assert_close(alpha[0], 1 - torch.tensor(-2.0).exp())


def test_importance_samples_follow_a_histogram():
    t = torch.tensor([[0.0, 0.1, 0.3, 0.6]])
    weights = torch.tensor([[0.1, 0.0, 0.6, 0.3]])
    at = ((torch.arange(20000) + 0.5) / 20000)[None]
    drawn = importance_samples(t, weights, torch.tensor([1.0]), at)[0]
    assert (drawn[1:] >= drawn[:-1]).all()
    counts = torch.histogram(drawn, torch.tensor([0.0, 0.1, 0.3, 0.6, 1.0])).hist / 20000
    torch.testing.assert_close(counts, weights[0], atol=1e-3, rtol=0)
    inside = drawn[(drawn > 0.3) & (drawn < 0.6)]
    assert float(inside.mean()) == pytest.approx(0.45, abs=1e-3)


def test_a_ray_without_weights_is_sampled_by_its_bins():
    drawn = importance_samples(
        torch.tensor([[0.0, 0.5]]), torch.zeros(1, 2), torch.tensor([1.0]), torch.tensor([[0.25, 0.75]])
    )
    torch.testing.assert_close(drawn, torch.tensor([[0.25, 0.75]]))
    leaf = torch.rand(2, 3, requires_grad=True)
    found = importance_samples(torch.rand(2, 3).sort(1).values, leaf, torch.ones(2), torch.full((2, 1), 0.5))
    assert not found.requires_grad
