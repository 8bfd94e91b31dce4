"""Pixels that show a near part and a far one: their shares against areas, and the image that blends both."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import camera_tensors
from livehand.backend.records.camera import Camera
from livehand.backend.surface.detail_mesh import DetailMesh
from livehand.backend.surface.edge_antialiasing import SPREAD, EdgePixels, SurfaceBones

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


# Three bones in a row, and a fourth from the first.
CHAIN = (-1, 0, 1, 0)


def mesh_of(*rectangles, bones=None):
    """A mesh of rectangles, each of which follows a bone of `CHAIN`, by default the first."""
    vertices, count = torch.cat(rectangles), len(rectangles)
    faces = torch.cat([torch.tensor([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    up = torch.tensor([0.0, 0, 1]).expand(4 * count, 3)
    weights = torch.eye(len(CHAIN))[torch.tensor(bones or [0] * count).repeat_interleave(4)]
    of_faces = SurfaceBones.of(weights, faces, CHAIN)
    corner_uv, flex = torch.zeros(2 * count, 3, 2), torch.zeros(4 * count)
    return DetailMesh(vertices, up, faces, corner_uv, flex, torch.tensor(1.0), of_faces, faces)


def before_a_wall(edge_px):
    """A plate right of an edge, before a wall that fills the image."""
    wall = rectangle(-10.0, 60.0, -10.0, 50.0, FAR_M)
    return mesh_of(rectangle(edge_px, 60.0, -10.0, 50.0, NEAR_M), wall)


@pytest.mark.parametrize("edge_px", [9.0, 9.25, 9.5, 9.8])
def test_pixels_on_an_edge_show_both_parts_by_their_area(backend, edge_px):
    edges = backend.visible_surface(before_a_wall(edge_px), camera()).edges
    x, y = edges.pixel % SIZE[0], edges.pixel // SIZE[0]
    assert sorted(set(x.tolist())) == ([8, 9] if edge_px < 9.5 + 1e-6 else [9, 10])
    assert len(x) == 2 * SIZE[1]
    square = (torch.arange(SIZE[0]) + 1 - edge_px).clamp(0, 1)
    expected = SPREAD[0] * (square.roll(1) + square.roll(-1)) + SPREAD[1] * square
    torch.testing.assert_close(edges.share, expected[x], atol=0.5 / 16, rtol=0)
    around = torch.arange(-1, 2).repeat(3)[:, None] + x
    assert torch.equal(edges.shows_first, around + 0.5 >= edge_px)
    assert y.unique().tolist() == list(range(SIZE[1]))


def test_one_part_has_no_steps_however_it_leans(backend):
    """15 mm a pixel of a surface that leans by 56 degrees; against nothing, it is alpha that tells."""
    leaning = rectangle(9.4, 30.0, 5.0, 33.0, [1.0, 1.3, 1.3, 1.0])
    assert len(backend.visible_surface(mesh_of(leaning), camera()).edges.pixel) == 0


@pytest.mark.parametrize("bones", [(2, 0), (0, 2), (3, 1), (1, 2), (2, 2)])
def test_parts_that_touch_have_an_edge_unless_one_bone_goes_on_in_the_other(backend, bones):
    """Two halves of a plane, which depth does not tell apart; the lower bone's is the first part."""
    left, right = (rectangle(*sides, -10.0, 50.0, NEAR_M) for sides in ((-10.0, 9.3), (9.3, 60.0)))
    edges = backend.visible_surface(mesh_of(left, right, bones=bones), camera()).edges
    if bones in ((1, 2), (2, 2)):
        assert len(edges.pixel) == 0
        return
    x = edges.pixel % SIZE[0]
    assert sorted(set(x.tolist())) == [8, 9]
    square = (9.3 - torch.arange(SIZE[0])).clamp(0, 1)
    of_left = SPREAD[0] * (square.roll(1) + square.roll(-1)) + SPREAD[1] * square
    expected = of_left if bones[0] < bones[1] else 1 - of_left
    torch.testing.assert_close(edges.share, expected[x], atol=0.5 / 16, rtol=0)
    is_left = torch.arange(-1, 2).repeat(3)[:, None] + x < 9
    assert torch.equal(edges.shows_first, is_left if bones[0] < bones[1] else ~is_left)


def test_an_edge_of_depth_goes_on_where_its_parts_touch(backend):
    """A wall that leans against a plate: along the edge their shares do not jump, whatever tells them apart."""
    wall = rectangle(-10.0, 9.3, -10.0, 50.0, [1.8, 1.8, 1.0, 1.0])
    mesh = mesh_of(wall, rectangle(9.3, 60.0, -10.0, 50.0, NEAR_M), bones=(0, 2))
    edges = backend.visible_surface(mesh, camera()).edges
    column = edges.pixel % SIZE[0] == 9
    share_of_plate = torch.where(edges.shows_first[4], edges.share, 1 - edges.share)[column]
    assert len(share_of_plate) == SIZE[1]
    torch.testing.assert_close(share_of_plate, torch.full_like(share_of_plate, 0.7), atol=0.06, rtol=0)


