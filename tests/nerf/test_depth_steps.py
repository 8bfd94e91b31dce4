"""Pixels that show a near part and a far one: their shares against areas, and the image that blends both."""

import numpy as np
import pytest
import torch
from livehand.backend.fast.backend import NumbaBackend
from livehand.backend.nerf.depth_steps import SPREAD, DepthSteps, blended
from livehand.backend.nerf.fine_mesh import FineMesh
from livehand.backend.nerf.rays import camera_tensors
from livehand.backend.nerf.reference import ReferenceBackend
from livehand.backend.records.camera import Camera

SIZE = (48, 40)
NEAR_M, FAR_M = 1.0, 1.5


def camera():
    """Looks along -Z from Z = 1 m, with a focal length of 100 px."""
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[2, 3] = 1
    K = np.array([[100.0, 0, SIZE[0] / 2], [0, 100, SIZE[1] / 2], [0, 0, 1]])
    return camera_tensors(Camera(K, cam2world, SIZE), "cpu")


def rectangle(left_px, right_px, top_px, bottom_px, depth_m):
    """Corners of a rectangle at these depths, m, whose sides lie there in the image."""
    depth = torch.tensor([depth_m] * 4 if isinstance(depth_m, float) else depth_m)
    x = (torch.tensor([left_px, right_px, right_px, left_px]) - SIZE[0] / 2) * depth / 100
    y = (SIZE[1] / 2 - torch.tensor([bottom_px, bottom_px, top_px, top_px])) * depth / 100
    return torch.stack([x, y, 1 - depth], 1)


def mesh_of(*rectangles):
    vertices, count = torch.cat(rectangles), len(rectangles)
    faces = torch.cat([torch.tensor([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    up = torch.tensor([0.0, 0, 1]).expand(4 * count, 3)
    return FineMesh(vertices, up, faces, torch.zeros(2 * count, 3, 2), torch.zeros(4 * count), torch.tensor(1.0))


def before_a_wall(edge_px):
    """A plate right of an edge, before a wall that fills the image."""
    wall = rectangle(-10.0, 60.0, -10.0, 50.0, FAR_M)
    return mesh_of(rectangle(edge_px, 60.0, -10.0, 50.0, NEAR_M), wall)


@pytest.mark.parametrize("edge_px", [9.0, 9.25, 9.5, 9.8])
def test_pixels_on_an_edge_show_both_parts_by_their_area(backend, edge_px):
    steps = backend.seen_surface(before_a_wall(edge_px), camera()).steps
    x, y = steps.pixel % SIZE[0], steps.pixel // SIZE[0]
    assert sorted(set(x.tolist())) == ([8, 9] if edge_px < 9.5 + 1e-6 else [9, 10])
    assert len(x) == 2 * SIZE[1]
    square = (torch.arange(SIZE[0]) + 1 - edge_px).clamp(0, 1)
    expected = SPREAD[0] * (square.roll(1) + square.roll(-1)) + SPREAD[1] * square
    torch.testing.assert_close(steps.share, expected[x], atol=0.5 / 16, rtol=0)
    assert ((steps.between_m > NEAR_M) & (steps.between_m < FAR_M)).all()
    assert y.unique().tolist() == list(range(SIZE[1]))


def test_one_part_has_no_steps_however_it_leans(backend):
    """15 mm a pixel of a surface that leans by 56 degrees; against nothing, it is alpha that tells."""
    leaning = rectangle(9.4, 30.0, 5.0, 33.0, [1.0, 1.3, 1.3, 1.0])
    assert len(backend.seen_surface(mesh_of(leaning), camera()).steps.pixel) == 0


def test_both_backends_find_the_same_steps(fine_hand, seen_from):
    mesh = fine_hand("fist", "right")
    view = seen_from(mesh, (0.2, -1, 0.4), size_px=(120, 110))
    ours, theirs = (each().seen_surface(mesh, view).steps for each in (NumbaBackend, ReferenceBackend))
    assert torch.equal(ours.pixel, theirs.pixel)
    assert len(ours.pixel) > 100
    torch.testing.assert_close(ours.between_m, theirs.between_m, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(ours.share, theirs.share, atol=0.14, rtol=0)  # a sample or two on an edge
    assert (ours.share - theirs.share).abs().mean() < 2e-3
    assert ours.share.min() >= 0
    assert ours.share.max() <= 1 + 1e-6


def plain_image(edge_column):
    """A red part right of a column, before a green one."""
    is_near = (torch.arange(SIZE[0]) >= edge_column).expand(SIZE[1], SIZE[0])
    depth = torch.where(is_near, NEAR_M, FAR_M)
    return torch.stack([is_near.float(), 1 - is_near.float(), torch.zeros(is_near.shape)]), depth


def test_the_image_blends_both_parts_and_leaves_the_rest():
    colours, depth = plain_image(10)
    steps = DepthSteps(
        torch.tensor([5 * SIZE[0] + 9, 6 * SIZE[0] + 10]), torch.tensor([1.2, 1.2]), torch.tensor([0.3, 0.8])
    )
    found = blended(colours, torch.ones(SIZE[1], SIZE[0]), depth, steps)
    torch.testing.assert_close(found[:, 5, 9], torch.tensor([0.3, 0.7, 0]))
    torch.testing.assert_close(found[:, 6, 10], torch.tensor([0.8, 0.2, 0]))
    found[:, 5, 9], found[:, 6, 10] = colours[:, 5, 9], colours[:, 6, 10]
    assert torch.equal(found, colours)


def test_partly_covered_pixels_stay_as_opaque_as_they_are():
    colours, depth = plain_image(10)
    alpha = torch.full((SIZE[1], SIZE[0]), 0.5)
    steps = DepthSteps(torch.tensor([5 * SIZE[0] + 9]), torch.tensor([1.2]), torch.tensor([0.3]))
    found = blended(0.5 * colours, alpha, depth, steps)
    torch.testing.assert_close(found[:, 5, 9], torch.tensor([0.15, 0.35, 0]))


def test_a_pixel_that_sees_one_part_only_keeps_its_colour():
    """Its neighbours of the other part are hardly opaque."""
    colours, depth = plain_image(10)
    alpha = torch.where(depth == NEAR_M, 1.0, 0.01)
    steps = DepthSteps(torch.tensor([5 * SIZE[0] + 10]), torch.tensor([1.2]), torch.tensor([0.3]))
    assert torch.equal(blended(colours, alpha, depth, steps), colours)
