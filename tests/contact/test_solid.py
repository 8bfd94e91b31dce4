"""Signed distances against closed forms, of meshes as scenes have them."""

import numpy as np
import pytest
import trimesh
from livehand.backend.contact.oriented_mesh import oriented_parts
from livehand.backend.contact.placed_solids import PlacedSolid, Solids
from livehand.backend.contact.solid import MeshSolid
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.records.errors import LiveHandError

HALF_M = np.array([0.03, 0.05, 0.01])


@pytest.fixture(scope="module")
def box():
    return trimesh.creation.box(2 * HALF_M)


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-0.1, 0.1, (3000, 3))


def box_distance(points):
    over = np.abs(points) - HALF_M
    return np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(1), 0)


def test_a_box_is_exact_and_its_distances_grow_outwards(box, points):
    found = MeshSolid(box.vertices, box.faces).distances(points)
    np.testing.assert_allclose(found.signed_m, box_distance(points), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.outward, axis=1), 1, atol=1e-9)
    further = box_distance(points + 1e-5 * found.outward)
    is_smooth = np.abs(further - found.signed_m - 1e-5) < 1e-9
    assert is_smooth.mean() > 0.99  # all but those beside the box's middle planes


def test_a_sphere_is_one_up_to_its_facets(points):
    ball = trimesh.creation.icosphere(5, 0.04)
    found = MeshSolid(ball.vertices, ball.faces).distances(points).signed_m
    np.testing.assert_allclose(found, np.linalg.norm(points, axis=1) - 0.04, atol=2e-5)


@pytest.mark.parametrize("fault", ["inside out", "some faces", "split", "flat faces"])
def test_meshes_as_scenes_have_them_are_put_right(box, points, fault):
    vertices, faces = np.asarray(box.vertices), np.array(box.faces)
    if fault == "inside out":
        faces = faces[:, ::-1]
    elif fault == "some faces":
        faces[[0, 3, 4, 7]] = faces[[0, 3, 4, 7]][:, ::-1]
    elif fault == "split":
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    else:
        faces = np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])
    solid = MeshSolid(vertices, faces)
    assert solid.is_closed
    np.testing.assert_allclose(solid.distances(points).signed_m, box_distance(points), atol=1e-12)


def test_parts_that_pass_through_each_other_are_one_solid():
    one = trimesh.creation.icosphere(4, 0.04)
    both = trimesh.util.concatenate([one, one.copy().apply_translation((0.03, 0, 0))])
    solid = MeshSolid(both.vertices, both.faces)
    found = solid.distances(np.array([[0.03, 0, 0.0], [0.06, 0, 0], [-0.05, 0, 0], [0.0385, 0, 0]])).signed_m
    np.testing.assert_allclose(found, [-0.04, -0.01, 0.01, -0.0315], atol=2e-4)


def test_a_plane_counts_from_its_front_and_ends_at_its_rim():
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    plane = MeshSolid(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    assert not plane.is_closed
    found = plane.distances(np.array([[0.1, 0, 0.02], [0.1, 0, -0.02], [0.53, 0, -0.04]]))
    np.testing.assert_allclose(found.signed_m, [0.02, -0.02, 0.05], atol=1e-12)
    np.testing.assert_allclose(found.outward, [[0, 0, 1], [0, 0, 1], [0.6, 0, -0.8]], atol=1e-9)
    below = MeshSolid(corners, np.array([[2, 1, 0], [3, 2, 0]]))
    np.testing.assert_allclose(below.distances(np.array([[0.1, 0, 0.02]])).signed_m, [-0.02], atol=1e-12)


def test_placed_solids_turn_mirror_and_join(box, points):
    turn, place = axis_angle_to_matrix(np.array([0.3, -1.0, 0.5])), np.array([0.02, 0.01, -0.04])
    moved = PlacedSolid.of(box.vertices, box.faces).moved(turn, place)
    expected = box_distance((points - place) @ turn)
    np.testing.assert_allclose(moved.distances(points).signed_m, expected, atol=1e-12)
    mirrored = moved.mirrored().distances(points * (-1, 1, 1))
    np.testing.assert_allclose(mirrored.signed_m, expected, atol=1e-12)
    np.testing.assert_allclose(mirrored.outward * (-1, 1, 1), moved.distances(points).outward, atol=1e-9)
    both = Solids([moved, PlacedSolid.of(box.vertices, box.faces)]).distances(points).signed_m
    np.testing.assert_allclose(both, np.minimum(expected, box_distance(points)), atol=1e-12)


@pytest.mark.parametrize(
    ("vertices", "faces", "match"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "must have faces with an area, got none"),
        (np.eye(3) * 0 + 1.0, np.array([[0, 1, 2]]), "must have faces with an area, got none"),
        (np.eye(3) * np.nan, np.array([[0, 1, 2]]), "must be finite"),
    ],
)
def test_what_is_no_surface_is_refused(vertices, faces, match):
    with pytest.raises(LiveHandError, match=match):
        oriented_parts(vertices, faces)
