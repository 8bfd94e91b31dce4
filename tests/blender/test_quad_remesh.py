"""The built-in hand, remeshed with quads by QuadriFlow."""

import bpy
import numpy as np
import pytest
import torch
import trimesh
from livehand.tools.builtin_hand.generate import dense_surface, projected_quads, split_quads, template_quads
from livehand.tools.builtin_hand.quad_remesh import quad_remesh


@pytest.fixture(scope="module")
def remeshed():
    return quad_remesh(*dense_surface())


def test_the_remeshed_hand_can_be_a_template(remeshed):
    """Closed, quads only, about as many as ours; identical with Blender 4.5 on the kind of processor that made ours.

    That has AVX-512. From the same code, one with AVX2 alone found 1,080 quads instead of 1,270.
    """
    quads = projected_quads(*remeshed)
    mesh = trimesh.Trimesh(quads.vertices, split_quads(quads), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert 1000 < len(quads.quads) < 1600
    if bpy.app.version[:2] == (4, 5) and torch.backends.cpu.get_cpu_capability() == "AVX512":
        np.testing.assert_array_equal(quads.quads, template_quads().quads)
        np.testing.assert_allclose(quads.vertices, template_quads().vertices, atol=1e-9)


def test_nothing_is_left_behind(remeshed):
    before = len(bpy.data.objects), len(bpy.data.meshes)
    sphere = trimesh.creation.icosphere(3)
    vertices, quads = quad_remesh(sphere.vertices, sphere.faces, 200)
    assert quads.shape[1] == 4
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.1
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == before