def places_around(pixel, size_px):
    """[9, K] the pixels around each and itself, inside the image."""
    width, height = size_px
    steps = torch.arange(-1, 2)
    x = (pixel % width + steps.repeat(3)[:, None]).clamp(0, width - 1)
    y = (pixel // width + steps.repeat_interleave(3)[:, None]).clamp(0, height - 1)
    return y * width + x


def test_both_backends_find_the_same_edges(backend_pair, fine_hand, view_from):
    mesh = fine_hand("fist", "right")
    view = view_from(mesh, (0.2, -1, 0.4), size_px=(120, 110))
    seen = [each.visible_surface(mesh, view) for each in backend_pair]
    ours, theirs = (each.edges for each in seen)
    assert torch.equal(ours.pixel, theirs.pixel)
    assert len(ours.pixel) > 100
    is_skin = seen[0].face[places_around(ours.pixel, (120, 110))] >= 0  # beside the surface they tell nothing
    assert torch.equal(ours.shows_first & is_skin, theirs.shows_first & is_skin)
    by_bones = ours.shows_first.any(0) & ~ours.shows_first.all(0)
    assert by_bones.sum() > 100
    torch.testing.assert_close(ours.share, theirs.share, atol=0.14, rtol=0)  # a sample or two on an edge
    assert (ours.share - theirs.share).abs().mean() < 2e-3
    assert ours.share.min() >= 0
    assert ours.share.max() <= 1 + 1e-6


def plain_image(edge_column):
    """A red part right of a column, before a green one."""
    is_near = (torch.arange(SIZE[0]) >= edge_column).expand(SIZE[1], SIZE[0])
    depth = torch.where(is_near, NEAR_M, FAR_M)
    return torch.stack([is_near.float(), 1 - is_near.float(), torch.zeros(is_near.shape)]), depth


def edges_at(hit_points, share):
    """Pixels (x, y) of the plain image with an edge at column 10, and the near part's share in them."""
    x, y = torch.tensor(hit_points).T
    return EdgePixels(y * SIZE[0] + x, torch.arange(-1, 2).repeat(3)[:, None] + x >= 10, torch.tensor(share))


def test_the_image_blends_both_parts_and_leaves_the_rest(backend):
    colours, depth = plain_image(10)
    edges = edges_at([(9, 5), (10, 6)], [0.3, 0.8])
    found = backend.blended(colours, torch.ones(SIZE[1], SIZE[0]), depth, edges)
    torch.testing.assert_close(found[:, 5, 9], torch.tensor([0.3, 0.7, 0]))
    torch.testing.assert_close(found[:, 6, 10], torch.tensor([0.8, 0.2, 0]))
    found[:, 5, 9], found[:, 6, 10] = colours[:, 5, 9], colours[:, 6, 10]
    assert torch.equal(found, colours)


def test_partly_covered_pixels_stay_as_opaque_as_they_are(backend):
    colours, depth = plain_image(10)
    alpha = torch.full((SIZE[1], SIZE[0]), 0.5)
    found = backend.blended(0.5 * colours, alpha, depth, edges_at([(9, 5)], [0.3]))
    torch.testing.assert_close(found[:, 5, 9], torch.tensor([0.15, 0.35, 0]))


def test_a_pixel_that_sees_one_part_only_keeps_its_colour(backend):
    """Its neighbours of the other part are hardly opaque."""
    colours, depth = plain_image(10)
    alpha = torch.where(depth == NEAR_M, 1.0, 0.01)
    assert torch.equal(backend.blended(colours, alpha, depth, edges_at([(10, 5)], [0.3])), colours)


def test_both_backends_blend_any_image_alike(backend_pair):
    """Holes, pixels at its corners, and pixels that show one part only among them."""
    generator = torch.Generator().manual_seed(4)
    alpha = torch.rand(SIZE[1], SIZE[0], generator=generator) * 1.2
    depth = torch.where(torch.rand(alpha.shape, generator=generator) < 0.2, torch.inf, 1.0)
    colours = torch.rand(3, *alpha.shape, generator=generator) * alpha
    pixel = torch.randperm(alpha.numel(), generator=generator)[:300].sort().values
    pixel = torch.cat([torch.tensor([0, SIZE[0] - 1, alpha.numel() - 1]), pixel]).unique()
    shows_first = torch.rand(9, len(pixel), generator=generator) < torch.rand(len(pixel), generator=generator)
    edges = EdgePixels(pixel, shows_first, torch.rand(len(pixel), generator=generator))
    ours, theirs = (backend.blended(colours, alpha, depth, edges) for backend in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-6, rtol=1e-5)
    changed = (theirs != colours).any(0).flatten()
    assert 200 < changed.sum() < len(pixel)
    assert not changed[torch.ones_like(changed).index_fill(0, pixel, False)].any()
