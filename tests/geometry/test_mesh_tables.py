"""Tables of triangle meshes against trimesh."""

import numpy as np
import pytest
import trimesh
from livehand.backend.geometry.mesh_tables import (
    area_weighted_normals,
    connected_components,
    half_edges,
    neighbour_table,
    open_half_edges,
    pinched_vertices,
    repeated_half_edges,
)


@pytest.fixture
def ball():
    return trimesh.creation.icosphere(2)


def test_a_closed_mesh_has_opposite_half_edges(ball):
    assert len(half_edges(ball.faces)) == 2 * len(ball.edges_unique)
    assert len(open_half_edges(ball.faces)) == len(repeated_half_edges(ball.faces)) == 0


def test_a_removed_face_opens_three_half_edges_and_a_flipped_one_repeats_three(ball):
    opened = ball.faces[1:]
    boundary = {tuple(edge[::-1]) for edge in half_edges(ball.faces[:1])}
    assert {tuple(edge) for edge in open_half_edges(opened)} == boundary
    flipped = ball.faces.copy()
    flipped[0] = flipped[0, ::-1]
    assert len(repeated_half_edges(flipped)) == 3


def test_neighbours_are_the_vertices_at_the_other_end_of_an_edge(ball):
    table = neighbour_table(ball.faces, len(ball.vertices))
    for vertex, row in enumerate(table):
        assert set(row.tolist()) - {vertex} == set(ball.vertex_neighbors[vertex])


def test_normals_are_weighted_by_area(ball):
    normals = area_weighted_normals(ball.vertices, ball.faces)
    expected = np.zeros_like(normals)
    for corner in range(3):
        np.add.at(expected, ball.faces[:, corner], ball.face_normals * ball.area_faces[:, None])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-12)
    assert not area_weighted_normals(np.zeros((3, 3)), np.array([[0, 1, 2]])).any()


def test_pieces_and_pinches():
    faces = np.array([[0, 1, 2], [2, 3, 4], [5, 6, 7]])
    np.testing.assert_array_equal(connected_components(faces, 9), [0, 0, 0, 0, 0, 5, 5, 5, 8])
    np.testing.assert_array_equal(pinched_vertices(faces), [2])
