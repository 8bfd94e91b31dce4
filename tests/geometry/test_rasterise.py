"""The rasteriser against a slow one pixel at a time, and what holds of every closed surface."""

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.geometry.rasterise import NEAR_M, nearest_fronts, rasterise
from livehand.backend.records.camera import Camera, look_at

pytestmark = pytest.mark.slow

SIZE = (23, 17)


def seen(mesh, camera):
    """Fragments of a mesh, in double precision."""
    positions_px, depth = camera.project(np.asarray(mesh.vertices, np.float64))
    faces = torch.as_tensor(np.asarray(mesh.faces))
    return rasterise(torch.as_tensor(positions_px), torch.as_tensor(depth), faces, camera.size_px)


def a_camera(size_px=SIZE, focal_px=19.37, origin=(1.07, -2.03, 0.81)):
    K = np.array([[focal_px, 0, size_px[0] / 2 + 0.21], [0, focal_px * 1.1, size_px[1] / 2 - 0.13], [0, 0, 1]])
    return Camera(K, look_at(np.array(origin), np.array([0.03, 0.02, -0.01]), np.array([0, 0, 1.0])), size_px)


def reference(mesh, camera):
    """{(pixel, face): (depth along the axis, front)}: rays through pixel centres against every triangle, in 3-D."""
    found = {}
    a, b, c = np.moveaxis(np.asarray(mesh.vertices[mesh.faces]), 1, 0)
    normal = np.cross(b - a, c - a)
    for row in range(camera.size_px[1]):
        for column in range(camera.size_px[0]):
            direction = camera.ray_directions(np.array([column + 0.5, row + 0.5]))
            depth = ((a - camera.origin) * normal).sum(1) / (normal @ direction)
            hit = camera.origin + depth[:, None] * direction
            sides = [(np.cross(q - p, hit - p) * normal).sum(1) for p, q in ((a, b), (b, c), (c, a))]
            for face in np.flatnonzero((np.min(sides, 0) >= 0) & (depth > 0)):
                found[row * camera.size_px[0] + column, int(face)] = depth[face], normal[face] @ direction < 0
    return found


def as_dict(fragments):
    keys = zip(fragments.pixel.tolist(), fragments.face.tolist(), strict=True)
    values = zip(fragments.depth.tolist(), fragments.is_front.tolist(), strict=True)
    return dict(zip(keys, values, strict=True))


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(1), trimesh.creation.box((1.3, 0.7, 0.9))])
def test_against_a_ray_for_every_pixel_and_face(mesh):
    camera = a_camera()
    ours, expected = as_dict(seen(mesh, camera)), reference(mesh, camera)
    assert len(expected) > 60
    assert ours.keys() == expected.keys()
    for key, (depth, is_front) in expected.items():
        assert ours[key][0] == pytest.approx(depth, rel=1e-12)  # straight in 1/z, so exact in perspective
        assert ours[key][1] == is_front


def test_every_ray_through_a_closed_surface_goes_in_as_often_as_out():
    mesh = trimesh.util.concatenate(
        trimesh.creation.icosphere(3), trimesh.creation.icosphere(2, 0.6).apply_translation([0.5, 0.9, 0.1])
    )
    camera = a_camera((61, 53), 60.1)
    fragments = seen(mesh, camera)
    balance = torch.zeros(61 * 53, dtype=torch.long)
    balance.index_add_(0, fragments.pixel, torch.where(fragments.is_front, 1, -1))
    assert len(fragments.pixel) > 3000
    assert (balance == 0).all()


def test_the_picture_is_cut_at_its_border_not_bent():
    mesh, camera = trimesh.creation.icosphere(2), a_camera((40, 40), 40.3)
    whole, part = as_dict(seen(mesh, camera)), as_dict(seen(mesh, camera.cropped(13, 9, (11, 20))))
    assert part
    expected = {
        ((row - 9) * 11 + column - 13, face): value
        for (pixel, face), value in whole.items()
        for row, column in [divmod(pixel, 40)]
        if 13 <= column < 24 and 9 <= row < 29
    }
    assert part.keys() == expected.keys()
    np.testing.assert_allclose([part[key][0] for key in expected], [value[0] for value in expected.values()])


