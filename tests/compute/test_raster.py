"""The raster kernels against `geometry.rasterise`, and projection against double precision."""

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.rays import projected_mesh
from livehand.backend.compute.kernels.raster import ProjectedMesh, find_crossings, nearest_depth
from livehand.backend.compute.kernels.rays import ShellCrossings
from livehand.backend.field.rays import CameraTensors, project
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.geometry.tolerances import NEAR_M

pytestmark = pytest.mark.slow

LAYERS = 24  # more than any ray has crossings here


@pytest.fixture(scope="module")
def posed(posed_without_arm):
    """Without an arm, whose inside the camera between the vertices then is."""
    return posed_without_arm


def fragments_of(positions_px, depth, faces, size_px):
    """{pixel: [(depth, face, front)], nearest first} by torch."""
    found = rasterise(positions_px, depth, faces, size_px)
    by_pixel = {}
    for pixel, *values in zip(
        *(v.tolist() for v in (found.pixel, found.depth, found.face, found.is_front)), strict=True
    ):
        by_pixel.setdefault(pixel, []).append(tuple(values))
    return {pixel: sorted(values) for pixel, values in by_pixel.items()}


def layers_of(positions_px, depth, faces, size_px, layers=LAYERS, rows=None):
    """The same by the kernel, in bands of `rows` rows."""
    width, height = size_px
    layer_depth, layer_face = (
        np.zeros((width * height, layers), np.float32),
        np.zeros((width * height, layers), np.int32),
    )
    count = np.zeros(width * height, np.int32)
    mesh = ProjectedMesh(positions_px.numpy(), depth.numpy(), faces.numpy())
    unread = np.empty(0, np.float32)
    crossings = ShellCrossings(layer_depth, layer_face, count, unread, unread, *np.zeros(3, np.float32))
    rows = rows or height
    for first in range(0, height, rows):
        find_crossings(mesh, width, first, min(first + rows, height), crossings)
    return {
        pixel: [
            (float(z), int(mark if mark >= 0 else -1 - mark), bool(mark >= 0))
            for z, mark in zip(layer_depth[pixel, :n], layer_face[pixel, :n], strict=True)
        ]
        for pixel, n in enumerate(count.tolist())
        if n
    }


def nearest_of(positions_px, depth, faces, size_px, has_backs):
    nearest = np.full(size_px[0] * size_px[1], np.inf, np.float32)
    mesh = ProjectedMesh(positions_px.numpy(), depth.numpy(), faces.numpy())
    nearest_depth(mesh, size_px[0], 0, size_px[1], has_backs, nearest)
    return nearest


def assert_same(ours, expected):
    """The same fragments of every pixel, at the same depths, sorted."""
    assert ours.keys() == expected.keys()
    for pixel, fragments in expected.items():
        found = ours[pixel]
        assert [z for z, _, _ in found] == sorted(z for z, _, _ in found)
        np.testing.assert_allclose([z for z, _, _ in found], [z for z, _, _ in fragments], rtol=3e-7)
        # Faces whose depths are the same but for rounding may change places.
        assert sorted(fragment[1:] for fragment in found) == sorted(fragment[1:] for fragment in fragments)


VIEWS = {
    "front": ((0.1, -1, 0.2), (48, 44), 0.25),
    "end": ((-1, 0.1, 0.1), (40, 44), 0.25),
    "border": ((0.2, 1, 0.4), (40, 31), 0.08),  # the hand reaches past all four sides
    "one pixel": ((0.1, -1, 0.2), (1, 1), 0.03),
    "one column": ((0.1, -1, 0.2), (1, 60), 0.25),
}


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
def test_layers_are_the_fragments_sorted(posed, view_from, name, gesture, side):
    direction, size_px, field_m = VIEWS[name]
    hand = posed(gesture, side)
    view = view_from(hand.mesh, direction, size_px, field_m=field_m)
    scene = (*project(view, hand.mesh.vertices), hand.topology.faces, size_px)
    expected = fragments_of(*scene)
    assert expected
    assert max(len(fragments) for fragments in expected.values()) < LAYERS
    assert_same(layers_of(*scene), expected)
    for has_backs in (False, True):
        nearest = nearest_of(*scene, has_backs)
        first = np.full(size_px[0] * size_px[1], np.inf)
        for pixel, fragments in expected.items():
            first[pixel] = min([z for z, _, front in fragments if front or has_backs], default=np.inf)
        np.testing.assert_allclose(nearest, first, rtol=3e-7)


@pytest.fixture(scope="module")
def fist(posed, view_from):
    hand = posed("fist")
    view = view_from(hand.mesh, (-0.8, 0.5, 0.4), (33, 37))
    return *project(view, hand.mesh.vertices), hand.topology.faces, view.size_px


@pytest.mark.parametrize("rows", [1, 5, 36])
def test_bands_of_rows_do_not_show(fist, rows):
    assert layers_of(*fist, rows=rows) == layers_of(*fist)


