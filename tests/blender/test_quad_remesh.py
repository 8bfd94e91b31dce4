"""The built-in hand, remeshed with quads by QuadriFlow."""

import bpy
import numpy as np
import pytest
import trimesh
from livehand.backend.hand.builtin.generate import dense_surface, projected_quads, shipped_quads, split_quads
from livehand.livehand_blender.capture.quad_remesh import quad_remesh


@pytest.fixture(scope="module")
def remeshed():
    return quad_remesh(*dense_surface())


def test_the_remeshed_hand_can_be_a_template(remeshed):
    """Closed, quads only, about as many as ours; identical if Blender's QuadriFlow is that of 4.5."""
    quads = projected_quads(*remeshed)
    mesh = trimesh.Trimesh(quads.vertices, split_quads(quads), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert 1000 < len(quads.quads) < 1600
    if bpy.app.version[:2] == (4, 5):
        np.testing.assert_array_equal(quads.quads, shipped_quads().quads)
        np.testing.assert_allclose(quads.vertices, shipped_quads().vertices, atol=1e-9)


def test_nothing_is_left_behind(remeshed):
    before = len(bpy.data.objects), len(bpy.data.meshes)
    sphere = trimesh.creation.icosphere(3)
    vertices, quads = quad_remesh(sphere.vertices, sphere.faces, 200)
    assert quads.shape[1] == 4
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.1
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == before