def test_faces_at_or_behind_the_camera_are_left_out():
    triangle = torch.tensor([[0.0, 0.0], [0.0, 20.0], [20.0, 0.0]])
    faces = torch.tensor([[0, 1, 2]])
    assert len(rasterise(triangle, torch.full((3,), 1.0), faces, SIZE).pixel) > 0
    for depth in ([1.0, 1.0, -1.0], [-1.0, -1.0, -1.0], [1.0, 1.0, NEAR_M / 2]):
        assert len(rasterise(triangle, torch.tensor(depth), faces, SIZE).pixel) == 0


def test_the_camera_inside_a_sphere_sees_backs_only():
    fragments = seen(trimesh.creation.icosphere(2), a_camera(origin=(0.1, 0.2, 0.0)))
    assert len(fragments.pixel) >= SIZE[0] * SIZE[1]
    assert not fragments.is_front.any()


def test_an_edge_on_face_and_an_empty_view_cover_nothing():
    line = torch.tensor([[0.0, 0.0], [5.0, 5.0], [10.0, 10.0]])
    faces = torch.tensor([[0, 1, 2]])
    assert len(rasterise(line, torch.ones(3), faces, SIZE).pixel) == 0
    assert len(rasterise(line + 100, torch.ones(3), faces, SIZE).pixel) == 0


def test_a_triangle_by_hand():
    """Legs of 3 px from (1, 1): the centres (1.5, 1.5), (2.5, 1.5), (1.5, 2.5) and, on the slope, (3.5, 1.5) ..."""
    corners = torch.tensor([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]], dtype=torch.float64)
    fragments = rasterise(corners, torch.ones(3, dtype=torch.float64), torch.tensor([[0, 1, 2]]), (10, 10))
    points = sorted((pixel % 10, pixel // 10) for pixel in fragments.pixel.tolist())
    assert points == [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1)]
    assert not fragments.is_front.any()  # runs clockwise with y down: seen from behind


@pytest.mark.parametrize("is_orthographic", [True, False])
def test_depth_or_its_inverse_is_linear_on_screen(is_orthographic):
    """From 0.2 at the left edge of a square of 10 px to 0.8 at its right one."""
    corners = torch.tensor([[0.0, 0], [10, 0], [10, 10], [0, 10]], dtype=torch.float64)
    depth = torch.tensor([0.2, 0.8, 0.8, 0.2], dtype=torch.float64)
    found = rasterise(corners, depth, torch.tensor([[0, 1, 2], [0, 2, 3]]), (10, 10), is_orthographic)
    share = (found.pixel % 10 + 0.5) / 10
    expected = 0.2 + 0.6 * share if is_orthographic else 1 / (5 + (1.25 - 5) * share)
    torch.testing.assert_close(found.depth, expected.double())
    assert len(found.pixel) >= 100


def test_depth_has_gradients():
    corners = torch.tensor([[1.1, 1.2], [9.3, 1.0], [1.4, 8.8]], dtype=torch.float64, requires_grad=True)
    depth = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64, requires_grad=True)
    faces = torch.tensor([[0, 1, 2]])
    assert torch.autograd.gradcheck(lambda p, z: rasterise(p, z, faces, (7, 7)).depth, (corners, depth))


def test_the_nearest_fronts_are_the_least_deep_fragments_that_face_the_camera():
    mesh, camera = trimesh.creation.torus(0.5, 0.2, 12, 9), a_camera()
    fragments = seen(mesh, camera)
    found = nearest_fronts(fragments, SIZE)
    for pixel in range(SIZE[0] * SIZE[1]):
        here = fragments.is_front & (fragments.pixel == pixel)
        if not here.any():
            assert (found.depth[pixel], found.face[pixel]) == (torch.inf, -1)
            continue
        assert found.depth[pixel] == fragments.depth[here].min()
        assert fragments.depth[here & (fragments.face == found.face[pixel])] == found.depth[pixel]
    assert (found.face >= 0).sum() > 30