@pytest.mark.parametrize("layers", [1, 2, 5])
def test_of_too_many_crossings_the_nearest_are_kept(fist, layers):
    whole = layers_of(*fist)
    assert max(len(fragments) for fragments in whole.values()) > 5
    for pixel, kept in layers_of(*fist, layers=layers).items():
        assert [z for z, _, _ in kept] == [z for z, _, _ in whole[pixel]][:layers]


def test_nearest_depth_only_lowers_what_is_there(fist):
    free = nearest_of(*fist, True)
    held = np.full_like(free, np.median(free[np.isfinite(free)]))
    mesh = ProjectedMesh(*(values.numpy() for values in fist[:3]))
    lowered = held.copy()
    nearest_depth(mesh, fist[3][0], 0, fist[3][1], True, lowered)
    np.testing.assert_array_equal(lowered, np.minimum(held, free))
    assert (lowered < held).any()
    assert (lowered == held).any()


TRIANGLE = torch.tensor([[2.2, 1.9], [1.8, 20.3], [17.1, 3.3]])
FACE = torch.tensor([[0, 1, 2]])


@pytest.mark.parametrize(
    ("positions_px", "depth"),
    [
        (TRIANGLE, [1.0, 1.0, -1.0]),  # behind the camera
        (TRIANGLE, [1.0, 1.0, NEAR_M / 2]),
        (TRIANGLE, [1.0, 1.0, NEAR_M]),
        (TRIANGLE[[0, 0, 0]], [1.0, 1.0, 1.0]),  # degenerate: a point, a line
        (torch.tensor([[1.5, 1.5], [5.5, 5.5], [9.5, 9.5]]), [1.0, 1.0, 1.0]),
        (TRIANGLE + 40, [1.0, 1.0, 1.0]),  # outside the image on either side
        (TRIANGLE - 40, [1.0, 1.0, 1.0]),
        (TRIANGLE * torch.tensor([1.0, -1.0]), [1.0, 1.0, 1.0]),
    ],
)
def test_nothing_is_drawn_of(positions_px, depth):
    scene = (positions_px, torch.tensor(depth), FACE, (23, 19))
    assert fragments_of(*scene) == {}
    assert layers_of(*scene) == {}
    assert np.isinf(nearest_of(*scene, True)).all()


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-9.0, 4.0), (9.0, -8.0), (-1e4, -1e4)])
@pytest.mark.parametrize("scale", [1.0, 30.0, 1e4])
def test_a_triangle_across_the_border_and_one_far_larger_than_the_image(shift, scale):
    positions_px = TRIANGLE * scale + torch.tensor(shift)
    for face in (FACE, FACE[:, [0, 2, 1]]):
        scene = (positions_px, torch.tensor([0.4, 0.9, 2.0]), face, (23, 19))
        assert_same(layers_of(*scene), fragments_of(*scene))


def test_pixel_centres_on_edges_and_corners():
    """Two triangles of whole-numbered corners that share an edge through pixel centres: both cover it."""
    positions_px = torch.tensor([[1.5, 1.5], [1.5, 6.5], [6.5, 1.5], [6.5, 6.5]])
    scene = (positions_px, torch.ones(4), torch.tensor([[0, 1, 2], [2, 1, 3]]), (9, 9))
    ours = layers_of(*scene)
    assert_same(ours, fragments_of(*scene))
    assert len(ours[4 * 9 + 3]) == 2
    assert len(ours) == 36


def test_a_camera_within_the_mesh(posed):
    """Some faces cross the camera's plane and are left out, the others fill the image."""
    hand = posed("open")
    K, world2cam = torch.tensor([[40.0, 0, 15], [0, 40, 15], [0, 0, 1]]), torch.eye(4)
    world2cam[:3, 3] = -hand.mesh.vertices[hand.mesh.vertices[:, 0].argsort()[len(hand.mesh.vertices) // 2]]
    view = CameraTensors(K, world2cam, (30, 30))
    scene = (*project(view, hand.mesh.vertices), hand.topology.faces, (30, 30))
    expected = fragments_of(*scene)
    assert len(expected) > 20
    assert_same(layers_of(*scene), expected)


def test_projection_is_that_of_torch_in_double_precision(posed, view_from):
    hand = posed("fist")
    view = view_from(hand.mesh, (0.3, -1, 0.2), size_px=(500, 480))
    skewed = view._replace(K=view.K + torch.tensor([[0.0, 0.7, 0], [0, 0, 0], [0.01, 0, 0]]))
    for camera in (view, skewed):
        mesh = projected_mesh(camera, hand.mesh.vertices, hand.topology.faces)
        finely = camera._replace(K=camera.K.double(), world2cam=camera.world2cam.double())
        expected_px, expected_m = project(finely, hand.mesh.vertices.double())
        torch.testing.assert_close(torch.tensor(mesh.positions_px).double(), expected_px, atol=0, rtol=1e-7)
        torch.testing.assert_close(torch.tensor(mesh.depth).double(), expected_m, atol=0, rtol=1e-7)
    assert torch.equal(torch.tensor(mesh.faces), hand.topology.faces)
