"""Surfaces extracted from grids: closed, turned outward, and where the values are zero."""

import numpy as np
import pytest
import trimesh
from livehand.backend.geometry.contour import zero_surface
from livehand.backend.records.errors import LiveHandError

SPACING, RADIUS = 0.1, 0.83
ORIGIN = np.array([-1.17, -1.11, -1.23])


def grid(size=25):
    return ORIGIN + SPACING * np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij"), -1)


def test_a_ball_is_closed_and_faces_outward():
    vertices, faces = zero_surface(RADIUS - np.linalg.norm(grid(), axis=-1), ORIGIN, SPACING)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=-1), RADIUS, atol=5e-3)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.01)
    assert (np.einsum("fc,fc->f", mesh.face_normals, mesh.triangles_center) > 0).all()


def test_a_plane_is_exact_however_it_lies():
    normal = np.array([0.48, -0.6, 0.64])
    vertices, faces = zero_surface(-(grid(9) @ normal + 0.9), ORIGIN, SPACING)
    np.testing.assert_allclose(vertices @ normal, -0.9, atol=1e-12)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    crossed = np.cross(b - a, c - a)
    crossed = crossed[np.linalg.norm(crossed, axis=1) > 1e-9]
    np.testing.assert_allclose(
        crossed / np.linalg.norm(crossed, axis=1)[:, None], normal[None].repeat(len(crossed), 0), atol=1e-6
    )


def test_random_values_give_a_closed_surface_within_the_grid():
    values = np.random.default_rng(0).normal(size=(8, 9, 7))
    values = np.pad(values, 1, constant_values=-1.0)
    mesh = trimesh.Trimesh(*zero_surface(values, np.zeros(3), 1.0), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent


@pytest.mark.parametrize("value", [1.0, -1.0, 0.0])
def test_values_of_one_sign_have_no_surface(value):
    vertices, faces = zero_surface(np.full((3, 3, 3), value), np.zeros(3), 1.0)
    assert (vertices.shape, faces.shape) == ((0, 3), (0, 3))


@pytest.mark.parametrize("values", [np.zeros((1, 3, 3)), np.zeros((3, 3)), np.full((2, 2, 2), np.nan)])
def test_other_grids_are_refused(values):
    with pytest.raises(LiveHandError, match="2 x 2 x 2 finite values"):
        zero_surface(values, np.zeros(3), 1.0)
