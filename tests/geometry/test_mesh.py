"""Posed meshes: normals, scale, and which faces lie around each."""

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.geometry.mesh import face_neighbours, mean_edge_length, posed_mesh, vertex_normals
from livehand.backend.geometry.tolerances import LANES


def test_normals_of_a_sphere_point_outward_and_a_lone_vertex_has_none():
    sphere = trimesh.creation.icosphere(3)
    vertices = torch.as_tensor(np.vstack([sphere.vertices, [[9.0, 9, 9]]]))
    normals = vertex_normals(vertices, torch.as_tensor(np.asarray(sphere.faces)))
    torch.testing.assert_close(normals[:-1], vertices[:-1], atol=2e-2, rtol=0)
    assert (normals[-1] == 0).all()


def test_mean_edge_length_by_hand():
    vertices = torch.tensor([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    assert float(mean_edge_length(vertices, torch.tensor([[0, 1], [1, 2], [2, 0]]))) == 4


def test_scale_is_one_on_the_template_and_grows_with_the_world(posed):
    hand = posed("rest")
    assert float(hand.mesh.scale) == pytest.approx(1, rel=1e-6)
    assert float(posed_mesh(hand.topology, hand.mesh.vertices * 10).scale) == pytest.approx(10, rel=1e-5)


def test_neighbours_are_the_faces_that_share_a_vertex():
    """A strip of three faces, and one alone: itself first, and again where it has fewer than the others."""
    faces = torch.tensor([[0, 1, 2], [2, 1, 3], [3, 1, 4], [4, 3, 5], [6, 7, 8]])
    neighbours = face_neighbours(faces)
    assert neighbours[:, :4].tolist() == [[0, 1, 2, 0], [1, 0, 2, 3], [2, 0, 1, 3], [3, 1, 2, 3], [4, 4, 4, 4]]
    assert neighbours[:, 4:].tolist() == [[face] * (LANES - 3) for face in range(5)]


def test_neighbours_of_the_hand_against_sets(posed):
    faces = posed("rest").topology.faces
    corners = [set(face) for face in faces.tolist()]
    for face, row in list(enumerate(posed("rest").topology.neighbours.tolist()))[::97]:
        assert row[0] == face
        assert set(row) == {other for other, theirs in enumerate(corners) if theirs & corners[face]}
